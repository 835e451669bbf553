// Roll-outs of the midpoint integrator as a discrete system x+ = f(x, u), under feedback. Arrays are row-major, time
// first, in the user's order of variables: X (N+1, nx), U (N, nu), lam (N, nc), times t (N+1).
#pragma once

#include "discrete/midpoint.hpp"

namespace leastaction {

struct RollOut {
    int steps = 0;  // how many steps succeeded
    StepReport failure;
    bool rank_deficient = false;
    long iterations = 0, factorizations = 0;
};

// Follows u_k = ubar_k - K_k (x_k - xbar_k) from X[0]; K null: open loop. Fills X[1..], U and lam up to the failed step.
// `velocity` (n_dynamic, may be null) is a guess of the first step's dynamic velocity. After a failure, `last` holds the
// step that failed (residuals, unknowns).
RollOut roll_out(MidpointStep& step, int steps, const double* t, const double* xbar, const double* ubar,
                 const double* K, const double* velocity, double* X, double* U, double* lam);

}  // namespace leastaction
