// Many roll-outs of one mechanism: side by side in registers where its step has lanes (lane_step.hpp), blocks of them on
// threads. Each is to the last bit what it is alone.
#pragma once

#include "discrete/integrator.hpp"

namespace leastaction {

// Of each: how many steps it made, how many of them not side by side with others, and the status of the last.
struct OneOfMany {
    int steps = 0, alone = 0;
    StepStatus status = StepStatus::converged;
};

// From X[b, 0] under U[b] over the times t (N + 1): fills X (B, N + 1, nx) and lam (B, N, nc); what is behind a step that
// failed is left as it is.
std::vector<OneOfMany> roll_out_many(const Midpoint& integrator, int many, int steps, const double* t, const double* U,
                                     int threads, double* X, double* lam);

// A (B, N, ndx, ndx) and B (B, N, ndx, nu) of the steps of such roll-outs X under U. Returns the first of them, times N, and its
// step, at which there is none, or B N.
std::ptrdiff_t linearize_many(const Midpoint& integrator, int many, int steps, const double* t, const double* X,
                              const double* U, int threads, double* by_x, double* by_u);

}  // namespace leastaction
