// The rows of G = [A B] of small problems: in arrays of a fixed width, with zeros behind.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>

#include "optimal/linear_quadratic.hpp"

namespace leastaction {

// The most states and inputs together for which looking for sparse rows takes longer than to multiply by zeros.
constexpr std::ptrdiff_t small_problem = 16;

// Calls with a number that the compiler knows: the width of the rows of a problem that is small.
template <class With>
auto with_width(const LinearQuadraticProblem& problem, const With& with) {
    constexpr int half = small_problem / 2;
    return problem.nx + problem.nu <= half ? with(std::integral_constant<int, half>{})
                                           : with(std::integral_constant<int, 2 * half>{});
}

inline bool is_small(const LinearQuadraticProblem& problem) { return problem.nx + problem.nu <= small_problem; }

template <int width>
class SmallDynamics {
public:
    using Index = Eigen::Index;
    using Row = Eigen::Matrix<double, width, 1>;
    using Rows = std::array<Row, width>;

    explicit SmallDynamics(const LinearQuadraticProblem& problem) : problem_(problem) {
        rows_.fill(Row::Zero());
        const Index entries = problem.pattern == nullptr ? 0 : problem.nx * (problem.nx + problem.nu);
        all_ = std::all_of(problem.pattern, problem.pattern + entries, [](bool entry) { return entry; });
    }

    // Those of stage k; what the pattern leaves out may be anything.
    const Rows& read(Index k) {
        const Index nx = problem_.nx, nu = problem_.nu;
        const double *A = problem_.A + k * nx * nx, *B = problem_.B + k * nx * nu;
        for (Index i = 0; i < nx; ++i) {
            Row& row = rows_[i];
            std::copy_n(A + i * nx, nx, row.data());
            std::copy_n(B + i * nu, nu, row.data() + nx);
            if (all_) continue;
            const bool* entries = problem_.pattern + i * (nx + nu);
            for (Index j = 0; j < nx + nu; ++j) row[j] = entries[j] ? row[j] : 0.0;
        }
        return rows_;
    }

private:
    const LinearQuadraticProblem& problem_;
    bool all_;  // whether every entry is read
    Rows rows_;
};

}  // namespace leastaction
