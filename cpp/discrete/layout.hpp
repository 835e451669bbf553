// How states and inputs of the discrete system, in the user's order, lie in a step, in the internal one.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "discrete/curvature.hpp"
#include "discrete/newton_step.hpp"

namespace leastaction {

// Distance (m or rad) from the end of a step of a motion to the next state, at most.
constexpr double same_motion = 1e-6;

// Offsets of the parts of state, input and th = [q1 | p1 | u | rho2].
struct Layout {
    explicit Layout(const Mechanism& m, bool with_multipliers = false)
        : m(m),
          nd(m.n_dynamic),
          nk(m.n_kinematic),
          nq(nd + nk),
          ni(m.n_inputs),
          nqx(m.n_configuration()),
          nx(m.n_states()),
          ndx(m.n_tangent()),
          nu(ni + nk),
          nc(m.n_constraints()),
          ny(ndx + (with_multipliers ? nc : 0)),
          theta(nq + nd + nu) {}
    const Mechanism& m;
    int nd, nk, nq, ni;
    int nqx, nx, ndx;  // of a configuration, of a state, and of differences of states, by which derivatives are
    int nu, nc;
    int ny;  // differences, and the multipliers of the last step where they count as states
    int theta;

    // For how long forces at the instants act at the start of step k, of which the first has a part of its own.
    static double share(std::size_t k, double dt, double first_share) { return k > 0 ? dt : first_share * dt; }
    void start(const double* x, const double* u, double t, double share, MidpointStep& step) const {
        step.t = t;
        for (int i = 0; i < nq; ++i) step.q1[i] = x[m.places[i]];
        for (int i = 0; i < nd; ++i) step.p1[i] = x[nqx + m.external[i]];
        for (const Ball& ball : m.balls) {
            std::fill_n(&step.q1[ball.variable], 3, 0.0);
            std::copy_n(x + ball.place, 4, &step.q1[ball.quaternion]);
        }
        input(u, step);
        step.kick(share);
    }
    void input(const double* u, MidpointStep& step) const {
        std::copy(u, u + ni, step.u.begin());
        std::copy(u + ni, u + nu, step.q2.begin() + nd);
    }
    void state(const MidpointStep& step, double dt, double* x) const {
        for (int i = 0; i < nd; ++i) {
            x[m.places[i]] = step.q2[i];
            x[nqx + m.external[i]] = step.p2[i];
        }
        for (int i = nd; i < nq; ++i) {
            x[m.places[i]] = step.q2[i];
            x[nqx + i] = (step.q2[i] - step.q1[i]) / dt;
        }
        for (const Ball& ball : m.balls) std::copy_n(&step.q2[ball.quaternion], 4, x + ball.place);
    }
    // Sets the dynamic part of where a step leads to, from the next state; rotations turn the shorter way, or as their
    // numbers went, past half a turn where these have changed their sign.
    void finish(MidpointStep& step, const double* next, bool by_sign = false) const {
        for (int i = 0; i < nd; ++i) step.q2[i] = next[m.places[i]];
        for (const Ball& ball : m.balls) {
            if (ball.prescribed) continue;
            double* phi = &step.q2[ball.variable];
            rotation_between(&step.q1[ball.quaternion], next + ball.place, phi);
            if (!by_sign || !changes_sign(step, ball, next)) continue;
            const double angle = std::hypot(phi[0], phi[1], phi[2]), other = 1.0 - 2.0 * std::numbers::pi / angle;
            for (int i = 0; i < 3; ++i) phi[i] *= angle > 0 ? other : 1.0;
        }
    }
    // The same by the way that meets the step's equations better, with the multipliers that are known.
    void finish_nearer(MidpointStep& step, const double* next, double dt) const {
        finish(step, next);
        if (!changes_sign(step, next)) return;
        step.place_start();
        const double missed = step.mismatch(dt);
        finish(step, next, true);
        if (!(step.mismatch(dt) < missed)) finish(step, next);
    }
    bool changes_sign(const MidpointStep& step, const double* next) const {
        return std::ranges::any_of(m.balls,
                                   [&](const Ball& b) { return !b.prescribed && changes_sign(step, b, next); });
    }
    static bool changes_sign(const MidpointStep& step, const Ball& ball, const double* next) {
        const double *a = &step.q1[ball.quaternion], *b = next + ball.place;
        return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] < 0;
    }
    // The largest difference between where a step leads to and the next state, of dynamic variables.
    double distance(const MidpointStep& step, const double* next) const {
        const TurnedMiddle& turned = step.turned_middle();
        const bool turns = turned.turns();
        double most = 0;
        for (int i = 0; i < nd; ++i)
            if (!turns || turned.ball_of(i) < 0) most = std::max(most, std::abs(step.q2[i] - next[m.places[i]]));
        for (const Ball& ball : m.balls) {
            if (ball.prescribed) continue;
            double turn[3];
            rotation_between(&step.q2[ball.quaternion], next + ball.place, turn);
            for (const double each : turn) most = std::max(most, std::abs(each));
        }
        return most;
    }
    // x - xbar in the tangent space at xbar (ndx): of rotations the rotation vector from xbar's to x's.
    void difference(const double* x, const double* xbar, double* out) const {
        for (int i = 0; i < nq; ++i) {
            out[m.external[i]] = x[m.places[i]] - xbar[m.places[i]];
            out[nq + i] = x[nqx + i] - xbar[nqx + i];
        }
        for (const Ball& ball : m.balls)
            rotation_between(xbar + ball.place, x + ball.place, out + m.external[ball.variable]);
    }
    // The dynamic velocities over a step from x to the state behind it.
    void velocity(const double* x, double dt, double* out) const {
        for (int i = 0; i < nd; ++i) out[i] = (x[nx + m.places[i]] - x[m.places[i]]) / dt;
        for (const Ball& ball : m.balls) {
            if (ball.prescribed) continue;
            rotation_between(x + ball.place, x + nx + ball.place, out + ball.variable);
            for (int i = 0; i < 3; ++i) out[ball.variable + i] /= dt;
        }
    }
    // What difference() undoes: a state that is dx from x.
    void plus(const double* x, const double* dx, double* out) const {
        for (int i = 0; i < nq; ++i) {
            out[m.places[i]] = x[m.places[i]] + dx[m.external[i]];
            out[nqx + i] = x[nqx + i] + dx[nq + i];
        }
        for (const Ball& ball : m.balls) turn_by(x + ball.place, dx + m.external[ball.variable], 1.0, out + ball.place);
    }
    // The derivatives of a step whose end is known; false where it is no step of the mechanism. A step that does not end
    // there by the shorter way may have gone past half a turn.
    bool differentiate(MidpointStep& step, FirstOrder& first, const double* x, const double* u, const double* next,
                       double t, double dt, double share) const {
        const auto solved = [&](bool by_sign) {
            start(x, u, t, share, step);
            finish(step, next, by_sign);
            std::fill(step.lam.begin(), step.lam.end(), 0.0);  // so that no result depends on the range it is in
            step.place_start();
            return step.solve(dt, true).status == StepStatus::converged;
        };
        bool done = solved(false);
        if (changes_sign(step, next)) {
            const double none = std::numeric_limits<double>::infinity(), missed = done ? distance(step, next) : none;
            if (missed > same_motion) {
                done = solved(true);
                if (!done || distance(step, next) >= missed) done = missed < none && solved(false);
            }
        }
        return done && first.differentiate(step, dt);
    }
    // One row over th, internal order, into rows over the states and u, user's order. Nothing depends on the velocities of
    // the prescribed variables and the multipliers: their columns are left alone.
    void scatter(const double* row, double* by_x, double* by_u) const {
        if (m.same_order) {
            std::copy(row, row + nq + nd, by_x);
        } else {
            for (int i = 0; i < nq; ++i) by_x[m.external[i]] = row[i];
            for (int i = 0; i < nd; ++i) by_x[nq + m.external[i]] = row[nq + i];
        }
        if (nu > 0) std::copy(row + nq + nd, row + theta, by_u);
    }
    // The same for all of th: which entries stand where among the states and inputs.
    std::vector<SecondOrder::Run> runs() const {
        std::vector<SecondOrder::Run> out;
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
    // Which entry of th stands where among those states and inputs that anything depends on.
    std::vector<int> order() const {
        std::vector<int> out(theta);
        for (int i = 0; i < nd; ++i) {
            out[m.external[i]] = i;
            out[nq + m.external[i]] = nq + i;
        }
        for (int i = nd; i < nq; ++i) out[m.external[i]] = i;
        for (int i = nq + nd; i < theta; ++i) out[i] = i;
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

// The derivatives A (ny, ny) and B (ny, nu) of the end of one step, by rows of th in internal order.
class StepRows {
public:
    StepRows(const Layout& at, double* A, double* B) : at_(at), A_(A), B_(B) {}
    void clear() {
        std::fill_n(A_, at_.ny * at_.ny, 0.0);
        std::fill_n(B_, at_.ny * at_.nu, 0.0);
    }
    void put(const double* by_theta, int row) { at_.scatter(by_theta, A_ + row * at_.ny, B_ + row * at_.nu); }
    // Of the dynamic variable i.
    void put(const double* q2, const double* p2, int i) {
        put(q2, at_.m.external[i]);
        put(p2, at_.nq + at_.m.external[i]);
    }
    // Of the prescribed variables.
    void put_prescribed(double dt) {
        for (int i = at_.nd; i < at_.nq; ++i) {
            const int v = at_.nq + i, input = at_.ni + i - at_.nd;
            B_[i * at_.nu + input] = 1.0;
            A_[v * at_.ny + i] = -1.0 / dt;
            B_[v * at_.nu + input] = 1.0 / dt;
        }
    }
    // After that: of those that are turns.
    void put_prescribed_turns(const MidpointStep& step) {
        for (const Ball& ball : at_.m.balls) {
            if (!ball.prescribed) continue;
            const GivenTurning::Matrix36 end = GivenTurning(&step.q2[ball.variable]).end_slope();
            for (int i = 0; i < 3; ++i) {
                const int row = ball.variable + i;
                for (int j = 0; j < 3; ++j) {
                    A_[row * at_.ny + ball.variable + j] = end(i, j);
                    B_[row * at_.nu + at_.ni + ball.variable - at_.nd + j] = end(i, 3 + j);
                }
                A_[(at_.nq + row) * at_.ny + row] = 0.0;  // the rate is that of the step alone
            }
        }
    }

private:
    const Layout& at_;
    double *A_, *B_;
};

}  // namespace leastaction
