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
    std::vector<Vector6> along;  // mu and w_p of each ball
    StepHessian table;
    NewtonMatrix::Matrix all, turned;
};

void SecondOrder::begin_balls() {
    if (!mechanism_.balls.empty()) turned_ = std::make_shared<Turned>(mechanism_);
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

void SecondOrder::begin_turned(double dt) {
    const Mechanism& m = mechanism_;
    Turned& t = *turned_;
    t.turnings.clear();
    t.along.clear();
    std::copy(q2.begin(), q2.begin() + nq_, t.end.begin());
    for (const Ball& ball : m.balls) {
        const int at = ball.variable;
        t.turnings.emplace_back(&q2[at]);
        std::fill_n(&t.end[at], 3, 0.0);
        turn_by(&q1[ball.quaternion], &q2[at], 1.0, &t.end[ball.quaternion]);
        Vector6 along;
        for (int i = 0; i < 3; ++i) {
            along[i] = mu_[at + i];
            along[3 + i] = w_p[at + i];
        }
        t.along.push_back(along);
        const Vector6 field = t.turnings.back().slope() * along;
        for (int i = 0; i < 3; ++i) {
            mu_z_[at + i] = field[i];
            w_z_[at + i] = field[3 + i];
        }
    }
    // The rows and their derivatives, in the kernel's coordinates.
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
    t.table.evaluate(m, t.lagrangian, middle, split_, dt, local_, force_);
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

void SecondOrder::turn(double) {
    Turned& t = *turned_;
    const int n = 2 * nq_, at_u = nq_ + nd_;
    auto& W = t.all;
    W.resize(n, n);
    for (int a = 0; a < n; ++a)
        for (int b = a; b < n; ++b) W(a, b) = W(b, a) = entry(a, b);
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
    Eigen::Matrix<double, 6, Eigen::Dynamic> rows;
    for (std::size_t b = 0; b < t.turnings.size(); ++b) {
        const int at = mechanism_.balls[b].variable;
        const Turning& turning = t.turnings[b];
        const Matrix6& slope = turning.slope();
        const auto take_rows = [&](const NewtonMatrix::Matrix& of, int second) {
            rows.resize(6, of.cols());
            rows << of.middleRows(at, 3), of.middleRows(second + at, 3);
        };
        take_rows(W, nq_);
        rows = (slope.transpose() * rows).eval();
        W.middleRows(at, 3) = rows.topRows(3);
        W.middleRows(nq_ + at, 3) = rows.bottomRows(3);
        Eigen::Matrix<double, Eigen::Dynamic, 6> columns(n, 6);
        columns << W.middleCols(at, 3), W.middleCols(nq_ + at, 3);
        columns = (columns * slope).eval();
        W.middleCols(at, 3) = columns.leftCols(3);
        W.middleCols(nq_ + at, 3) = columns.rightCols(3);
    }
    // Once all that is held has been turned, what the fields change by.
    for (std::size_t b = 0; b < t.turnings.size(); ++b) {
        const int at = mechanism_.balls[b].variable;
        Vector6 values;
        for (int i = 0; i < 3; ++i) {
            values[i] = t.start_row[at + i];
            values[3 + i] = t.end_row[at + i];
        }
        const Turning::Field field = t.turnings[b].field(t.along[b], values, by_z[b]);
        const Matrix6 own = field.bend + field.chart;
        const auto place_of = [&](int k) { return k < 3 ? at + k : nq_ + at + k - 3; };
        rows.resize(6, n);
        rows << t.table.by_ends.middleRows(at, 3), t.table.by_ends.middleRows(nd_ + at, 3);
        rows = (field.slope.transpose() * rows).eval();
        for (int k = 0; k < 6; ++k) {
            for (int c = 0; c < n; ++c) {
                W(place_of(k), c) += rows(k, c);
                W(c, place_of(k)) += rows(k, c);
            }
            for (int l = 0; l < 6; ++l) W(place_of(k), place_of(l)) += own(k, l);
        }
        if (nu_ == 0) continue;
        rows.resize(6, nu_);
        rows << W_thth_.block(at, at_u, 3, nu_), W_yth_.block(at, at_u, 3, nu_);
        rows = (t.turnings[b].slope().transpose() * rows).eval();
        Eigen::Matrix<double, 6, Eigen::Dynamic> by_u(6, nu_);
        by_u << t.table.by_u.middleRows(at, 3), t.table.by_u.middleRows(nd_ + at, 3);
        rows += field.slope.transpose() * by_u;
        W_thth_.block(at, at_u, 3, nu_) = rows.topRows(3);
        W_yth_.block(at, at_u, 3, nu_) = rows.bottomRows(3);
    }
    for (int a = 0; a < n; ++a)
        for (int b = a; b < n; ++b) {
            entry(a, b) = W(a, b);
            if (a >= nq_ && b < nq_ + nd_) W_yy_(b - nq_, a - nq_) = W(a, b);
        }
}

// At the start the weighted sum holds -lam.X_mu h, at the end mu_h.h.
void SecondOrder::turn_constraints() {
    const Mechanism& m = mechanism_;
    using Vector3 = Eigen::Vector3d;
    using Matrix3 = Eigen::Matrix3d;
    for (const Ball& ball : m.balls) {
        const int at = ball.variable;
        const TurnedField field(&mu_[at]);
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
        const Matrix3 own = field.bend(at_start) + symmetric_chart_bend(along_mu), chart = symmetric_chart_bend(at_end);
        const Eigen::Matrix<double, 3, Eigen::Dynamic> rows = slope.transpose() * bent;
        for (int i = 0; i < 3; ++i) {
            for (int j = 0; j < nq_; ++j) {
                add_11(at + i, j, rows(i, j));
                add_11(j, at + i, rows(i, j));
            }
            for (int j = 0; j < 3; ++j) {
                add_11(at + i, at + j, own(i, j));
                add_22(at + i, at + j, chart(i, j));
            }
        }
    }
}

}  // namespace leastaction
