// What rotations that are quaternions add to second derivatives of a step.
//
// By z = (theta, phi) of a ball, turns of the middle and the rotation vector of the step, the rows r(z) of a step are covectors, and
// the weighted sum is S = r(z).Z(z), with Z = X_w z the field of the weights w = (mu, w_p) as turns of the ends (turning.hpp). So
// with z' = X z
//
//   X_u X_v S = z'_u' (r.Z)_zz z'_v  [Z held]  +  (X_u Z).(r_z z'_v) + (X_v Z).(r_z z'_u)  +  r.X_u X_v Z  +  (r_z'Z).X_u X_v z,
//
// the symmetric part of it: second derivatives along exp. The first three are those of duals along Z, of which z' changes by
// X_u Z (turned_middle.hpp), but for the order of turns; the last two are a ball's own. By a number or the time step, a, of which z is
// none,
//
//   X_u S_a = (r_a.Z)_z z'_u  [Z held]  +  r_a.X_u Z,    (r_a.Z)_theta theta_u = D_u D_Z,
//
// where duals along Z in axes that turn have D_Z D_u. So it is with the chart that elements know, but for its changes.
#include <algorithm>

#include "discrete/curvature.hpp"

namespace leastaction {

using Vector = Turning::Vector;
using Matrix6 = Turning::Matrix6;

struct SecondOrder::Turned {
    explicit Turned(const Mechanism& m) : end(m.n_coordinates()) {
        turnings.reserve(m.balls.size());
        fields.reserve(m.balls.size());
        for (auto* a : {&of_elements, &by_q, &by_v, &at_start, &at_end, &along_mu}) a->resize(m.n_variables());
        bent.resize(static_cast<std::size_t>(m.n_variables()) * m.n_variables());
    }
    std::vector<double> end;  // q2 as a configuration
    std::vector<Turning> turnings;
    std::vector<TurnedField> fields;
    // Of elements at the middle: dt times their forces, and the weighted sum's derivatives by what they see.
    std::vector<double> of_elements, by_q, by_v;
    // The slopes of constraints and instant forces at both ends, and their second derivatives at the start: along mu, and by
    // variable in rows.
    std::vector<double> at_start, at_end, along_mu, bent;
};

void SecondOrder::begin_balls() {
    if (mechanism_.balls.empty()) return;
    turned_ = std::make_shared<Turned>(mechanism_);
    if (!mechanism_.potentials.empty()) chart_middle_ = std::make_unique<Placement<Dual<double>>>(mechanism_);
    prescribed_turns_ = std::ranges::any_of(mechanism_.balls, &Ball::prescribed);
}
const double* SecondOrder::turned_end() const { return turned_->end.data(); }

void SecondOrder::place_balls() {
    for (std::size_t b = 0; b < mechanism_.balls.size(); ++b) {
        const Ball& ball = mechanism_.balls[b];
        std::fill_n(&q_mid_[ball.variable], 3, 0.0);
        turned_->turnings[b].turn_half(&q1[ball.quaternion], &q_mid_[ball.quaternion]);
    }
}

void SecondOrder::place_dual_balls() {
    for (const Ball& ball : mechanism_.balls)
        for (int i = 0; i < 4; ++i) {
            dual_q_[ball.quaternion + i] = q_mid_[ball.quaternion + i];
            dual_q1_[ball.quaternion + i] = q1[ball.quaternion + i];
        }
}

void SecondOrder::begin_turned(double dt) {
    Turned& t = *turned_;
    std::copy(mu_.begin(), mu_.begin() + nd_, mu_z_.begin());
    std::copy(w_p.begin(), w_p.end(), w_z_.begin());
    t.turnings.clear();
    t.fields.clear();
    const bool has_end = nc_ > 0;  // that anything sees
    if (has_end) std::copy(q2.begin(), q2.begin() + nq_, t.end.begin());
    for (const Ball& ball : mechanism_.balls) {
        const int at = ball.variable;
        const Turning& turning = t.turnings.emplace_back(&q2[at]);
        if (has_end) {
            std::fill_n(&t.end[at], 3, 0.0);
            turning.turn_whole(&q1[ball.quaternion], &t.end[ball.quaternion]);
        }
        Vector mu, w;
        if (!ball.prescribed) {
            mu = {mu_[at], mu_[at + 1], mu_[at + 2]};
            w = {w_p[at], w_p[at + 1], w_p[at + 2]};
        }
        const TurnedField& field = t.fields.emplace_back(turning, mu, w);
        const Vector half = 0.5 * field.phi(), start = field.theta() - half, end = field.theta() + half;
        mu_z_[at] = start.x, mu_z_[at + 1] = start.y, mu_z_[at + 2] = start.z;
        w_z_[at] = end.x, w_z_[at + 1] = end.y, w_z_[at + 2] = end.z;
    }
    turned_middle_.set(t.turnings, dt);
    for (std::size_t b = 0; b < t.fields.size(); ++b) turned_middle_.set_field(b, t.fields[b]);
    if (!mechanism_.has_elements_at_middle()) return;
    for (auto* a : {&t.of_elements, &t.by_q, &t.by_v}) std::fill(a->begin(), a->end(), 0.0);
}

// After its second derivatives with the field held: what the field changes by, and its slope.
void SecondOrder::add_turned_potential(const ConfigurationFunction& potential, double dt) {
    const std::vector<int>& support = potential.support();
    const std::size_t n = support.size();
    for (std::size_t a = 0; a < n; ++a) {
        turned_->of_elements[support[a]] -= dt * dual_local_.gradient[a].v;
        turned_->by_q[support[a]] -= dual_local_.gradient[a].d;
        turned_middle_.each_field_end(support[a], [&](int k, const ByEnds& of_a) {
            for (std::size_t b = 0; b < n; ++b)
                spread(turned_middle_, support[b], -dual_local_.hessian[a * n + b].v, 0.0,
                       [&](int l, double start, double end) {
                           add_both(k, l, of_a.q_start * start, of_a.q_start * end, of_a.q_end * start,
                                    of_a.q_end * end);
                       });
        });
    }
}

// Of forces of balls that are no second derivatives with the field held.
void SecondOrder::add_turned_forces(double dt) {
    const Mechanism& m = mechanism_;
    if (!m.has_elements_at_middle()) return;
    Turned& t = *turned_;
    // As one row at the middle, for each second: the field of duals is that of dt L.
    const double whole = kappa_plus(split_, dt) + kappa_minus(split_, dt), at_q = whole / dt,
                 at_v = 0.5 * (kappa_plus(split_, dt) - kappa_minus(split_, dt));
    const auto by_variable = [&](int i, int j, double f_q, double f_v) {
        t.by_q[j] += mu_force_[i] * f_q;
        t.by_v[j] += mu_force_[i] * f_v;
        turned_middle_.each_field_end(i, [&](int k, const ByEnds& of_i) {
            const double at_start = at_q * of_i.q_start + at_v * of_i.v_start,
                         at_end = at_q * of_i.q_end + at_v * of_i.v_end;
            spread(turned_middle_, j, f_q, f_v, [&](int l, double start, double end) {
                add_both(k, l, at_start * start, at_start * end, at_end * start, at_end * end);
            });
        });
    };
    const auto by_input = [&](int i, int input, double f_u) {
        turned_middle_.each_field_end(i, [&](int k, const ByEnds& of_i) {
            add_input(k, input, (at_q * of_i.q_start + at_v * of_i.v_start) * f_u,
                      (at_q * of_i.q_end + at_v * of_i.v_end) * f_u);
        });
    };
    for (const auto& [i, slot] : m.damping) {
        t.of_elements[i] -= whole * m.numbers[slot] * v_[i];
        by_variable(i, i, 0.0, -m.numbers[slot]);
    }
    for (const auto& [i, input] : m.joint_forces) {
        t.of_elements[i] += whole * u[input];
        by_input(i, input, 1.0);
    }
    if (m.forces.empty()) return;
    const ForcePoint<double> middle{at_middle_, q_mid_.data(), v_.data(), u.data()};
    for_each_entry(m.forces, middle, force_, [&](int i, double f) { t.of_elements[i] += whole * f; });
    for_each_entry(m.forces, middle, force_, by_variable, by_input);
}

void SecondOrder::add_bends(double dt) {
    Turned& t = *turned_;
    for (std::size_t b = 0; b < t.turnings.size(); ++b) {
        const Ball& ball = mechanism_.balls[b];
        const int at = ball.variable;
        const auto vector = [&](const auto& of) { return Vector{of(at), of(at + 1), of(at + 2)}; };
        const Vector by_theta = vector([&](int i) { return dual_.L_q[i].d; }),
                     by_phi = vector([&](int i) { return dual_.L_v[i].d / dt; });
        const GivenTurning given(&q2[at]);
        const TurnedField& field = t.fields[b];
        Matrix6 own;
        if (ball.prescribed) {
            own = given.bend(by_theta, by_phi);
        } else {
            const Vector g = vector([&](int i) { return dt * dual_.L_q[i].v; }),
                         h = vector([&](int i) { return dual_.L_v[i].v; });
            own = field.bend(g, h, by_theta, by_phi);
        }
        if (turned_middle_.is_seen(b)) {
            const Vector g = vector([&](int i) { return t.of_elements[i]; }),
                         of_theta = vector([&](int i) { return t.by_q[i]; }),
                         of_phi = vector([&](int i) { return t.by_v[i] / dt; });
            own = own + (ball.prescribed ? given.bend_of_elements(of_theta, of_phi)
                                         : field.bend_of_elements(g, of_theta, of_phi));
        }
        if (turned_middle_.set_own(b, own, dt)) continue;
        own = by_ends(own);
        for (int k = 0; k < 3; ++k)
            for (int l = 0; l < 3; ++l) {
                add_11(at + k, at + l, own.aa(k, l));
                add_12(at + k, at + l, own.ab(k, l));
                add_22(at + k, at + l, own.bb(k, l));
            }
    }
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

// At the start the weighted sum holds -lam.X_mu h and share f.X_mu q1, at the end mu_h.h: of balls their slopes are gathered
// while the constraints are at hand, and what is bent along mu.
void SecondOrder::begin_turned_ends() {
    Turned& t = *turned_;
    for (auto* a : {&t.at_start, &t.at_end, &t.along_mu}) std::fill(a->begin(), a->end(), 0.0);
    std::fill(t.bent.begin(), t.bent.end(), 0.0);
}
void SecondOrder::note_bend_at_start(int i, int j, double bend) {
    Turned& t = *turned_;
    if (turned_middle_.ball_of(i) >= 0) t.bent[static_cast<std::size_t>(i) * nq_ + j] += bend;
    if (i < nd_) t.along_mu[j] += bend * mu_[i];
}
TurnedAxis SecondOrder::axis_at_start(const Ball& ball) const {
    constexpr double none[3] = {0, 0, 0};
    return TurnedAxis(ball.prescribed ? none : &mu_[ball.variable]);
}
void SecondOrder::note_constraint_at_start(int c) {
    const std::vector<int>& support = mechanism_.constraints[c]->support();
    for (std::size_t k = 0; k < support.size(); ++k) {
        const int i = support[k], b = turned_middle_.ball_of(i);
        if (b < 0) continue;
        const double slope = dual_local_.gradient[k].v;
        turned_->at_start[i] -= lam[c] * slope;
        const Ball& ball = mechanism_.balls[b];
        const Eigen::Matrix3d by_turn = axis_at_start(ball).slope();
        for (int l = 0; l < 3; ++l) W_yth_(nd_ + c, ball.variable + l) -= by_turn(i - ball.variable, l) * slope;
    }
}
void SecondOrder::note_constraint_at_end(int c) {
    const std::vector<int>& support = mechanism_.constraints[c]->support();
    for (std::size_t k = 0; k < support.size(); ++k) turned_->at_end[support[k]] += mu_[nd_ + c] * local_.gradient[k];
}

void SecondOrder::turn_ends() {
    const Mechanism& m = mechanism_;
    Turned& t = *turned_;
    const ForcePoint<double> instant{at_middle_, q1.data(), v_.data(), u.data()};  // as add_instant_forces() left it
    for_each_entry(m.instant_forces, instant, force_, [&](int i, double f) { t.at_start[i] += share * f; });
    for_each_entry(
        m.instant_forces, instant, force_,
        [&](int i, int j, double f_q, double) { note_bend_at_start(i, j, share * f_q); },
        [&](int i, int input, double f_u) {
            const int b = turned_middle_.ball_of(i);
            if (b < 0) return;
            const int at = m.balls[b].variable;
            const Eigen::Matrix3d by_turn = axis_at_start(m.balls[b]).slope();
            for (int k = 0; k < 3; ++k) W_thth_(at + k, nq_ + nd_ + input) += share * by_turn(i - at, k) * f_u;
        });
    if (prescribed_turns_) add_prescribed_turns();
    for (const Ball& ball : m.balls) {
        const int at = ball.variable;
        const TurnedAxis field = axis_at_start(ball);
        using Vector3 = Eigen::Map<const Eigen::Vector3d>;
        const Eigen::Matrix3d own =
                                  field.bend(Vector3(&t.at_start[at])) + symmetric_chart_bend(Vector3(&t.along_mu[at])),
                              chart = symmetric_chart_bend(Vector3(&t.at_end[at]));
        const Eigen::Map<const NewtonMatrix::Matrix> bent(&t.bent[static_cast<std::size_t>(at) * nq_], 3, nq_);
        const Eigen::Matrix<double, 3, Eigen::Dynamic> rows = field.slope().transpose() * bent;
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
}

void SecondOrder::turn_changes(double dt) {
    using Vector3 = Eigen::Vector3d;
    using Vector6 = Eigen::Matrix<double, 6, 1>;
    const auto times = [](const Vector6& rows, const Matrix6& slope) {
        Vector6 out = Vector6::Zero();
        for (int i = 0; i < 6; ++i)
            for (int j = 0; j < 6; ++j) out[j] += rows[i] * slope(i, j);
        return out;
    };
    auto& [e, c, by_q1, by_q2, by_u] = by_instants_;
    for (std::size_t b = 0; b < mechanism_.balls.size(); ++b) {
        const Ball& ball = mechanism_.balls[b];
        const int at = ball.variable;
        const Vector3 end = by_q2.segment<3>(at);
        const auto vector = [&](int column) {
            return Vector{changes_(at, column), changes_(at + 1, column), changes_(at + 2, column)};
        };
        const Vector field{e[at], e[at + 1], e[at + 2]}, rates = (1.0 / dt) * Vector{q2[at], q2[at + 1], q2[at + 2]};
        const Vector of_chart = weighted_change(vector(3), field) + weighted_change(vector(4), rates);
        by_q_.segment<3>(at) -= Vector3(of_chart.x, of_chart.y, of_chart.z);
        Vector6 rows, of_field;
        rows << by_q_.segment<3>(at), by_v_.segment<3>(at) / dt;
        of_field << changes_.col(0).segment<3>(at), changes_.col(1).segment<3>(at);
        by_q1.segment<3>(at) += axis_at_start(ball).slope().transpose() * changes_.col(2).segment<3>(at);
        Vector6 by;  // s and d
        if (ball.prescribed) {
            const GivenTurning turning(&q2[at]);
            by = times(rows, turning.slope());
            const Vector6 ends = turning.end_slope().transpose() * end;
            by_q1.segment<3>(at) += ends.head<3>();
            by_q2.segment<3>(at) = ends.tail<3>();
        } else {
            by = times(rows, turned_->turnings[b].slope()) + times(of_field, turned_->fields[b].slope());
        }
        by_q_.segment<3>(at) = by.head<3>();
        by_v_.segment<3>(at) = dt * by.tail<3>();
    }
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
    for (int c = 0; c < nc_; ++c) {
        for_each_entry(*m.constraints[c], at2_, end(), local_, [&](int i, int j, double bend) {
            each_cause(i, [&](int a, double weight_a) {
                each_cause(j,
                           [&](int b, double weight_b) { add_ends(a, b, mu_[nd_ + c] * weight_a * weight_b * bend); });
            });
        });
        note_constraint_at_end(c);
    }
    for (std::size_t b = 0; b < m.balls.size(); ++b) {
        const Ball& ball = m.balls[b];
        if (!ball.prescribed) continue;
        const Eigen::Map<const Eigen::Vector3d> g(&turned_->at_end[ball.variable]), w(&w_rho[ball.variable - nd_]);
        const Eigen::Matrix<double, 6, 6> own = slopes[b].transpose() * symmetric_chart_bend(g) * slopes[b] +
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
