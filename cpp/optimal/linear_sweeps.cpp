// Sweeps of the linear dynamics: forward under a law, and the adjoint of the closed loop.

#include <Eigen/Core>
#include <algorithm>

#include "optimal/linear_quadratic.hpp"
#include "optimal/prefetch.hpp"
#include "optimal/small_dynamics.hpp"
#include "optimal/stage_structure.hpp"

namespace leastaction {

namespace {

using Eigen::Index;
using Eigen::VectorXd;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using ConstVector = Eigen::Map<const VectorXd>;
using ConstRows = Eigen::Map<const RowMajor>;

// The structure of all stages: what a pattern tells, or everything.
StageStructure structure_of(const LinearQuadraticProblem& problem) {
    StageStructure structure(problem.nx, problem.nu);
    if (problem.pattern != nullptr) {
        structure.follow(problem.pattern);
    } else {
        structure.everything();
    }
    return structure;
}

// Calls with_A(first, length) and with_B for the columns of A and B that a structure has.
template <class WithA, class WithB>
void each_block(const StageStructure& structure, Index nx, const WithA& with_A, const WithB& with_B) {
    for (const auto& run : structure.runs()) {
        const Index in_A = std::clamp(nx - run.first, Index{0}, run.length), in_B = run.length - in_A;
        if (in_A > 0) with_A(run.first, in_A);
        if (in_B > 0) with_B(run.first + in_A - nx, in_B);
    }
}

// Adds A'z and B'z of stage k, what the structure has of them.
template <class Vector>
void add_transposed(const LinearQuadraticProblem& problem, StageStructure& structure, Index k, const Vector& z,
                    Eigen::Ref<VectorXd> now, Eigen::Ref<VectorXd> input) {
    const Index nx = problem.nx, nu = problem.nu;
    const ConstRows A(problem.A + k * nx * nx, nx, nx), B(problem.B + k * nx * nu, nx, nu);
    structure.read_entries(A.data(), B.data());
    for (const auto& rows : structure.dense_runs()) {
        const auto z_rows = z.segment(rows.first, rows.length);
        each_block(
            structure, nx,
            [&](Index first, Index width) {
                now.segment(first, width).noalias() +=
                    A.block(rows.first, first, rows.length, width).transpose() * z_rows;
            },
            [&](Index first, Index width) {
                input.segment(first, width).noalias() +=
                    B.block(rows.first, first, rows.length, width).transpose() * z_rows;
            });
    }
    structure.each_entry([&](Index i, Index j, double value) { (j < nx ? now[j] : input[j - nx]) += value * z[i]; });
}

template <int width>
void small_forward(const LinearQuadraticProblem& problem, const double* K, const double* C, double* dx, double* du) {
    const Index nx = problem.nx, nu = problem.nu;
    SmallDynamics<width> dynamics(problem);
    typename SmallDynamics<width>::Row now = SmallDynamics<width>::Row::Zero();
    for (Index k = 0; k < problem.horizon; ++k, dx += nx, du += nu) {
        std::copy_n(dx, nx, now.data());
        for (Index u = 0; u < nu; ++u, ++C, K += nx) {
            double sum = -*C;
            for (Index j = 0; j < nx; ++j) sum -= K[j] * dx[j];
            now[nx + u] = du[u] = sum;
        }
        const auto& G = dynamics.read(k);
        for (Index i = 0; i < nx; ++i)
            dx[nx + i] = G[i].dot(now) + (problem.c != nullptr ? problem.c[k * nx + i] : 0.0);
    }
}

template <int width>
void small_adjoint(const LinearQuadraticProblem& problem, const double* K, double* z, double* h) {
    const Index nx = problem.nx, nu = problem.nu;
    SmallDynamics<width> dynamics(problem);
    typename SmallDynamics<width>::Row now;
    z += problem.horizon * nx;
    std::fill_n(z, nx, 0.0);
    if (problem.q_final != nullptr) std::copy_n(problem.q_final, nx, z);
    for (Index k = problem.horizon - 1; k >= 0; --k, z -= nx) {
        now.setZero();
        if (problem.q != nullptr) std::copy_n(problem.q + k * nx, nx, now.data());
        if (problem.r != nullptr) std::copy_n(problem.r + k * nu, nu, now.data() + nx);
        const auto& G = dynamics.read(k);
        for (Index i = 0; i < nx; ++i) now += z[i] * G[i];
        if (h != nullptr) std::copy_n(now.data() + nx, nu, h + k * nu);
        for (Index u = 0; u < nu; ++u) {
            const double* row = K + (k * nu + u) * nx;
            for (Index j = 0; j < nx; ++j) now[j] -= now[nx + u] * row[j];
        }
        std::copy_n(now.data(), nx, z - nx);
    }
}

}  // namespace

void sweep_forward(const LinearQuadraticProblem& problem, const double* K, const double* C, double* dx, double* du) {
    if (is_small(problem)) {
        return with_width(problem, [&](auto width) { small_forward<width>(problem, K, C, dx, du); });
    }
    const Index nx = problem.nx;
    const Index nu = problem.nu;
    StageStructure structure = structure_of(problem);
    Prefetch soon_A(nx * nx), soon_B(nx * nu), soon_K(nx * nu);
    need_dynamics(structure, nx, nu, soon_A, soon_B);
    constexpr Index few = 8;  // rows between which memory is asked for
    Index parts = nu / few + 1;
    for (const auto& rows : structure.dense_runs()) parts += rows.length / few + 1;
    const auto ask = [&] {
        for (Prefetch* part : {&soon_A, &soon_B, &soon_K}) part->ask(parts);
    };
    for (Index k = 0; k < problem.horizon; ++k) {
        const bool last = k + 1 == problem.horizon;
        soon_A.aim(last ? nullptr : problem.A + (k + 1) * nx * nx);
        soon_B.aim(last ? nullptr : problem.B + (k + 1) * nx * nu);
        soon_K.aim(last ? nullptr : K + (k + 1) * nx * nu);
        const ConstRows A(problem.A + k * nx * nx, nx, nx), B(problem.B + k * nx * nu, nx, nu),
            K_k(K + k * nu * nx, nu, nx);
        const ConstVector x(dx + k * nx, nx);
        Eigen::Map<VectorXd> u(du + k * nu, nu);
        Eigen::Map<VectorXd> next(dx + (k + 1) * nx, nx);
        u = -ConstVector(C + k * nu, nu);
        for (Index i = 0; i < nu; i += few) {
            const Index length = std::min(few, nu - i);
            u.segment(i, length).noalias() -= K_k.middleRows(i, length) * x;
            ask();
        }
        next.setZero();
        if (problem.c != nullptr) next = ConstVector(problem.c + k * nx, nx);
        structure.read_entries(A.data(), B.data());
        for (const auto& rows : structure.dense_runs()) {
            for (Index i = rows.first; i < rows.first + rows.length; i += few) {
                const Index length = std::min(few, rows.first + rows.length - i);
                auto to = next.segment(i, length);
                each_block(
                    structure, nx,
                    [&](Index first, Index width) {
                        to.noalias() += A.block(i, first, length, width) * x.segment(first, width);
                    },
                    [&](Index first, Index width) {
                        to.noalias() += B.block(i, first, length, width) * u.segment(first, width);
                    });
                ask();
            }
        }
        structure.each_entry([&](Index i, Index j, double value) { next[i] += value * (j < nx ? x[j] : u[j - nx]); });
    }
}

void sweep_adjoint(const LinearQuadraticProblem& problem, const double* K, double* z, double* h) {
    if (is_small(problem)) return with_width(problem, [&](auto width) { small_adjoint<width>(problem, K, z, h); });
    const Index nx = problem.nx;
    const Index nu = problem.nu;
    VectorXd input(nu);
    StageStructure structure = structure_of(problem);
    Eigen::Map<VectorXd> last(z + problem.horizon * nx, nx);
    last.setZero();
    if (problem.q_final != nullptr) last = ConstVector(problem.q_final, nx);
    for (Index k = problem.horizon - 1; k >= 0; --k) {
        const ConstVector next(z + (k + 1) * nx, nx);
        Eigen::Map<VectorXd> now(z + k * nx, nx);
        now.setZero();
        if (problem.q != nullptr) now = ConstVector(problem.q + k * nx, nx);
        input.setZero();
        if (problem.r != nullptr) input = ConstVector(problem.r + k * nu, nu);
        add_transposed(problem, structure, k, next, now, input);
        if (h != nullptr) std::copy_n(input.data(), nu, h + k * nu);
        now.noalias() -= ConstRows(K + k * nu * nx, nu, nx).transpose() * input;
    }
}

void sweep_drift(const LinearQuadraticProblem& problem, const double* K, const double* P, const double* L, double* C) {
    const Index nx = problem.nx, nu = problem.nu;
    StageStructure structure = structure_of(problem);
    VectorXd b = VectorXd::Zero(nx), shifted(nx), input(nu);
    for (Index k = problem.horizon - 1; k >= 0; --k) {
        // P is symmetric: as it stands, by columns.
        const Eigen::Map<const Eigen::MatrixXd> P_next(P + (k + 1) * nx * nx, nx, nx);
        shifted = b;
        shifted.noalias() += P_next * ConstVector(problem.c + k * nx, nx);
        b.setZero();
        input.setZero();
        add_transposed(problem, structure, k, shifted, b, input);
        b.noalias() -= ConstRows(K + k * nu * nx, nu, nx).transpose() * input;
        const auto factor = ConstRows(L + k * nu * nu, nu, nu).triangularView<Eigen::Lower>();
        factor.solveInPlace(input);
        factor.transpose().solveInPlace(input);
        Eigen::Map<VectorXd>(C + k * nu, nu) = input;
    }
}

}  // namespace leastaction
