// The step of newton_step.hpp for several configurations side by side, on its straight way: one Newton matrix, a few
// corrections, and a root that is trusted as in root.cpp. A lane that does not go that way is left to a MidpointStep. What
// becomes of a lane depends on nothing in the others.
#pragma once

#include <vector>

#include "discrete/newton_step.hpp"
#include "dynamics/lane_newton.hpp"

namespace leastaction {

class LaneStep {
public:
    // Whether there are lanes of a mechanism: those whose Newton matrix a MidpointStep has as a whole.
    static bool suits(const MidpointStep& step);
    explicit LaneStep(const MidpointStep& like);

    std::vector<Lanes> q1, p1, u, q2, lam, p2;  // as in MidpointStep
    double t = 0;

    // Begins anew, from q1.
    void place_start();
    // Makes the guess of dt -> 0; the lanes in which that could be done.
    Lanes::Mask guess_limit(double dt);
    // Solves in those lanes; the lanes in which the solution is trusted.
    Lanes::Mask find(double dt, const Lanes::Mask& running);
    // Given (q1, p1, u, q2) of steps: the multipliers, and the Newton matrix there; the lanes in which these are steps.
    Lanes::Mask know(double dt);
    // After that, the derivatives of (q2; lam) and of p2 by th = [q1 | p1 | u | rho2], one column after the other.
    void differentiate(double dt, Lanes* Y, Lanes* P2);
    int n_theta() const { return nq_ + nd_ + static_cast<int>(u.size()) + nq_ - nd_; }
    // Takes over the solution that another step found for a lane.
    void take(int lane, const MidpointStep& found, double dt);
    // Makes (q2, p2) the start of the next step.
    void advance();

private:
    void evaluate(double dt);
    Lanes::Mask factor(double dt, const Lanes::Mask& which);
    void constraint_gradients(const Lanes* q, std::vector<Lanes>& C);
    Lanes::Mask trusted(double dt, const Lanes::Mask& factored);
    void keep_pivots(double dt, const Lanes::Mask& which);

    const Mechanism& mechanism_;
    Split split_;
    double tolerance_;
    std::vector<double> turn_;
    int nd_, nq_, nc_;

    Lagrangian<Lanes> lagrangian_;
    LaneNewton newton_;
    Placement<Lanes> at2_;
    LocalTaylor<Lanes> local_;
    LocalForce<Lanes> force_;
    std::vector<Lanes> q_mid_, v_, f_, C1_, C2_, h_, h_scale_, residual_, correction_;
    std::vector<Lanes> root_inertia_, new_root_inertia_, expected_v_, pivots_, mobility_;
    std::vector<Lanes> G_y_;
    Lanes largest_;  // of the relative residuals
};

}  // namespace leastaction
