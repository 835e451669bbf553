// Whole trajectories of the midpoint integrator as a discrete system x+ = f(x, u): roll-outs under feedback, and, in
// parallel over time, first derivatives and contracted second derivatives. Arrays are row-major, time first, in the
// user's order of variables: X (N+1, nx), U (N, nu), lam (N, nc), times t (N+1).
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

// What one linearised step leaves for the second order: the multipliers and their derivatives, and the derivatives by
// shifts of the constraints. Sizes by mechanism.
struct StepMemo {
    explicit StepMemo(const Mechanism& m)
        : nc(m.n_constraints()), theta(m.n_variables() + m.n_dynamic + m.n_inputs + m.n_kinematic), nd(m.n_dynamic) {}
    int nc, theta, nd;
    std::size_t size() const { return static_cast<std::size_t>(nc) * (1 + theta + nc + 2 * nd); }
};

// Derivatives of every step. With `multipliers` the multipliers of a step count as further states of its end, which
// nothing depends on: ny = nx + nc states instead of nx. A (N, ny, ny), B (N, ny, nu), lam (N, nc), memo (N,
// StepMemo::size()), defect (N): distance of the dynamic configuration from the next one in X, which stays
// (N+1, nx). Returns the first step at which the trajectory is not one, or N.
int linearize(const std::shared_ptr<const Mechanism>& mechanism, const MidpointSettings& settings, int steps,
              const double* t, const double* X, const double* U, bool multipliers, int threads, double* A, double* B,
              double* lam, double* memo, double* defect, bool zeroed = false);

// Derivatives of the next states (N, nx, P) and the multipliers (N, nc, P) of every step by parameters, the state and the
// input of the step held. Returns the first step at which the trajectory is not one, or N.
int differentiate_by_parameters(const std::shared_ptr<const Mechanism>& mechanism, const MidpointSettings& settings,
                                int steps, const double* t, const double* X, const double* U,
                                const std::vector<Parameter>& parameters, int threads, double* by_x, double* by_lam);

// Hessians by (states, u), (N, ny + nu, ny + nu), of the next states weighted with W (N, ny).
void curvatures(const std::shared_ptr<const Mechanism>& mechanism, const MidpointSettings& settings, int steps,
                const double* t, const double* X, const double* U, bool multipliers, const double* A, const double* B,
                const double* memo, const double* W, int threads, double* H, bool zeroed = false);

}  // namespace leastaction
