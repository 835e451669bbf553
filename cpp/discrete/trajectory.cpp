#include "discrete/trajectory.hpp"

#include <algorithm>

#include "discrete/layout.hpp"

namespace leastaction {

namespace {

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

}  // namespace leastaction
