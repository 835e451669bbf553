// The balance of energy and work along steps.
//
// With E = T + V at the middle of each step, from one to the next it changes by the work of the impulses J at the instant
// between them, which meet the mean of both velocities:
//
//   W_k = J_k.(v_{k-1} + v_k) / 2,   J_k = fd+_{k-1} + share f(q_k, 0, u_k) + fd-_k   for dynamic variables,
//
// and for prescribed ones whatever moves them so, J_k = -(D2Ld_{k-1} + D1Ld_k - Dh(q_k)' lam_k), which has the work of
// forces on them in it. For a point mass that is exact, whatever the force (E there being T); constraints do no work, and
// where theirs is not nothing, the energy does not balance.
#pragma once

#include <vector>

#include "discrete/integrator.hpp"

namespace leastaction {

// One row for each step of a motion, one after the other: T, V, the work since the middle of the step before (none of the
// first), the sum of its parts' sizes, and that of the energy's.
class EnergyRows {
public:
    static constexpr int width = 5;
    // Of a step that was solved; p: momenta at its start, user's order, which forces at the instants have not changed.
    void note(MidpointStep& step, double dt, const double* p, double* row);

private:
    StepEnergy before_, now_;
};

// What energy does beside the work that is done, R_k = E_k - E_0 - (W_1 + ... + W_k).
struct EnergyBalance {
    std::vector<double> residual;
    double swing = 0;    // its largest less its least
    double kinetic = 0;  // the largest
    double work = 0;     // the largest work since the start less the least
    double size = 0;     // of all terms that this is made of
};
EnergyBalance balance_of(const double* rows, std::size_t steps);

// Of steps that are known.
void energies_along(const Midpoint& integrator, int steps, const double* t, const double* X, const double* U,
                    const double* lam, double first_share, double* rows);

}  // namespace leastaction
