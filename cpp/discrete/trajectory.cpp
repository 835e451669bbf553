#include "discrete/trajectory.hpp"

#include <algorithm>

#include "discrete/energy.hpp"
#include "discrete/layout.hpp"
#include "numerics/parallel.hpp"

namespace leastaction {

namespace {

constexpr int steps_between_polls = 16;

// Guesses of the next dynamic velocities and multipliers. Those of the last steps go on as the parabola through them does;
// where a reference motion is known, what goes on is the deviation of the velocities from its, if that foretold the last
// step better.
class Extrapolation {
public:
    explicit Extrapolation(const Layout& at) : velocity_(at.nd), deviation_(at.nd), multipliers_(at.nc) {}

    // Guesses of a step from q1, with the reference's velocity over it, or null.
    void guess(MidpointStep& step, double dt, const double* reference) {
        velocity_.extrapolate();
        deviation_.extrapolate();
        multipliers_.extrapolate();
        const bool by_reference = reference && deviation_.count > 0 && deviation_.error <= velocity_.error;
        for (std::size_t i = 0; i < velocity_.next.size(); ++i)
            step.q2[i] = step.q1[i] + dt * (by_reference ? reference[i] + deviation_.next[i] : velocity_.next[i]);
        step.lam = multipliers_.next;
    }
    void take(const MidpointStep& step, double dt, const double* reference) {
        for (std::size_t i = 0; i < velocity_.next.size(); ++i) {
            const double v = (step.q2[i] - step.q1[i]) / dt;
            velocity_.newest()[i] = v;
            if (reference) deviation_.newest()[i] = v - reference[i];
        }
        multipliers_.newest() = step.lam;
        velocity_.note();
        deviation_.note();
        multipliers_.note();
    }

private:
    struct Series {
        explicit Series(std::size_t n) : next(n), values{next, next, next} {}
        std::vector<double> next, values[3];  // the newest first
        int count = 0;
        double error = 0;  // of the last guess

