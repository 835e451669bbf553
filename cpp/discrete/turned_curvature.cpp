// What rotations that are quaternions add to second derivatives of a step.
//
// In the kernel's coordinates z = (q1, q2) the rows r(z) = (D1Ld + fd-, D2Ld + fd+) are covectors, and the weighted sum is
// S = r(z).Z(z), with Z = X_w z the field of the weights w = (mu, w_p) as turns of the ends (turning.hpp). So with z' = X z
//
//   X_u X_v S = z'_u' (r.Z)_zz z'_v  [Z held]  +  (X_u Z).(r_z z'_v) + (X_v Z).(r_z z'_u)  +  r.X_u X_v Z  +  (r_z'Z).X_u X_v z,
//
// the symmetric part of it: second derivatives along exp.
#include <algorithm>

#include "discrete/curvature.hpp"
#include "discrete/step_hessian.hpp"

namespace leastaction {

using Vector6 = Turning::Vector6;
using Matrix6 = Turning::Matrix6;

struct SecondOrder::Turned {
    explicit Turned(const Mechanism& m)
        : lagrangian(m), end(m.n_coordinates()), start_row(m.n_variables()), end_row(m.n_variables()) {}
    Lagrangian<double> lagrangian;
    std::vector<double> end;  // q2 as a configuration
    std::vector<double> start_row, end_row;
    std::vector<Turning> turnings;
    std::vector<Vector6> along;   // mu and w_p of each ball
    std::vector<Matrix6> slopes;  // of z by turns of the ends, or by what is given of one that is prescribed
    StepHessian table;
    NewtonMatrix::Matrix own, rows;
};

void SecondOrder::begin_balls() {
    if (mechanism_.balls.empty()) return;
    turned_ = std::make_shared<Turned>(mechanism_);
    turned_->table.only.assign(nq_, 0);
    for (const Ball& ball : mechanism_.balls) std::fill_n(&turned_->table.only[ball.variable], 3, 1);
    prescribed_turns_ = std::ranges::any_of(mechanism_.balls, &Ball::prescribed);
}
const double* SecondOrder::end() const { return turned_ ? turned_->end.data() : q2.data(); }

void SecondOrder::place_balls() {
    for (const Ball& ball : mechanism_.balls) {
        std::fill_n(&q_mid_[ball.variable], 3, 0.0);
        turn_by(&q1[ball.quaternion], &q2[ball.variable], 0.5, &q_mid_[ball.quaternion]);
    }
}

void SecondOrder::place_dual_balls() {
    place_balls();
    for (const Ball& ball : mechanism_.balls)
        for (int i = 0; i < 4; ++i) {
            if (i < 3) dual_q_[ball.variable + i].v = 0.0;
            dual_q_[ball.quaternion + i] = q_mid_[ball.quaternion + i];
            dual_q1_[ball.quaternion + i] = q1[ball.quaternion + i];
        }
}

void SecondOrder::begin_turned() {
    const Mechanism& m = mechanism_;
    Turned& t = *turned_;
    t.turnings.clear();
    t.along.clear();
    t.slopes.clear();
    std::copy(q2.begin(), q2.begin() + nq_, t.end.begin());
    for (const Ball& ball : m.balls) {
        const int at = ball.variable;
        t.turnings.emplace_back(&q2[at]);
        std::fill_n(&t.end[at], 3, 0.0);
        turn_by(&q1[ball.quaternion], &q2[at], 1.0, &t.end[ball.quaternion]);
        Vector6 along = Vector6::Zero();
        for (int i = 0; i < 3 && !ball.prescribed; ++i) {
            along[i] = mu_[at + i];
            along[3 + i] = w_p[at + i];
        }
        t.along.push_back(along);
        t.slopes.push_back(ball.prescribed ? GivenTurning(&q2[at]).slope() : t.turnings.back().slope());
        const Vector6 field = t.turnings.back().slope() * along;
        for (int i = 0; i < 3; ++i) {
            mu_z_[at + i] = field[i];
            w_z_[at + i] = field[3 + i];
        }
    }
}

// The rows and their derivatives, in the kernel's coordinates.
void SecondOrder::make_rows(double dt) {
    const Mechanism& m = mechanism_;
    Turned& t = *turned_;
    for (int i = 0; i < nq_; ++i) {
        q_mid_[i] = 0.5 * (q1[i] + q2[i]);
        v_[i] = (q2[i] - q1[i]) / dt;
    }
    place_balls();
    t.lagrangian.at.time = this->t + 0.5 * dt;
    t.lagrangian.gradient(q_mid_.data(), v_.data());
    place(m.massless_joints_seen, q_mid_.data(), t.lagrangian.at);
    for_each_entry(m.potentials, t.lagrangian.at, q_mid_.data(), local_,
                   [&](int i, double slope) { t.lagrangian.L_q[i] -= slope; });
    for (int i = 0; i < nq_; ++i) {
        t.start_row[i] = 0.5 * dt * t.lagrangian.L_q[i] - t.lagrangian.L_v[i];
        t.end_row[i] = 0.5 * dt * t.lagrangian.L_q[i] + t.lagrangian.L_v[i];
    }
    const double km = kappa_minus(split_, dt), kp = kappa_plus(split_, dt);
    const auto add = [&](int i, double f) {
        t.start_row[i] += km * f;
        t.end_row[i] += kp * f;
    };
    const ForcePoint<double> middle{t.lagrangian.at, q_mid_.data(), v_.data(), u.data()};
    for (const auto& [i, slot] : m.damping) add(i, -m.numbers[slot] * v_[i]);
    for (const auto& [i, input] : m.joint_forces) add(i, u[input]);
    for_each_entry(m.forces, middle, force_, add);
    t.lagrangian.hessian();
    t.table.evaluate(m, t.lagrangian.pairs, middle, split_, dt, local_, force_);
}

double& SecondOrder::entry(int a, int b) {
    if (a > b) std::swap(a, b);
    const int i = a - nq_, j = b - nq_;
    if (b < nq_) return W_thth_(a, b);
    if (a < nq_) return j < nd_ ? W_yth_(j, a) : W_thth_(a, at_rho2_ + j - nd_);
    if (j < nd_) return W_yy_(i, j);
    if (i < nd_) return W_yth_(i, at_rho2_ + j - nd_);
    return W_thth_(at_rho2_ + i - nd_, at_rho2_ + j - nd_);
}

void SecondOrder::turn(double dt) {
    make_rows(dt);
    Turned& t = *turned_;
    const int n = 2 * nq_, at_u = nq_ + nd_, count = 6 * static_cast<int>(t.turnings.size());
    const auto& balls = mechanism_.balls;
    const auto place_of = [&](int row) {
        const int at = balls[row / 6].variable, k = row % 6;
        return k < 3 ? at + k : nq_ + at + k - 3;
    };
    auto& W = t.own;  // rows of balls alone
    W.resize(count, n);
    t.rows.resize(6, n);
    for (int row = 0; row < count; ++row)
        for (int c = 0; c < n; ++c) W(row, c) = entry(place_of(row), c);
    std::vector<Vector6> by_z;  // r_z'Z by the kernel's coordinates of each ball
    for (const Ball& ball : mechanism_.balls) {
        Vector6 out = Vector6::Zero();
        for (int i = 0; i < nd_; ++i)
            for (int k = 0; k < 6; ++k) {
                const int column = k < 3 ? ball.variable + k : nq_ + ball.variable + k - 3;
                out[k] += mu_z_[i] * t.table.by_ends(i, column) + w_z_[i] * t.table.by_ends(nd_ + i, column);
            }
        by_z.push_back(out);
    }
    t.table.turn_columns(mechanism_, t.turnings);
    for (int b = 0; b < count / 6; ++b) {
        const int at = balls[b].variable;
        turn_rows(W, 6 * b, 6 * b + 3, t.slopes[b]);
        turn_columns(W, at, nq_ + at, t.slopes[b]);
    }
    // Once all that is held has been turned, what the fields change by.
    for (std::size_t b = 0; b < t.turnings.size(); ++b) {
        const int at = mechanism_.balls[b].variable;
        const int first = 6 * static_cast<int>(b);
        if (mechanism_.balls[b].prescribed) {
            const Matrix6 own = GivenTurning(&q2[at]).bend(by_z[b]);
            for (int k = 0; k < 6; ++k)
                for (int l = 0; l < 6; ++l) W(first + k, place_of(first + l)) += own(k, l);
            if (nu_ == 0) continue;
            const int at_end = at_rho2_ + at - nd_;
            Eigen::Matrix<double, 6, Eigen::Dynamic> rows(6, nu_);
            rows << W_thth_.block(at, at_u, 3, nu_), W_thth_.block(at_u, at_end, nu_, 3).transpose();
            rows = (t.slopes[b].transpose() * rows).eval();
            W_thth_.block(at, at_u, 3, nu_) = rows.topRows(3);
            W_thth_.block(at_u, at_end, nu_, 3) = rows.bottomRows(3).transpose();
            continue;
        }
        Vector6 values;
        for (int i = 0; i < 3; ++i) {
            values[i] = t.start_row[at + i];
            values[3 + i] = t.end_row[at + i];
        }
        const Turning::Field field = t.turnings[b].field(t.along[b], values, by_z[b]);
        const Matrix6 own = field.bend + field.chart;
        auto& rows = t.rows;
        for (int k = 0; k < 6; ++k) {
            double* row = &rows(k, 0);
            std::fill_n(row, n, 0.0);
            for (int l = 0; l < 6; ++l) {
                const double* of = &t.table.by_ends((l < 3 ? at : nd_ + at - 3) + l, 0);
                const double weight = field.slope(l, k);
                for (int c = 0; c < n; ++c) row[c] += weight * of[c];
            }
        }
        for (int k = 0; k < 6; ++k) {
            double* to = &W(first + k, 0);
            for (int c = 0; c < n; ++c) to[c] += rows(k, c);
            for (int l = 0; l < 6; ++l) to[place_of(first + l)] += own(k, l);
            for (int row = 0; row < count; ++row) W(row, place_of(first + k)) += rows(k, place_of(row));
        }
        if (nu_ == 0) continue;
        Eigen::Matrix<double, 6, Eigen::Dynamic> by_inputs(6, nu_);
        by_inputs << W_thth_.block(at, at_u, 3, nu_), W_yth_.block(at, at_u, 3, nu_);
        by_inputs = (t.turnings[b].slope().transpose() * by_inputs).eval();
        Eigen::Matrix<double, 6, Eigen::Dynamic> by_u(6, nu_);
        by_u << t.table.by_u.middleRows(at, 3), t.table.by_u.middleRows(nd_ + at, 3);
        by_inputs += field.slope.transpose() * by_u;
        W_thth_.block(at, at_u, 3, nu_) = by_inputs.topRows(3);
        W_yth_.block(at, at_u, 3, nu_) = by_inputs.bottomRows(3);
    }
    for (int row = 0; row < count; ++row) {
        const int a = place_of(row);
        for (int c = 0; c < n; ++c) {
            entry(a, c) = W(row, c);
            if (std::min(a, c) >= nq_ && std::max(a, c) < nq_ + nd_)
                W_yy_(a - nq_, c - nq_) = W_yy_(c - nq_, a - nq_) = W(row, c);
        }
    }
}

// At the start the weighted sum holds -lam.X_mu h and share f.X_mu q1, at the end mu_h.h.
void SecondOrder::turn_constraints() {
    const Mechanism& m = mechanism_;
    using Vector3 = Eigen::Vector3d;
    using Matrix3 = Eigen::Matrix3d;
    for (const Ball& ball : m.balls) {
        if (nc_ == 0 && m.instant_forces.empty()) break;
        const int at = ball.variable;
        constexpr double none[3] = {0, 0, 0};
        const TurnedField field(ball.prescribed ? none : &mu_[at]);
        const Matrix3 slope = field.slope();
        Vector3 at_start = Vector3::Zero(), at_end = Vector3::Zero(), along_mu = Vector3::Zero();
        Eigen::Matrix<double, 3, Eigen::Dynamic> bent = Eigen::Matrix<double, 3, Eigen::Dynamic>::Zero(3, nq_);
        for (int c = 0; c < nc_; ++c) {
            const auto& constraint = *m.constraints[c];
            const auto own = [&](int i) { return i >= at && i < at + 3; };
            for_each_entry(constraint, dual_at1_, dual_q1_.data(), dual_local_,
                           [&](int i, int j, const Dual<double>& bend) {
                               if (own(i)) bent(i - at, j) -= lam[c] * bend.v;
                               if (own(j) && i < nd_) along_mu[j - at] -= lam[c] * bend.v * mu_[i];
                           });
            Vector3 gradient = Vector3::Zero();
            for (std::size_t i = 0; i < constraint.support().size(); ++i)
                if (own(constraint.support()[i])) gradient[constraint.support()[i] - at] += dual_local_.gradient[i].v;
            at_start -= lam[c] * gradient;
            const Vector3 turned = slope.transpose() * gradient;
            for (int i = 0; i < 3; ++i) W_yth_(nd_ + c, at + i) -= turned[i];
            for_each_entry(constraint, at2_, end(), local_, [&](int i, double x) {
                if (own(i)) at_end[i - at] += mu_[nd_ + c] * x;
            });
        }
        const ForcePoint<double> instant{at_middle_, q1.data(), v_.data(), u.data()};  // as add_instant_forces() left it
        const auto own_of = [&](int i) { return i >= at && i < at + 3; };
        for_each_entry(m.instant_forces, instant, force_, [&](int i, double f) {
            if (own_of(i)) at_start[i - at] += share * f;
        });
        for_each_entry(
            m.instant_forces, instant, force_,
            [&](int i, int j, double f_q, double) {
                if (own_of(i)) bent(i - at, j) += share * f_q;
                if (own_of(j) && i < nd_) along_mu[j - at] += share * mu_[i] * f_q;
            },
            [&](int i, int input, double f_u) {
                if (!own_of(i)) return;
                for (int k = 0; k < 3; ++k) W_thth_(at + k, nq_ + nd_ + input) += share * slope(i - at, k) * f_u;
            });
        const Matrix3 own = field.bend(at_start) + symmetric_chart_bend(along_mu), chart = symmetric_chart_bend(at_end);
        const Eigen::Matrix<double, 3, Eigen::Dynamic> rows = slope.transpose() * bent;
        for (int i = 0; i < 3; ++i) {
            for (int j = 0; j < nq_; ++j) {
                add_11(at + i, j, rows(i, j));
                add_11(j, at + i, rows(i, j));
            }
            for (int j = 0; j < 3; ++j) {
                add_11(at + i, at + j, own(i, j));
                if (!ball.prescribed) add_22(at + i, at + j, chart(i, j));
            }
        }
    }
    if (prescribed_turns_) add_prescribed_turns();
}

// Of balls that are prescribed: mu_h.h at the end, which alpha and e turn, and the weights on where they end themselves.
void SecondOrder::add_prescribed_turns() {
    const Mechanism& m = mechanism_;
    std::vector<GivenTurning::Matrix36> slopes;
    for (const Ball& ball : m.balls)
        slopes.push_back(ball.prescribed ? GivenTurning(&q2[ball.variable]).end_slope() : GivenTurning::Matrix36());
    const auto ball_of = [&](int i) {
        return std::ranges::find_if(
            m.balls, [&](const Ball& b) { return b.prescribed && i >= b.variable && i < b.variable + 3; });
    };
    const auto place_of = [&](const Ball& ball, int k) {
        return k < 3 ? ball.variable + k : nq_ + ball.variable + k - 3;
    };
    // Calls f(place, weight) for what a variable of the end depends on.
    const auto each_cause = [&](int i, const auto& f) {
        const auto ball = ball_of(i);
        if (ball == m.balls.end()) return f(nq_ + i, 1.0);
        for (int k = 0; k < 6; ++k) f(place_of(*ball, k), slopes[ball - m.balls.begin()](i - ball->variable, k));
    };
    std::vector<double> by_end(nq_);
    for (int c = 0; c < nc_; ++c) {
        for_each_entry(*m.constraints[c], at2_, end(), local_, [&](int i, int j, double bend) {
            each_cause(i, [&](int a, double weight_a) {
                each_cause(j,
                           [&](int b, double weight_b) { add_ends(a, b, mu_[nd_ + c] * weight_a * weight_b * bend); });
            });
        });
        for_each_entry(*m.constraints[c], at2_, end(), local_, [&](int i, double x) { by_end[i] += mu_[nd_ + c] * x; });
    }
    for (std::size_t b = 0; b < m.balls.size(); ++b) {
        const Ball& ball = m.balls[b];
        if (!ball.prescribed) continue;
        const Eigen::Map<const Eigen::Vector3d> g(&by_end[ball.variable]), w(&w_rho[ball.variable - nd_]);
        const Matrix6 own = slopes[b].transpose() * symmetric_chart_bend(g) * slopes[b] +
                            GivenTurning(&q2[ball.variable]).end_bend(g + w);
        for (int k = 0; k < 6; ++k)
            for (int l = 0; l < 6; ++l) add_ends(place_of(ball, k), place_of(ball, l), own(k, l));
    }
}

void SecondOrder::add_ends(int a, int b, double value) {
    if (a >= nq_ && b >= nq_ && std::max(a, b) < nq_ + nd_)
        W_yy_(a - nq_, b - nq_) += value;
    else if (a <= b)
        entry(a, b) += value;
}

}  // namespace leastaction
