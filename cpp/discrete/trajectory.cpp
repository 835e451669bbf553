#include "discrete/trajectory.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>

#include "numerics/parallel.hpp"

namespace leastaction {

namespace {

// Offsets of the parts of state, input and th = [q1 | p1 | u | rho2].
struct Layout {
    explicit Layout(const Mechanism& m, bool with_multipliers = false)
        : m(m),
          nd(m.n_dynamic),
          nk(m.n_kinematic),
          nq(nd + nk),
          ni(m.n_inputs),
          nx(2 * nq),
          nu(ni + nk),
          nc(m.n_constraints()),
          ny(nx + (with_multipliers ? nc : 0)),
          theta(nq + nd + nu) {}
    const Mechanism& m;
    int nd, nk, nq, ni, nx, nu, nc;
    int ny;  // states, and the multipliers of the last step where they count as states
    int theta;

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
    // The derivatives of a step whose end is known; false where it is no step of the mechanism.
    bool differentiate(MidpointStep& step, const double* x, const double* u, const double* next, double dt) const {
        start(x, u, step);
        for (int i = 0; i < nd; ++i) step.q2[i] = next[m.external[i]];
        std::fill(step.lam.begin(), step.lam.end(), 0.0);  // so that no result depends on the range it is in
        step.place_start();
        return step.solve(dt, true).status == StepStatus::converged && step.differentiate(dt);
    }
    // One row over th, internal order, into rows over the states and u, user's order. Nothing depends on the velocities of
    // the prescribed variables and the multipliers: their columns are zero, and left alone where they are so already.
    void scatter(const double* row, double* by_x, double* by_u, bool zeroed) const {
        if (m.same_order) {
            std::copy(row, row + nq + nd, by_x);
        } else {
            for (int i = 0; i < nq; ++i) by_x[m.external[i]] = row[i];
            for (int i = 0; i < nd; ++i) by_x[nq + m.external[i]] = row[nq + i];
        }
        if (!zeroed) std::fill(by_x + nq + nd, by_x + ny, 0.0);
        std::copy(row + nq + nd, row + theta, by_u);
    }
    // The same for all of th: which entries stand where among the states and inputs.
    std::vector<MidpointStep::Run> runs() const {
        std::vector<MidpointStep::Run> out;
        const auto add = [&](int first, int to) {
            if (!out.empty() && out.back().position + out.back().length == to)
                ++out.back().length;
            else
                out.push_back({first, 1, to});
        };
        for (int i = 0; i < nq; ++i) add(i, m.external[i]);
        for (int i = 0; i < nd; ++i) add(nq + i, nq + m.external[i]);
        for (int i = 0; i < nu; ++i) add(nq + nd + i, ny + i);
        return out;
    }
    void gather(const double* by_x, const double* by_u, double* row) const {
        if (m.same_order) {
            std::copy(by_x, by_x + nq + nd, row);
        } else {
            for (int i = 0; i < nq; ++i) row[i] = by_x[m.external[i]];
            for (int i = 0; i < nd; ++i) row[nq + i] = by_x[nq + m.external[i]];
        }
        std::copy(by_u, by_u + nu, row + nq + nd);
    }
};

void note_failure(std::atomic<int>& first, int k) {
    int seen = first.load();
    while (k < seen && !first.compare_exchange_weak(seen, k)) {
    }
}

// Solves a step from the best guess that there is: velocities and multipliers go on as the parabola through their last
// values does. Where that leads nowhere, because the motion changes too fast, from the last velocity, then from rest.
StepReport step_from_guesses(MidpointStep& step, double dt, int k, const std::vector<double>& v,
                             const std::vector<double>& v1, const std::vector<double>& v2, std::vector<double>& newest,
                             std::vector<double>& lam1, std::vector<double>& lam2) {
    const double weights[3][3] = {{3, -3, 1}, {1, 0, 0}, {0, 0, 0}};
    const double line[3] = {2, -1, 0};
    newest = step.lam;
    StepReport report;
    long iterations = 0, factorizations = 0;
    for (int attempt = k >= 2 ? 0 : 1; attempt < 3; ++attempt) {
        const double* c = attempt == 0 && k == 2 ? line : weights[attempt];
        for (std::size_t i = 0; i < v.size(); ++i)
            step.q2[i] = step.q1[i] + dt * (c[0] * v[i] + c[1] * v1[i] + c[2] * v2[i]);
        for (std::size_t i = 0; i < newest.size(); ++i)
            step.lam[i] = c[0] * newest[i] + c[1] * lam1[i] + c[2] * lam2[i];
        report = step.solve(dt);
        iterations += report.iterations;
        factorizations += report.factorizations;
        if (report.status == StepStatus::converged) break;
    }
    report.iterations = static_cast<int>(iterations);
    report.factorizations = static_cast<int>(factorizations);
    lam2.swap(lam1);
    lam1.swap(newest);
    return report;
}

}  // namespace

RollOut roll_out(MidpointStep& step, int steps, const double* t, const double* xbar, const double* ubar,
                 const double* K, const double* velocity, double* X, double* U, double* lam) {
    const Layout at(step.mechanism());
    RollOut out;
    // Dynamic velocities and multipliers of the last steps, the newest first, to extrapolate from.
    std::vector<double> v(at.nd, 0.0), v1(at.nd, 0.0), v2(at.nd, 0.0), newest(at.nc, 0.0), lam1(at.nc, 0.0),
        lam2(at.nc, 0.0);
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
        const StepReport report = step_from_guesses(step, dt, k, v, v1, v2, newest, lam1, lam2);
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
              const double* t, const double* X, const double* U, bool multipliers, int threads, double* A, double* B,
              double* lam, double* memo, double* defect, bool zeroed) {
    const Layout at(*mechanism, multipliers);
    const StepMemo sizes(*mechanism);
    std::atomic<int> first_failure{steps};
    parallel_ranges(steps, threads, [&](int begin, int end) {
        MidpointStep step(mechanism, settings);
        for (int k = begin; k < end; ++k) {
            const double dt = t[k + 1] - t[k];
            const double* next = X + static_cast<std::size_t>(k + 1) * at.nx;
            if (!at.differentiate(step, X + static_cast<std::size_t>(k) * at.nx,
                                  U + static_cast<std::size_t>(k) * at.nu, next, dt)) {
                note_failure(first_failure, k);
                return;
            }
            defect[k] = 0;
            for (int i = 0; i < at.nd; ++i)
                defect[k] = std::max(defect[k], std::abs(step.q2[i] - next[at.m.external[i]]));
            const int ld = step.ld();
            double* A_k = A + static_cast<std::size_t>(k) * at.ny * at.ny;
            double* B_k = B + static_cast<std::size_t>(k) * at.ny * at.nu;
            for (int i = 0; i < at.nd; ++i) {
                const int row = at.m.external[i];
                at.scatter(&step.Y[i * ld], A_k + row * at.ny, B_k + row * at.nu, zeroed);
                at.scatter(&step.P2[i * ld], A_k + (at.nq + row) * at.ny, B_k + (at.nq + row) * at.nu, zeroed);
            }
            for (int i = at.nd; i < at.nq; ++i) {
                const int v = at.nq + i, input = at.ni + i - at.nd;
                for (const int row : {i, v}) {
                    if (zeroed) break;
                    std::fill(A_k + row * at.ny, A_k + (row + 1) * at.ny, 0.0);
                    std::fill(B_k + row * at.nu, B_k + (row + 1) * at.nu, 0.0);
                }
                B_k[i * at.nu + input] = 1.0;
                A_k[v * at.ny + i] = -1.0 / dt;
                B_k[v * at.nu + input] = 1.0 / dt;
            }
            for (int row = at.nx; row < at.ny; ++row)
                at.scatter(&step.Y[(at.nd + row - at.nx) * ld], A_k + row * at.ny, B_k + row * at.nu, zeroed);
            std::copy(step.lam.begin(), step.lam.end(), lam + static_cast<std::size_t>(k) * at.nc);
            // lam | d lam/d th | d(q2; lam)/dh | dp2/dh
            double* m = memo + k * sizes.size();
            m = std::copy(step.lam.begin(), step.lam.end(), m);
            for (int c = 0; c < at.nc; ++c) {
                const double* row = &step.Y[(at.nd + c) * ld];
                m = std::copy(row, row + at.theta, m);
            }
            for (int i = 0; i < at.nd + at.nc; ++i) m = std::copy_n(step.Y.data() + i * ld + at.theta, at.nc, m);
            for (int i = 0; i < at.nd; ++i) m = std::copy_n(step.P2.data() + i * ld + at.theta, at.nc, m);
        }
    });
    return first_failure.load();
}

int differentiate_by_parameters(const std::shared_ptr<const Mechanism>& mechanism, const MidpointSettings& settings,
                                int steps, const double* t, const double* X, const double* U,
                                const std::vector<Parameter>& parameters, int threads, double* by_x, double* by_lam) {
    const Layout at(*mechanism);
    const std::size_t count = parameters.size();
    std::atomic<int> first_failure{steps};
    parallel_ranges(steps, threads, [&](int begin, int end) {
        MidpointStep step(mechanism, settings);
        for (int k = begin; k < end; ++k) {
            const double dt = t[k + 1] - t[k];
            if (!at.differentiate(step, X + static_cast<std::size_t>(k) * at.nx,
                                  U + static_cast<std::size_t>(k) * at.nu, X + static_cast<std::size_t>(k + 1) * at.nx,
                                  dt)) {
                note_failure(first_failure, k);
                return;
            }
            step.differentiate_by(dt, parameters);
            const int ld = step.ld_parameters();
            double *x = by_x + k * at.nx * count, *lam = by_lam + k * at.nc * count;
            std::fill_n(x, at.nx * count, 0.0);
            for (int i = 0; i < at.nd; ++i) {
                const int row = at.m.external[i];
                std::copy_n(&step.Y_parameters[i * ld], count, x + row * count);
                std::copy_n(&step.P2_parameters[i * ld], count, x + (at.nq + row) * count);
            }
            for (int c = 0; c < at.nc; ++c) std::copy_n(&step.Y_parameters[(at.nd + c) * ld], count, lam + c * count);
        }
    });
    return first_failure.load();
}

void curvatures(const std::shared_ptr<const Mechanism>& mechanism, const MidpointSettings& settings, int steps,
                const double* t, const double* X, const double* U, bool multipliers, const double* A, const double* B,
                const double* memo, const double* W, int threads, double* H, bool zeroed) {
    const Layout at(*mechanism, multipliers);
    const StepMemo sizes(*mechanism);
    const int nz = at.ny + at.nu;
    const std::vector<MidpointStep::Run> runs = at.runs();
    parallel_ranges(steps, threads, [&](int begin, int end) {
        MidpointStep step(mechanism, settings);
        step.reserve_derivatives();
        std::vector<double> w_q(at.nd), w_p(at.nd), w_lam(at.nc, 0.0);
        for (int k = begin; k < end; ++k) {
            const double* next = X + static_cast<std::size_t>(k + 1) * at.nx;
            at.start(X + static_cast<std::size_t>(k) * at.nx, U + static_cast<std::size_t>(k) * at.nu, step);
            for (int i = 0; i < at.nd; ++i) step.q2[i] = next[at.m.external[i]];
            const int ld = step.ld();
            const double* A_k = A + static_cast<std::size_t>(k) * at.ny * at.ny;
            const double* B_k = B + static_cast<std::size_t>(k) * at.ny * at.nu;
            for (int i = 0; i < at.nd; ++i) {
                const int row = at.m.external[i];
                at.gather(A_k + row * at.ny, B_k + row * at.nu, &step.Y[i * ld]);
                for (int j = 0; j < at.nd; ++j)  // of P2 only the columns of p1 are asked for
                    step.P2[i * ld + at.nq + j] = A_k[(at.nq + row) * at.ny + at.nq + at.m.external[j]];
            }
            const double* m = memo + k * sizes.size();
            const auto take = [&m](int n, double* to) {
                std::copy(m, m + n, to);
                m += n;
            };
            take(at.nc, step.lam.data());
            for (int c = 0; c < at.nc; ++c) take(at.theta, &step.Y[(at.nd + c) * ld]);
            for (int i = 0; i < at.nd + at.nc; ++i) take(at.nc, step.Y.data() + i * ld + at.theta);
            for (int i = 0; i < at.nd; ++i) take(at.nc, step.P2.data() + i * ld + at.theta);
            const double* W_k = W + static_cast<std::size_t>(k) * at.ny;
            for (int i = 0; i < at.nd; ++i) {
                w_q[i] = W_k[at.m.external[i]];
                w_p[i] = W_k[at.nq + at.m.external[i]];
            }
            std::copy(W_k + at.nx, W_k + at.ny, w_lam.begin());
            double* H_k = H + static_cast<std::size_t>(k) * nz * nz;
            if (!zeroed) std::fill(H_k, H_k + static_cast<std::size_t>(nz) * nz, 0.0);
            step.curvature(t[k + 1] - t[k], w_q.data(), w_p.data(), w_lam.data(), runs, H_k, nz);
        }
    });
}

}  // namespace leastaction
