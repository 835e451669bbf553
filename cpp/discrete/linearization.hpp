// First derivatives of every step of a trajectory, and from them contracted second ones. For the next state y of a step and
// th = (x, u)
//
//   A = dy/dx,   B = dy/du,   H = d2(w.y)/dth2 with weights w,
//
// exact, by the implicit function theorem (see newton_step.hpp). Arrays are row-major, time first, in the user's order of
// variables: X (N+1, nx), U (N, nu), lam (N, nc), times t (N+1).
#pragma once

#include <array>
#include <memory>
#include <mutex>
#include <vector>

#include "discrete/integrator.hpp"
#include "discrete/parameters.hpp"
#include "numerics/large_array.hpp"

namespace leastaction {

// Owns all that it needs, so that it stays what it is whatever becomes of the arrays that it was made from. Many threads may
// ask for curvatures at once, while none writes by along().
class Linearization {
public:
    // Of trajectories of so many steps. With `multipliers` those of a step count as further states of its end, which
    // nothing depends on: ny = ndx + nc states instead of ndx. States have nx numbers, their differences ndx: fewer where
    // rotations are quaternions.
    Linearization(std::shared_ptr<const Midpoint> integrator, int steps, bool multipliers);

    // Linearises along a trajectory, in the memory that there is. Returns the first step at which it is none, or N.
    // `ends` (N, nx): where its steps lead to, of a curve whose next states are others; null: to the next states.
    // Here and below forces at the instants act at the first one for `first_share` of its step. `by_time_step` (N, ny), if
    // it is not null: derivatives by the length of each step.
    int along(const double* t, const double* X, const double* U, double first_share, int threads,
              const double* ends = nullptr, double* by_time_step = nullptr);

    // The Hessians by (states, u) of the next states weighted with W (N, weights), weights = nx, or nx + nc with those of
    // the multipliers: (N, n, n), n = nx + nu, or ny + nu with rows and columns of zeros for the `multipliers`. In memory
    // that it gave away before, as soon as nobody holds that any more: large results that are made again and again need
    // not be mapped into memory each time, and keep their zeros.
    std::shared_ptr<const LargeArray> curvature(const double* W, int weights, bool multipliers, int threads) const;
    // The same as lower triangles, one row after the other, of those states and inputs alone that anything depends on:
    // (N, m (m + 1) / 2), a third of the memory and more.
    std::shared_ptr<const LargeArray> packed_curvature(const double* W, int weights, int threads) const;
    std::size_t packed_size() const { return order_.size() * (order_.size() + 1) / 2; }

    // All that it holds, for a copy elsewhere.
    std::array<LargeArray*, 6> memory() { return {&A, &B, &lam, &defect, &dt_, &records_}; }

    const std::shared_ptr<const Midpoint>& integrator() const { return integrator_; }
    const int steps, nx, ndx, nc, ny, nu;
    LargeArray A, B, lam;  // (N, ny, ny), (N, ny, nu), (N, nc)
    LargeArray defect;     // (N): distance of the dynamic configuration from that given

private:
    // Hessians, and whether their zeros are there.
    struct Hessians {
        LargeArray values;
        bool zeroed = false;
    };
    // Of so many numbers a step, in the memory of those that were given as the same `kind` of result.
    std::shared_ptr<Hessians> hessians(int kind, std::size_t size) const;
    // Calls write(second, k) with the Hessian of every step.
    template <class Write>
    void each_hessian(const double* W, int weights, int threads, const Write& write) const;
    // What one step leaves for the second order, but for what A and B hold: where it was, and the derivatives of the
    // multipliers and by shifts of the constraints.
    template <class Point, class First, class Carry>
    void carry(Point& point, First& first, const Carry& carry) const;

    std::shared_ptr<const Midpoint> integrator_;
    std::size_t record_size_;
    LargeArray dt_, records_;
    bool zeroed_ = false;                                // whether the zeros of A and B are there
    std::array<std::vector<SecondOrder::Run>, 2> runs_;  // into a Hessian without and with multipliers
    mutable std::mutex given_lock_;
    std::vector<int> order_;  // in a packed one
    // The last Hessians of each kind: without and with multipliers, packed.
    mutable std::array<std::array<std::shared_ptr<Hessians>, 2>, 3> given_;
};

// Derivatives of the next states (N, nx, P) and the multipliers (N, nc, P) of every step by parameters, the state and the
// input of the step held. Returns the first step at which the trajectory is not one, or N.
int differentiate_by_parameters(const Midpoint& integrator, int steps, const double* t, const double* X,
                                const double* U, const std::vector<Parameter>& parameters, double first_share,
                                int threads, double* by_x, double* by_lam);

// Second derivatives of the next states weighted with W (N, weights), as of Linearization::curvature, by (states, u, the
// length of the step): out (N, n, n), n = nx + nu + 1, and nc more with rows and columns of zeros for the `multipliers`.
// Returns the first step at which the trajectory is not one, or N.
int curvature_by_time_step(const Midpoint& integrator, int steps, const double* t, const double* X, const double* U,
                           const double* W, int weights, bool multipliers, double first_share, int threads,
                           double* out);

// The same by directions of the numbers of elements, none of gravity: rows (states, u, the directions) of each,
// out (N, P, nx + nu + P).
int curvature_by_numbers(const Midpoint& integrator, int steps, const double* t, const double* X, const double* U,
                         const double* W, int weights, const std::vector<Parameter>& directions, double first_share,
                         int threads, double* out);

}  // namespace leastaction
