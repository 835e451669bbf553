// Which root: a step is a function of its state and input.
//
// The equations of a step, F(q2; q1, p1, u, dt) = 0, have many roots. The step's is the one that is continuous with
// q2 = q1 + dt v(q1, p1) for dt -> 0, with q1, p1 and u held and the prescribed variables going on at their velocity over
// the step. On the way the determinant of the Newton matrix never vanishes, so
//
//   s = lim det / det,   both times dt^(variables - constraints),
//
// keeps its sign; it is 1 for dt -> 0 and grows without bound towards a fold, past which the root is gone.
//
// Newton's method starts from any guess. Its root is trusted where it cannot be another: where the Newton matrix changed
// little, by its pivots since the last step and by how the iteration went, no angle moved far, or farther but as in the last
// step, and no constraint turned. (Of 90 000 steps so trusted from 0.2 rad on, of random mechanisms, states, inputs and
// guesses, all had the root that was then followed from dt -> 0, and s between 0.5 and 1.6.)
// Otherwise the guess counts for nothing: the root is followed from dt -> 0, mostly in one go. Each part of the way must
// pass the test of Newton and Kantorovich: a second correction, with the matrix of the first, of at most a quarter of the
// first, so that the root is the only one near.
//
// Where the way leads through a configuration in which constraints lose rank (a lift with its links upright, a parallelogram
// drawn out straight) two ways cross: the determinant changes its sign there, not towards infinity but by the constraints,
// and the motion goes straight on. So it does, with s through infinity, where the equations of a motion that is not made lose
// rank: a cable that stays in its plane and would buckle out of it. Such a crossing is told from a mirrored root by the
// correction, which is small against the way; at a fold the way turns.
#include <algorithm>
#include <cmath>
#include <limits>

#include "discrete/newton_step.hpp"
#include "discrete/root_trust.hpp"

