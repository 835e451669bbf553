#include "trajectory.hpp"

#include <algorithm>
#include <atomic>
#include <cstring>

#include "parallel.hpp"

namespace leastaction {

namespace {

// Offsets of the parts of state, input and th = [q1 | p1 | u | rho2].
struct Layout {
    explicit Layout(const Mechanism& m)
        : m(m),
          nd(m.n_dynamic),
          nk(m.n_kinematic),
          nq(nd + nk),
          ni(m.n_inputs),
          nx(2 * nq),
          nu(ni + nk),
          nc(m.n_constraints()),
          theta(nq + nd + nu) {}
    const Mechanism& m;
    int nd, nk, nq, ni, nx, nu, nc, theta;

    void start(const double* x, const double* u, MidpointStep& step) const {
        for (int i = 0; i < nq; ++i) step.q1[i] = x[m.external[i]];
        for (int i = 0; i < nd; ++i) step.p1[i] = x[nq + m.external[i]];
        input(u, step);
    }
    void input(const double* u, MidpointStep& step) const {
        std::copy(u, u + ni, step.u.begin());
        std::copy(u + ni, u + nu, step.q2.begin() + nd);
    }
    void state(const MidpointStep& step, double dt, double* x) const {
        for (int i = 0; i < nd; ++i) {
            x[m.external[i]] = step.q2[i];
            x[nq + m.external[i]] = step.p2[i];
        }
        for (int i = nd; i < nq; ++i) {
            x[i] = step.q2[i];
            x[nq + i] = (step.q2[i] - step.q1[i]) / dt;
        }
    }
    // One row over th, internal order, into rows over x and u, user's order.
    void scatter(const double* row, double* by_x, double* by_u) const {
        if (m.same_order) {
            std::copy(row, row + nq + nd, by_x);
        } else {
            for (int i = 0; i < nq; ++i) by_x[m.external[i]] = row[i];
            for (int i = 0; i < nd; ++i) by_x[nq + m.external[i]] = row[nq + i];
        }
        std::fill(by_x + nq + nd, by_x + nx, 0.0);
        std::copy(row + nq + nd, row + theta, by_u);
    }
    void gather(const double* by_x, const double* by_u, double* row) const {
        for (int i = 0; i < nq; ++i) row[i] = by_x[m.external[i]];
        for (int i = 0; i < nd; ++i) row[nq + i] = by_x[nq + m.external[i]];
        std::copy(by_u, by_u + nu, row + nq + nd);
    }
};

}  // namespace

RollOut roll_out(MidpointStep& step, int steps, const double* t, const double* xbar, const double* ubar, const double* K,
                 const double* velocity, double* X, double* U, double* lam) {
    const Layout at(step.mechanism());
    RollOut out;
    // Dynamic velocities and multipliers of the last steps, the newest first, to extrapolate from.
    std::vector<double> v(at.nd, 0.0), v1(at.nd, 0.0), v2(at.nd, 0.0), lam1(at.nc, 0.0), lam2(at.nc, 0.0);
    if (velocity)
        for (int i = 0; i < at.nd; ++i) v[i] = velocity[at.m.external[i]];
    std::vector<double> deviation(at.nx);
    std::fill(step.lam.begin(), step.lam.end(), 0.0);
    for (int k = 0; k < steps; ++k) {
        const double* x = X + static_cast<std::size_t>(k) * at.nx;
        double* u = U + static_cast<std::size_t>(k) * at.nu;
        std::copy(ubar + static_cast<std::size_t>(k) * at.nu, ubar + static_cast<std::size_t>(k + 1) * at.nu, u);
        if (K) {
            const double* K_k = K + static_cast<std::size_t>(k) * at.nu * at.nx;
            for (int i = 0; i < at.nx; ++i) deviation[i] = x[i] - xbar[static_cast<std::size_t>(k) * at.nx + i];
            Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>> gain(K_k, at.nu,
                                                                                                      at.nx);
            Eigen::Map<Eigen::VectorXd> input(u, at.nu);
            input.noalias() -= gain * Eigen::Map<const Eigen::VectorXd>(deviation.data(), at.nx);
        }
        const double dt = t[k + 1] - t[k];
        if (k == 0) {
            at.start(x, u, step);
            step.place_start();
        } else {
            at.input(u, step);
        }
        // Guess: velocities and multipliers go on as the parabola through their last values does.
        const double c1 = k >= 3 ? 3.0 : k == 2 ? 2.0 : 1.0, c2 = k >= 3 ? -3.0 : k == 2 ? -1.0 : 0.0, c3 = k >= 3 ? 1.0 : 0.0;
        for (int i = 0; i < at.nd; ++i) step.q2[i] = step.q1[i] + dt * (c1 * v[i] + c2 * v1[i] + c3 * v2[i]);
        for (int c = 0; c < at.nc; ++c) {
            const double newest = step.lam[c];
            step.lam[c] = c1 * newest + c2 * lam1[c] + c3 * lam2[c];
            lam2[c] = lam1[c];
            lam1[c] = newest;
        }
        const StepReport report = step.solve(dt);
        out.iterations += report.iterations;
        out.factorizations += report.factorizations;
        out.rank_deficient = out.rank_deficient || report.rank_deficient;
        if (report.status != StepStatus::converged) {
            out.failure = report;
            return out;
        }
        at.state(step, dt, X + static_cast<std::size_t>(k + 1) * at.nx);
        std::copy(step.lam.begin(), step.lam.end(), lam + static_cast<std::size_t>(k) * at.nc);
        v2.swap(v1);
        v1.swap(v);
        for (int i = 0; i < at.nd; ++i) v[i] = (step.q2[i] - step.q1[i]) / dt;
        step.advance();
        out.steps = k + 1;
    }
    return out;
}

int linearize(const std::shared_ptr<const Mechanism>& mechanism, const MidpointSettings& settings, int steps,
              const double* t, const double* X, const double* U, int threads, double* A, double* B, double* lam,
              double* lam_x, double* lam_u, double* memo) {
    const Layout at(*mechanism);
    const StepMemo sizes(*mechanism);
    std::atomic<int> first_failure{steps};
    parallel_ranges(steps, threads, [&](int begin, int end) {
        MidpointStep step(mechanism, settings);
        std::vector<double> unused_x(at.nx), unused_u(at.nu);
        for (int k = begin; k < end; ++k) {
            const double dt = t[k + 1] - t[k];
            const double* next = X + static_cast<std::size_t>(k + 1) * at.nx;
            at.start(X + static_cast<std::size_t>(k) * at.nx, U + static_cast<std::size_t>(k) * at.nu, step);
            for (int i = 0; i < at.nd; ++i) step.q2[i] = next[at.m.external[i]];
            step.place_start();
            if (step.solve(dt, true).status != StepStatus::converged || !step.differentiate(dt)) {
                int seen = first_failure.load();
                while (k < seen && !first_failure.compare_exchange_weak(seen, k)) {
                }
                return;
            }
            const int ld = step.ld();
            double* A_k = A + static_cast<std::size_t>(k) * at.nx * at.nx;
            double* B_k = B + static_cast<std::size_t>(k) * at.nx * at.nu;
            for (int i = 0; i < at.nd; ++i) {
                const int row = at.m.external[i];
                at.scatter(&step.Y[i * ld], A_k + row * at.nx, B_k + row * at.nu);
                at.scatter(&step.P2[i * ld], A_k + (at.nq + row) * at.nx, B_k + (at.nq + row) * at.nu);
            }
            for (int i = at.nd; i < at.nq; ++i) {
                std::fill(A_k + i * at.nx, A_k + (i + 1) * at.nx, 0.0);
                std::fill(B_k + i * at.nu, B_k + (i + 1) * at.nu, 0.0);
                B_k[i * at.nu + at.ni + i - at.nd] = 1.0;
                const int v = at.nq + i;
                std::fill(A_k + v * at.nx, A_k + (v + 1) * at.nx, 0.0);
                std::fill(B_k + v * at.nu, B_k + (v + 1) * at.nu, 0.0);
                A_k[v * at.nx + i] = -1.0 / dt;
                B_k[v * at.nu + at.ni + i - at.nd] = 1.0 / dt;
            }
            std::copy(step.lam.begin(), step.lam.end(), lam + static_cast<std::size_t>(k) * at.nc);
            if (lam_x)
                for (int c = 0; c < at.nc; ++c)
                    at.scatter(&step.Y[(at.nd + c) * ld], lam_x + (static_cast<std::size_t>(k) * at.nc + c) * at.nx,
                               lam_u + (static_cast<std::size_t>(k) * at.nc + c) * at.nu);
            // lam | d lam/d th | d(q2; lam)/dh | dp2/dh
            double* m = memo + k * sizes.size();
            m = std::copy(step.lam.begin(), step.lam.end(), m);
            for (int c = 0; c < at.nc; ++c) {
                const double* row = &step.Y[(at.nd + c) * ld];
                m = std::copy(row, row + at.theta, m);
            }
            for (int i = 0; i < at.nd + at.nc; ++i) m = std::copy_n(&step.Y[i * ld + at.theta], at.nc, m);
            for (int i = 0; i < at.nd; ++i) m = std::copy_n(&step.P2[i * ld + at.theta], at.nc, m);
        }
    });
    return first_failure.load();
}

void curvatures(const std::shared_ptr<const Mechanism>& mechanism, const MidpointSettings& settings, int steps,
                const double* t, const double* X, const double* U, const double* A, const double* B,
                const double* memo, const double* W, const double* W_lam, int threads, double* H) {
    const Layout at(*mechanism);
    const StepMemo sizes(*mechanism);
    const int nz = at.nx + at.nu;
    parallel_ranges(steps, threads, [&](int begin, int end) {
        MidpointStep step(mechanism, settings);
        std::vector<double> w_q(at.nd, 0.0), w_p(at.nd, 0.0), w_lam(at.nc, 0.0);
        for (int k = begin; k < end; ++k) {
            const double* next = X + static_cast<std::size_t>(k + 1) * at.nx;
            at.start(X + static_cast<std::size_t>(k) * at.nx, U + static_cast<std::size_t>(k) * at.nu, step);
            for (int i = 0; i < at.nd; ++i) step.q2[i] = next[at.m.external[i]];
            const int ld = step.ld();
            const double* A_k = A + static_cast<std::size_t>(k) * at.nx * at.nx;
            const double* B_k = B + static_cast<std::size_t>(k) * at.nx * at.nu;
            for (int i = 0; i < at.nd; ++i) {
                const int row = at.m.external[i];
                at.gather(A_k + row * at.nx, B_k + row * at.nu, &step.Y[i * ld]);
                at.gather(A_k + (at.nq + row) * at.nx, B_k + (at.nq + row) * at.nu, &step.P2[i * ld]);
            }
            const double* m = memo + k * sizes.size();
            const auto take = [&m](int n, double* to) {
                std::copy(m, m + n, to);
                m += n;
            };
            take(at.nc, step.lam.data());
            for (int c = 0; c < at.nc; ++c) take(at.theta, &step.Y[(at.nd + c) * ld]);
            for (int i = 0; i < at.nd + at.nc; ++i) take(at.nc, &step.Y[i * ld + at.theta]);
            for (int i = 0; i < at.nd; ++i) take(at.nc, &step.P2[i * ld + at.theta]);
            if (W)
                for (int i = 0; i < at.nd; ++i) {
                    w_q[i] = W[static_cast<std::size_t>(k) * at.nx + at.m.external[i]];
                    w_p[i] = W[static_cast<std::size_t>(k) * at.nx + at.nq + at.m.external[i]];
                }
            if (W_lam) std::copy_n(W_lam + static_cast<std::size_t>(k) * at.nc, at.nc, w_lam.begin());
            step.curvature(t[k + 1] - t[k], w_q.data(), w_p.data(), w_lam.data());

            double* H_k = H + static_cast<std::size_t>(k) * nz * nz;
            const auto row_of = [&](int i) {  // th -> (x, u)
                if (i < at.nq) return at.m.external[i];
                if (i < at.nq + at.nd) return at.nq + at.m.external[i - at.nq];
                return at.nx + i - at.nq - at.nd;
            };
            for (int i = 0; i < at.theta; ++i) {
                double* row = H_k + static_cast<std::size_t>(row_of(i)) * nz;
                at.scatter(&step.H[static_cast<std::size_t>(i) * at.theta], row, row + at.nx);
            }
            std::fill(H_k + static_cast<std::size_t>(at.nq + at.nd) * nz, H_k + static_cast<std::size_t>(at.nx) * nz, 0.0);
        }
    });
}

}  // namespace leastaction
