#include "discrete/many.hpp"

#include <algorithm>
#include <atomic>

#include "discrete/lane_step.hpp"
#include "discrete/layout.hpp"
#include "discrete/trajectory.hpp"
#include "numerics/parallel.hpp"

namespace leastaction {

namespace {

// Guesses of what comes next: the parabola through the last three.
class LaneSeries {
public:
    explicit LaneSeries(std::size_t n) : values_{std::vector<Lanes>(n, Lanes(0.0)), {}, {}} {
        values_[1] = values_[2] = values_[0];
    }
    void put(const std::vector<Lanes>& newest) {
        std::swap(values_[1], values_[2]);
        std::swap(values_[0], values_[1]);
        values_[0] = newest;
        count_ = std::min(count_ + 1, 3);
    }
    Lanes next(std::size_t i) const {
        constexpr double weights[4][3] = {{0, 0, 0}, {1, 0, 0}, {2, -1, 0}, {3, -3, 1}};
        const double* c = weights[count_];
        return c[0] * values_[0][i] + c[1] * values_[1][i] + c[2] * values_[2][i];
    }

private:
    std::vector<Lanes> values_[3];  // the newest first
    int count_ = 0;
};

// Roll-outs whose memory begins here; fewer than there are lanes at the end of them all.
struct Block {
    int count, steps;
    const double *t, *U;
    double *X, *lam;
    OneOfMany* made;
};

class LaneRollOut {
public:
    LaneRollOut(const Midpoint& integrator, LaneStep& step)
        : integrator_(integrator), at_(integrator.mechanism()), step_(step) {}

    void run(const Block& block) {
        LaneSeries velocity(at_.nd), multipliers(at_.nc);
        std::vector<Lanes> v(at_.nd);
        Lanes::Mask running = no_lanes;
        for (int l = 0; l < block.count; ++l) running[l] = -1;
        for (int k = 0; k < block.steps && any(running); ++k) {
            const double dt = block.t[k + 1] - block.t[k];
            step_.t = block.t[k];
            if (k == 0) place_start(block);
            load_inputs(block, k);
            Lanes::Mask found = running;
            if (k == 0)
                found &= step_.guess_limit(dt);
            else
                for (int i = 0; i < at_.nd; ++i) step_.q2[i] = step_.q1[i] + dt * velocity.next(i);
            for (int c = 0; k > 0 && c < at_.nc; ++c) step_.lam[c] = multipliers.next(c);
            found = step_.find(dt, found);
            for (int l = 0; l < block.count; ++l)
                if (running[l] && !found[l] && !find_alone(block, l, k, dt)) running[l] = 0;
            store(block, running, k, dt);
            for (int i = 0; i < at_.nd; ++i) v[i] = (1.0 / dt) * (step_.q2[i] - step_.q1[i]);
            velocity.put(v);
            multipliers.put(step_.lam);
            step_.advance();
        }
    }

private:
    const double* state(const Block& block, int l, int k) const {
        return block.X + (static_cast<std::size_t>(l) * (block.steps + 1) + k) * at_.nx;
    }
    const double* input(const Block& block, int l, int k) const {
        return block.U + (static_cast<std::size_t>(l) * block.steps + k) * at_.nu;
    }
    // Lanes without a roll-out of their own repeat the last.
    void place_start(const Block& block) {
        for (int l = 0; l < lane_count; ++l) {
            const double* x = state(block, std::min(l, block.count - 1), 0);
            for (int i = 0; i < at_.nq; ++i) step_.q1[i].set(l, x[at_.m.places[i]]);
            for (int i = 0; i < at_.nd; ++i) step_.p1[i].set(l, x[at_.nqx + at_.m.external[i]]);
        }
        step_.place_start();
    }
    void load_inputs(const Block& block, int k) {
        for (int l = 0; l < lane_count; ++l) {
            const double* u = input(block, std::min(l, block.count - 1), k);
            for (int i = 0; i < at_.ni; ++i) step_.u[i].set(l, u[i]);
            for (int i = at_.nd; i < at_.nq; ++i) step_.q2[i].set(l, u[at_.ni + i - at_.nd]);
        }
    }
    // The step of one lane by itself; false where that fails.
    bool find_alone(const Block& block, int l, int k, double dt) {
        const double *x = state(block, l, k), *u = input(block, l, k);
        auto workspace = integrator_.workspace();
        MidpointStep& alone = workspace->step;
        at_.start(x, u, block.t[k], 0.0, alone);
        std::fill(alone.lam.begin(), alone.lam.end(), 0.0);
        alone.place_start();
        if (!alone.guess_limit(dt)) at_.start(x, u, block.t[k], 0.0, alone);
        ++block.made[l].alone;
        block.made[l].status = alone.find(dt).status;
        if (block.made[l].status != StepStatus::converged) {
            workspace.discard();
            return false;
        }
        step_.take(l, alone, dt);
        return true;
    }
    void store(const Block& block, const Lanes::Mask& running, int k, double dt) {
        for (int l = 0; l < block.count; ++l) {
            if (!running[l]) continue;
            block.made[l].steps = k + 1;
            double* x = const_cast<double*>(state(block, l, k + 1));
            for (int i = 0; i < at_.nd; ++i) {
                x[at_.m.places[i]] = step_.q2[i][l];
                x[at_.nqx + at_.m.external[i]] = step_.p2[i][l];
            }
            for (int i = at_.nd; i < at_.nq; ++i) {
                x[at_.m.places[i]] = step_.q2[i][l];
                x[at_.nqx + i] = (step_.q2[i][l] - step_.q1[i][l]) / dt;
            }
            double* lam = block.lam + (static_cast<std::size_t>(l) * block.steps + k) * at_.nc;
            for (int c = 0; c < at_.nc; ++c) lam[c] = step_.lam[c][l];
        }
    }