        std::vector<double>& newest() { return values[2]; }  // to be filled before note()
        void note() {
            error = 0;
            for (std::size_t i = 0; i < next.size(); ++i) {
                const double d = next[i] - values[2][i];
                error += d * d;
            }
            values[2].swap(values[1]);
            values[1].swap(values[0]);
            count = std::min(count + 1, 3);
        }
        void extrapolate() {
            constexpr double weights[4][3] = {{0, 0, 0}, {1, 0, 0}, {2, -1, 0}, {3, -3, 1}};
            const double* c = weights[count];
            for (std::size_t i = 0; i < next.size(); ++i)
                next[i] = c[0] * values[0][i] + c[1] * values[1][i] + c[2] * values[2][i];
        }
    };
    Series velocity_, deviation_, multipliers_;
};

// How coarse a step is, to find the worst: far moves, and determinants towards a fold. Of steps that were not followed s is
// not known, and near 1.
double coarseness(double s, double turn) { return (s > 1.0 ? s : 1.0) * (1.0 + turn); }

// Whether a step is coarser than the worst so far.
bool is_worse(const WorstStep& worst, double s, double turn) {
    return worst.k < 0 || coarseness(s, turn) >= coarseness(worst.s, worst.angle);
}

// s of the worst step from x to `end`, where it is not known yet.
void judge_worst(MidpointStep& step, const Layout& at, double t, double dt, double share, const double* x,
                 const double* u, const double* end, WorstStep& worst) {
    if (worst.k < 0 || !std::isnan(worst.s)) return;
    at.start(x, u, t, share, step);
    step.place_start();
    if (!step.guess_limit(dt)) return;
    at.finish(step, end, true);
    worst.s = step.judge(dt);
}

}  // namespace

RollOut roll_out(MidpointStep& step, int steps, const double* t, const double* xbar, const double* ubar,
                 const double* K, double first_share, double* X, double* U, double* lam, double* energies,
                 Interruption* interruption) {
    const Layout at(step.mechanism());
    RollOut out;
    EnergyRows noted;
    Extrapolation series(at);
    std::vector<double> deviation(at.ndx), reference(at.nd);
    const auto note_worst = [&](int k, double s) {
        const int most = step.most_turned();
        out.worst = {k, s, step.largest_turn(), most < 0 ? -1 : at.m.external[most]};
    };
    for (int k = 0; k < steps; ++k) {
        const double* x = X + static_cast<std::size_t>(k) * at.nx;
        double* u = U + static_cast<std::size_t>(k) * at.nu;
        const double* xbar_k = xbar ? xbar + static_cast<std::size_t>(k) * at.nx : nullptr;
        std::copy(ubar + static_cast<std::size_t>(k) * at.nu, ubar + static_cast<std::size_t>(k + 1) * at.nu, u);
        if (K) {
            const double* K_k = K + static_cast<std::size_t>(k) * at.nu * at.ndx;
            at.difference(x, xbar_k, deviation.data());
            Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>> gain(K_k, at.nu,
                                                                                                          at.ndx);
            Eigen::Map<Eigen::VectorXd> input(u, at.nu);
            input.noalias() -= gain * Eigen::Map<const Eigen::VectorXd>(deviation.data(), at.ndx);
        }
        const double dt = t[k + 1] - t[k], share = at.share(k, dt, first_share);
        if (xbar) at.velocity(xbar_k, dt, reference.data());
        if (k == 0) {
            at.start(x, u, t[k], share, step);
            step.place_start();
            if (!step.guess_limit(dt)) at.start(x, u, t[k], share, step);
        } else {
            step.t = t[k];
            at.input(u, step);
            step.kick(share);
            series.guess(step, dt, xbar ? reference.data() : nullptr);
        }
        if (interruption && k % steps_between_polls == 0 && k > 0 && interruption->poll()) {
            out.interrupted = true;
            break;
        }
        StepReport report;
        try {
            report = step.find(dt);
        } catch (...) {
            if (!interruption || !interruption->caught()) throw;
            out.interrupted = true;
            break;
        }
        out.iterations += report.iterations;
        out.factorizations += report.factorizations;
        out.rank_deficient = out.rank_deficient || report.rank_deficient;
        out.followed += report.followed;
        if (report.status != StepStatus::converged) {
            out.failure = report;
            note_worst(k, report.s);
            return out;
        }
        const double turn = step.largest_turn();
        if (is_worse(out.worst, report.s, turn)) note_worst(k, report.s);
        at.state(step, dt, X + static_cast<std::size_t>(k + 1) * at.nx);
        std::copy(step.lam.begin(), step.lam.end(), lam + static_cast<std::size_t>(k) * at.nc);
        if (energies) noted.note(step, dt, x + at.nqx, energies + static_cast<std::size_t>(k) * EnergyRows::width);
        series.take(step, dt, xbar ? reference.data() : nullptr);
        step.advance();
        out.steps = k + 1;
    }
    if (const int k = out.worst.k; k >= 0) {
        const double* x = X + static_cast<std::size_t>(k) * at.nx;
        const double dt = t[k + 1] - t[k];
        judge_worst(step, at, t[k], dt, at.share(k, dt, first_share), x, U + static_cast<std::size_t>(k) * at.nu,
                    x + at.nx, out.worst);
    }
    return out;
}

RollOut step_each(const Midpoint& integrator, int steps, const double* t, const double* X, const double* U,
                  double first_share, int threads, double* ends, double* lam) {
    const Layout at(integrator.mechanism());
    struct Made {
        StepReport report;
        double turn = 0;
        int most = -1;
    };
    std::vector<Made> made(steps);
    parallel_ranges(steps, threads, [&](int begin, int end) {
        auto workspace = integrator.workspace();
        MidpointStep& step = workspace->step;
        for (int k = begin; k < end; ++k) {
            const double dt = t[k + 1] - t[k], share = at.share(k, dt, first_share);
            const double *x = X + static_cast<std::size_t>(k) * at.nx, *u = U + static_cast<std::size_t>(k) * at.nu;
            at.start(x, u, t[k], share, step);
            std::fill(step.lam.begin(), step.lam.end(), 0.0);  // so that no result depends on the range it is in
            step.place_start();
            if (!step.guess_limit(dt)) at.start(x, u, t[k], share, step);
            made[k] = {step.find(dt), step.largest_turn(), step.most_turned()};
            if (made[k].report.status != StepStatus::converged) {
                workspace.discard();
                return;
            }
            at.state(step, dt, ends + static_cast<std::size_t>(k) * at.nx);
            std::copy(step.lam.begin(), step.lam.end(), lam + static_cast<std::size_t>(k) * at.nc);
        }
    });
    RollOut out;
    for (int k = 0; k < steps; ++k) {
        const auto& [report, turn, most] = made[k];
        const bool failed = report.status != StepStatus::converged;
        out.iterations += report.iterations;
        out.factorizations += report.factorizations;
        out.rank_deficient = out.rank_deficient || report.rank_deficient;
        out.followed += report.followed;
        if (failed || is_worse(out.worst, report.s, turn))
            out.worst = {k, report.s, turn, most < 0 ? -1 : at.m.external[most]};
        if (failed) {
            out.failure = report;
            return out;
        }
        out.steps = k + 1;
    }
    if (const std::size_t k = std::max(out.worst.k, 0); out.worst.k >= 0) {
        auto workspace = integrator.workspace();
        const double dt = t[k + 1] - t[k], share = at.share(k, dt, first_share);
        judge_worst(workspace->step, at, t[k], dt, share, X + k * at.nx, U + k * at.nu, ends + k * at.nx, out.worst);
    }
    return out;
}

}  // namespace leastaction