namespace leastaction {

namespace {

using namespace trust;

constexpr double contraction = 0.25;             // of the second correction
constexpr double long_turn = 1.0;                // rad: no part of the way is longer
constexpr double straight = 0.1;                 // a correction of less than this part of the way means no turn
constexpr double straight_past_infinity = 0.01;  // and of this part, where s goes through infinity
constexpr double nothing_left = 1e-9;            // rad or m: a correction below this contracts by rounding alone
constexpr double least_part = 1.0 / 1024;        // of the time step, to go on along the path
constexpr int max_corrections = 8;
constexpr double largest_log2 = 1000.0;  // of s, a product over all joints, so that its sign is never lost

}  // namespace

double MidpointStep::largest_turn() const {
    double most = 0;
    for (int i = 0; i < nq_; ++i) most = std::max(most, turn_[i] * std::abs(q2[i] - q1[i]));
    return most;
}

int MidpointStep::most_turned() const {
    int most = -1;
    double turn = 0;
    for (int i = 0; i < nq_; ++i)
        if (turn_[i] * std::abs(q2[i] - q1[i]) > turn) {
            turn = turn_[i] * std::abs(q2[i] - q1[i]);
            most = i;
        }
    return most;
}

bool MidpointStep::turns_as_expected(double dt) const {
    const double turn = largest_turn();
    if (turn <= small_turn) return true;
    double change = 0;
    for (int i = 0; i < nq_; ++i) change = std::max(change, turn_[i] * std::abs(q2[i] - q1[i] - dt * expected_v_[i]));
    return turn <= medium_turn && change <= turn_change;
}

bool MidpointStep::keeps_constraint_directions() const {
    if (loops_) return loops_->keeps_directions(start_, end_, mobility_.data(), direction_change);
    for (int c = 0; c < nc_; ++c) {
        const double *C1 = &C1_[c * nq_], *C2 = &C2_[c * nq_];
        double size = 0, change = 0;
        for (int i = 0; i < nd_; ++i) {
            const double d = C2[i] - C1[i];
            size += mobility_[i] * C1[i] * C1[i];
            change += mobility_[i] * d * d;
        }
        if (!(change <= direction_change * direction_change * size)) return false;
    }
    return true;
}

void MidpointStep::keep_pivots(double dt) {
    const std::vector<double>& reciprocal = newton_.reciprocal_pivots();
    for (int i = 0; i < nd_; ++i) {
        pivots_[i] = dt / reciprocal[i];
        mobility_[i] = root_inertia_[i] > 0 ? 1.0 / (root_inertia_[i] * root_inertia_[i]) : 0.0;
    }
    have_pivots_ = true;
}

bool MidpointStep::is_trusted(double dt, const StepReport& report) {
    if (report.factorizations - report.idle > 1 || report.setbacks > 0 || !turns_as_expected(dt)) return false;
    if (!have_pivots_) return false;
    if (report.factorizations > 0) {
        if (!newton_.schur_keeps_sign()) return false;
        const std::vector<double>& reciprocal = newton_.reciprocal_pivots();
        for (int i = 0; i < nd_; ++i) {
            const double change = pivots_[i] * reciprocal[i];
            if (!(change * pivot_change >= dt && change <= pivot_change * dt)) return false;
        }
        keep_pivots(dt);
    }
    return keeps_constraint_directions();
}

// Corrects the velocity path_v_ of q2 = q1 + tau v, for a step as short as none; false where that cannot be done.
bool MidpointStep::correct_limit(double tau) {
    std::fill(lam.begin(), lam.end(), 0.0);
    evaluate(tau);
    // The constraints' gradients at q1 at both ends, and their rates instead of their values.
    C2_ = C1_;
    if (loops_) {
        end_ = start_;
        have_C2_ = have_C1_;
    }
    loops_fail_ = false;
    if (!refresh(tau, true)) return false;
    for (int i = 0; i < nd_; ++i) correction_[i] = -residual[i];
    for (int c = 0; c < nc_; ++c) {
        correction_[nd_ + c] = 0;
        if (loops_) continue;  // prescribed variables move none of their points
        for (int i = 0; i < nq_; ++i) correction_[nd_ + c] -= C1_[c * nq_ + i] * (q2[i] - q1[i]);
    }
    if (by_time_) by_time_->constraints(t, q1.data(), [&](int c, double rate) { correction_[nd_ + c] -= tau * rate; });
    newton_.solve(correction_.data(), correction_.data() + nd_);
    turn_correction();
    for (int i = 0; i < nd_; ++i) path_v_[i] = (q2[i] - q1[i] + correction_[i]) / tau;
    std::copy(correction_.begin() + nd_, correction_.end(), lam.begin());
    return std::all_of(path_v_.begin(), path_v_.end(), [](double v) { return std::isfinite(v); });
}

bool MidpointStep::guess_limit(double dt) {
    const double tau = limit_part * dt;
    std::copy(q2.begin() + nd_, q2.begin() + nq_, rho2_.begin());
    std::copy(q1.begin(), q1.begin() + nd_, q2.begin());
    for (int i = nd_; i < nq_; ++i) q2[i] = q1[i] + limit_part * (q2[i] - q1[i]);
    place_prescribed();
    bool regular = correct_limit(tau);
    if (!regular && !mechanism_->forces.empty()) {
        // Forces, or their slopes, may be undefined at rest (friction against the velocity): as the momentum goes without.
        with_forces_ = false;
        regular = correct_limit(tau);
        with_forces_ = true;
        if (regular) {
            for (int i = 0; i < nd_; ++i) q2[i] = q1[i] + tau * path_v_[i];
            regular = correct_limit(tau);
        }
    }
    if (regular) {
        newton_.choose_independent();
        limit_ = newton_.determinant();
        limit_.log2 += (nd_ - newton_.independent()) * std::log2(tau);
        have_limit_ = true;
        keep_pivots(tau);
    }
    for (int i = 0; i < nd_; ++i) q2[i] = q1[i] + dt * path_v_[i];
    std::copy(rho2_.begin(), rho2_.end(), q2.begin() + nd_);
    for (int i = 0; i < nq_; ++i) expected_v_[i] = (q2[i] - q1[i]) / dt;
    have_factors_ = false;
    return regular;
}

double MidpointStep::judge(double dt) {
    place_prescribed();
    evaluate(dt);
    return judge_here(dt);
}

double MidpointStep::judge_here(double dt) { return refresh(dt, true) ? determinant_ratio(dt) : NAN; }

double MidpointStep::determinant_ratio(double dt) {
    const NewtonMatrix::Determinant at = newton_.determinant();
    s_is_by_constraints_ = at.sign_of_M == limit_.sign_of_M;
    const double log2 = limit_.log2 - at.log2 - (nd_ - newton_.independent()) * std::log2(dt);
    return limit_.sign * at.sign * std::exp2(std::clamp(log2, -largest_log2, largest_log2));
}

// From the solution for a time step `from` to that for `to`, both parts of dt.
bool MidpointStep::follow(double from, double to, double dt) {
    for (int i = 0; i < nd_; ++i) q2[i] = q1[i] + to * (path_v_[i] + (to - from) * path_slope_[i]);
    for (int i = 0; i < mechanism_->n_kinematic; ++i) q2[nd_ + i] = q1[nd_ + i] + to / dt * (rho2_[i] - q1[nd_ + i]);
    place_prescribed();
    double last = 0, first = 0, way = 0;
    // Largest turn of a ball (rad). The chart ends at a full turn, where derivatives are infinite (turning.hpp).
    constexpr double most_turn = 6.0;
    const auto is_within_chart = [&](const Ball& ball) {
        const double* phi = &q2[ball.variable];
        return ball.prescribed || std::hypot(phi[0], phi[1], phi[2]) < most_turn;
    };
    for (int corrections = 0; corrections < max_corrections; ++corrections) {
        evaluate(to);
        // The second correction is made with the matrix of the first.
        if (corrections != 1 && !refresh(to, true)) return false;
        for (int i = 0; i < nd_ + nc_; ++i) correction_[i] = -residual[i];
        newton_.solve(correction_.data(), correction_.data() + nd_);
        turn_correction();
        double size = 0, floor = 0;
        for (int i = 0; i < nd_; ++i) {
            size += root_inertia_[i] * root_inertia_[i] * correction_[i] * correction_[i];
            floor += root_inertia_[i] * root_inertia_[i];
            q2[i] += correction_[i];
        }
        for (int c = 0; c < nc_; ++c) lam[c] += correction_[nd_ + c];
        if (!std::isfinite(size)) return false;
        if (corrections == 0) {
            first = size;
            for (int i = 0; i < nd_; ++i) way += std::pow(root_inertia_[i] * path_v_[i] * (to - from), 2);
        }
        const bool done = size <= nothing_left * nothing_left * floor;
        if (!done && corrections > 0 && !(size <= contraction * contraction * last)) return false;
        last = size;
        if (done || corrections == 2) {
            evaluate(to);
            const double s = judge_here(to);  // at the solution: where it begins s may have its other sign
            if (!(std::abs(s) > 0)) return false;
            const bool crosses = (s < 0) != (path_s_ < 0);
            const double turn = s_is_by_constraints_ ? straight : straight_past_infinity;
            if (crosses && !(first <= turn * turn * way)) return false;
            if (!std::ranges::all_of(mechanism_->balls, is_within_chart)) return false;
            path_s_ = s;
            for (int i = 0; i < nd_; ++i) {
                const double v = (q2[i] - q1[i]) / to;
                path_slope_[i] = from > 0 ? (v - path_v_[i]) / (to - from) : 0.0;
                path_v_[i] = v;
            }
            return true;
        }
    }
    return false;
}

StepReport MidpointStep::follow_from_limit(double dt, const StepReport& first) {
    StepReport report = first;
    report.followed = true;
    residual_kept_ = residual;
    path_s_ = 1;
    double from = 0, increment = dt;
    if (guess_limit(dt)) {
        std::fill(path_slope_.begin(), path_slope_.end(), 0.0);
        while (from < dt && increment >= least_part * dt) {
            double rate = 0;
            for (int i = 0; i < nd_; ++i) rate = std::max(rate, turn_[i] * std::abs(path_v_[i]));
            if (rate * increment > long_turn) increment = std::max(long_turn / rate, least_part * dt);
            const double to = from + increment > 0.999 * dt ? dt : from + increment;
            if (follow(from, to, dt)) {
                from = to;
                increment *= 1.5;
            } else {
                increment *= 0.5;
            }
        }
    }
    std::copy(rho2_.begin(), rho2_.end(), q2.begin() + nd_);
    if (from == dt) {
        StepReport last = solve(dt);
        last.iterations += first.iterations;
        last.factorizations += first.factorizations;
        last.followed = true;
        // With the matrix of the solution, which the next step starts from.
        const bool moved = last.status == StepStatus::converged && last.iterations > first.iterations;
        last.s = moved ? judge_here(dt) : path_s_;
        const bool sound = std::isfinite(last.s) && (last.s < 0) == (path_s_ < 0);
        if (sound) keep_pivots(dt);
        if (sound || last.status != StepStatus::converged) return last;
    }
    // For the message: the residuals of the first attempt, and where the path ended, had it gone on.
    if (from > 0 || first.status == StepStatus::converged) report.status = StepStatus::too_coarse;
    report.reached = from;
    report.s = path_s_;
    residual = residual_kept_;
    for (int i = 0; i < nd_; ++i) q2[i] = q1[i] + dt * path_v_[i];
    return report;
}

StepReport MidpointStep::find(double dt) {
    loops_fail_ = false;
    const StepReport report = solve(dt);
    if (report.status == StepStatus::converged && is_trusted(dt, report)) return report;
    if (report.status == StepStatus::not_finite) return report;
    return follow_from_limit(dt, report);
}

}  // namespace leastaction