    const Midpoint& integrator_;
    Layout at_;
    LaneStep& step_;
};

}  // namespace

std::vector<OneOfMany> roll_out_many(const Midpoint& integrator, int many, int steps, const double* t, const double* U,
                                     int threads, double* X, double* lam) {
    std::vector<OneOfMany> made(many);
    const Layout at(integrator.mechanism());
    const std::size_t x_size = static_cast<std::size_t>(steps + 1) * at.nx;
    const std::size_t u_size = static_cast<std::size_t>(steps) * at.nu,
                      lam_size = static_cast<std::size_t>(steps) * at.nc;
    const auto block = [&](int first, int count) -> Block {
        return {count, steps, t, U + first * u_size, X + first * x_size, lam + first * lam_size, &made[first]};
    };
    const bool lanes = LaneStep::suits(integrator.workspace()->step);
    const int width = lanes ? lane_count : 1, blocks = (many + width - 1) / width;
    parallel_ranges(blocks, threads, [&](int begin, int end) {
        if (lanes) {
            auto workspace = integrator.workspace();
            LaneRollOut side_by_side(integrator, workspace->lanes());
            for (int i = begin; i < end; ++i) side_by_side.run(block(i * width, std::min(width, many - i * width)));
            return;
        }
        std::vector<double> applied(u_size);
        for (int i = begin; i < end; ++i) {
            auto workspace = integrator.workspace();
            const Block one = block(i, 1);
            const RollOut out =
                roll_out(workspace->step, steps, t, nullptr, one.U, nullptr, 1.0, one.X, applied.data(), one.lam);
            *one.made = {out.steps, out.steps, out.failure.status};
            if (out.failure.status != StepStatus::converged) workspace.discard();
        }
    });
    return made;
}

namespace {

constexpr int few_variables = 8;  // dynamic variables: of more, one step after the other is quicker

}  // namespace

std::ptrdiff_t linearize_many(const Midpoint& integrator, int many, int steps, const double* t, const double* X,
                              const double* U, int threads, double* by_x, double* by_u) {
    const Layout at(integrator.mechanism());
    const std::ptrdiff_t N = steps, none = many * N;
    std::atomic<std::ptrdiff_t> first_failure{none};
    const auto x = [&](std::ptrdiff_t b, std::ptrdiff_t k) { return X + (b * (N + 1) + k) * at.nx; };
    const auto u = [&](std::ptrdiff_t b, std::ptrdiff_t k) { return U + (b * N + k) * at.nu; };
    const auto rows = [&](std::ptrdiff_t b, std::ptrdiff_t k) {
        StepRows of_step(at, by_x + (b * N + k) * at.ndx * at.ndx, by_u + (b * N + k) * at.ndx * at.nu);
        of_step.clear();
        return of_step;
    };
    const auto alone = [&](std::ptrdiff_t b, std::ptrdiff_t k, double dt) {
        auto workspace = integrator.workspace();
        FirstOrder& first = workspace->first();
        MidpointStep& step = workspace->step;
        const double *from = x(b, k), *to_state = x(b, k + 1);
        if (!at.differentiate(step, first, from, u(b, k), to_state, t[k], dt, at.share(k, dt, 1.0)) ||
            at.distance(step, to_state) > same_motion) {
            workspace.discard();
            std::ptrdiff_t seen = first_failure.load();
            while (b * N + k < seen && !first_failure.compare_exchange_weak(seen, b * N + k)) {
            }
            return;
        }
        StepRows to = rows(b, k);
        for (int i = 0; i < at.nd; ++i) to.put(&first.Y[i * first.ld], &first.P2[i * first.ld], i);
        to.put_prescribed(dt);
        to.put_prescribed_turns(step);
    };
    const bool lanes = at.nd <= few_variables && LaneStep::suits(integrator.workspace()->step);
    const int width = lanes ? lane_count : 1, blocks = (many + width - 1) / width;
    parallel_ranges(blocks, threads, [&](int begin, int end) {
        auto workspace = integrator.workspace();
        std::vector<Lanes> Y, P2;
        std::vector<double> q_row(at.theta), p_row(at.theta);
        for (int i = begin; i < end; ++i) {
            const int first = i * width, count = std::min(width, many - first);
            for (std::ptrdiff_t k = 0; k < N; ++k) {
                const double dt = t[k + 1] - t[k];
                if (!lanes) {
                    alone(first, k, dt);
                    continue;
                }
                LaneStep& step = workspace->lanes();
                Y.resize(static_cast<std::size_t>(at.nd + at.nc) * at.theta);
                P2.resize(static_cast<std::size_t>(at.nd) * at.theta);
                for (int l = 0; l < lane_count; ++l) {
                    const std::ptrdiff_t b = first + std::min(l, count - 1);
                    const double *from = x(b, k), *to = x(b, k + 1), *input = u(b, k);
                    for (int j = 0; j < at.nq; ++j) step.q1[j].set(l, from[at.m.places[j]]);
                    for (int j = 0; j < at.nd; ++j) {
                        step.p1[j].set(l, from[at.nqx + at.m.external[j]]);
                        step.q2[j].set(l, to[at.m.places[j]]);
                    }
                    for (int j = 0; j < at.ni; ++j) step.u[j].set(l, input[j]);
                    for (int j = at.nd; j < at.nq; ++j) step.q2[j].set(l, input[at.ni + j - at.nd]);
                }
                step.t = t[k];
                const Lanes::Mask good = step.know(dt);
                step.differentiate(dt, Y.data(), P2.data());
                for (int l = 0; l < count; ++l) {
                    if (!good[l]) {
                        alone(first + l, k, dt);
                        continue;
                    }
                    StepRows to = rows(first + l, k);
                    for (int j = 0; j < at.nd; ++j) {
                        for (int c = 0; c < at.theta; ++c) {
                            q_row[c] = Y[c * (at.nd + at.nc) + j][l];
                            p_row[c] = P2[c * at.nd + j][l];
                        }
                        to.put(q_row.data(), p_row.data(), j);
                    }
                    to.put_prescribed(dt);
                }
            }
        }
    });
    return first_failure.load();
}

}  // namespace leastaction
