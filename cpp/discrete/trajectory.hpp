// Roll-outs of the midpoint integrator as a discrete system x+ = f(x, u), under feedback. Arrays are row-major, time
// first, in the user's order of variables: X (N+1, nx), U (N, nu), lam (N, nc), times t (N+1).
#pragma once

#include "discrete/integrator.hpp"

namespace leastaction {

// The coarsest step: those that were not followed count as sound.
struct WorstStep {
    int k = -1;
    double s = NAN, angle = 0;
    int variable = -1;  // the user's; -1: nothing turned
};

struct RollOut {
    int steps = 0;  // how many steps succeeded
    StepReport failure;
    bool rank_deficient = false;
    long iterations = 0, factorizations = 0;
    long followed = 0;  // steps whose solution had to be followed from dt -> 0
    WorstStep worst;
    bool interrupted = false;  // it was stopped, without a failure
};

// Whether to stop a roll-out, which keeps what it made: poll() is asked now and then, caught() of an exception that is being
// handled, which came out of a step.
class Interruption {
public:
    virtual ~Interruption() = default;
    virtual bool poll() = 0;
    virtual bool caught() = 0;
};

// Follows u_k = ubar_k - K_k (x_k - xbar_k) from X[0]; K null: open loop. Fills X[1..], U and lam up to the failed step.
// `xbar` (may be null without K) is where the motion is expected; forces at the instants act at the first one for
// `first_share` of its step. Fills `energies`, rows of EnergyRows, if given. After a failure, `step` holds the step that
// failed (residuals, unknowns).
RollOut roll_out(MidpointStep& step, int steps, const double* t, const double* xbar, const double* ubar,
                 const double* K, double first_share, double* X, double* U, double* lam, double* energies = nullptr,
                 Interruption* interruption = nullptr);

// The steps of a curve, each from its own X[k] under U[k], whatever the next state is: fills ends (N, nx) and lam up to
// the first that fails.
RollOut step_each(const Midpoint& integrator, int steps, const double* t, const double* X, const double* U,
                  double first_share, int threads, double* ends, double* lam);

}  // namespace leastaction
