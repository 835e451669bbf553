// First derivatives of a midpoint step, exact, by the implicit function theorem (dissertation appendix A.2).
//
// With y = (q2; lam), its dynamic part, and th = [q1 | p1 | u | rho2] the step is F(y, th) = 0, p2 = G(y, th), so that
//
//   Y = dy/dth = -F_y^-1 F_th,   P2 = dp2/dth = G_th + G_y Y,
//
// and likewise by a shift s of the constraints, F2 = h + s. F_y is the Newton matrix at the solution itself: its one
// factorisation serves all.
#pragma once

#include <vector>

#include "discrete/newton_step.hpp"
#include "numerics/aligned.hpp"

namespace leastaction {

class FirstOrder {
public:
    explicit FirstOrder(const Mechanism& mechanism);

    // Of a step that is solved. Returns false where the Newton matrix is singular.
    bool differentiate(MidpointStep& step, double dt);

    const int n_theta, ld;     // columns of th, and of the rows: th, then the shifts, padded
    AlignedVector Y;           // (n_dynamic + n_constraints) x ld: d(q2; lam)/d[th | shift of h]
    AlignedVector P2;          // n_dynamic x ld: dp2/d[th | shift of h]
    NewtonMatrix::Matrix G_y;  // dp2/dq2, dynamic

private:
    void add_balls(const MidpointStep& step);  // what their ends add, and what constraints see of prescribed ones

    LocalTaylor<double> local_;
    LocalForce<double> force_;
};

}  // namespace leastaction
