#include "discrete/step_hessian.hpp"

#include <algorithm>
#include <type_traits>

namespace leastaction {

void StepHessian::evaluate(const Mechanism& m, const PairDerivatives& d, const ForcePoint<double>& middle, Split split,
                           double dt, LocalTaylor<double>& local, LocalForce<double>& force) {
    const int nd = m.n_dynamic, nq = m.n_variables();
    by_ends.setZero(2 * nd, 2 * nq);
    by_u.setZero(2 * nd, m.n_inputs);
    const auto add = [&](int i, int j, double d11, double d12, double d21, double d22) {
        if (i >= nd) return;
        by_ends(i, j) += d11;
        by_ends(i, nq + j) += d12;
        by_ends(nd + i, j) += d21;
        by_ends(nd + i, nq + j) += d22;
    };
    each_pair(m, d.stride, [&](int i, int j, std::size_t at, auto weight, bool mirrored) {
        if (!only.empty() && !only[i] && !only[j]) return;
        const double qq = weight * (0.25 * dt * d.qq[at]), vv = weight * (d.vv[at] / dt);
        const double sum = weight * (0.5 * (d.q_v[at] + d.v_q[at])), odd = weight * (0.5 * (d.q_v[at] - d.v_q[at]));
        add(i, j, qq - sum + vv, qq - vv + odd, qq - vv - odd, qq + sum + vv);
        if (mirrored) add(j, i, qq - sum + vv, qq - vv - odd, qq - vv + odd, qq + sum + vv);
    });
    for_each_entry(m.potentials, middle.at, middle.q, local, [&](int i, int j, double bend) {
        const double qq = -0.25 * dt * bend;
        add(i, j, qq, qq, qq, qq);
    });
    const double km = kappa_minus(split, dt), kp = kappa_plus(split, dt);
    const auto add_force = [&](int i, int j, double f_q, double f_v) {
        f_q *= 0.5;
        f_v /= dt;
        add(i, j, km * (f_q - f_v), km * (f_q + f_v), kp * (f_q - f_v), kp * (f_q + f_v));
    };
    const auto add_input = [&](int i, int input, double f_u) {
        if (i >= nd) return;
        by_u(i, input) += km * f_u;
        by_u(nd + i, input) += kp * f_u;
    };
    for (const auto& [i, slot] : m.damping) add_force(i, i, 0.0, -m.numbers[slot]);
    for (const auto& [i, input] : m.joint_forces) add_input(i, input, 1.0);
    for_each_entry(m.forces, middle, force, add_force, add_input);
}

void turn_columns(NewtonMatrix::Matrix& of, int first, int second, const Turning::Matrix6& slope) {
    for (Eigen::Index i = 0; i < of.rows(); ++i) {
        double* row = of.data() + i * of.cols();
        Turning::Vector6 values;
        std::copy_n(row + first, 3, values.data());
        std::copy_n(row + second, 3, values.data() + 3);
        const Turning::Vector6 turned = slope.transpose() * values;
        std::copy_n(turned.data(), 3, row + first);
        std::copy_n(turned.data() + 3, 3, row + second);
    }
}

void turn_rows(NewtonMatrix::Matrix& of, int first, int second, const Turning::Matrix6& slope) {
    constexpr Eigen::Index lanes = 8;
    Eigen::Index j = 0;
    const Eigen::Index n = of.cols();
    const auto turn = [&]<int width>(std::integral_constant<int, width>) {
        using Wide = Eigen::Array<double, width, 1>;
        Wide rows[6];
        for (int k = 0; k < 6; ++k) rows[k] = Eigen::Map<const Wide>(&of((k < 3 ? first : second - 3) + k, j));
        for (int k = 0; k < 6; ++k) {
            Wide sum = slope(0, k) * rows[0];
            for (int l = 1; l < 6; ++l) sum += slope(l, k) * rows[l];
            Eigen::Map<Wide>(&of((k < 3 ? first : second - 3) + k, j)) = sum;
        }
    };
    for (; j + lanes <= n; j += lanes) turn(std::integral_constant<int, lanes>());
    for (; j < n; ++j) turn(std::integral_constant<int, 1>());
}

void StepHessian::turn_columns(const Mechanism& m, const std::vector<Turning>& turnings) {
    for (std::size_t b = 0; b < turnings.size(); ++b) {
        const Ball& ball = m.balls[b];
        const int at = ball.variable, end = m.n_variables() + at;
        if (ball.prescribed)
            leastaction::turn_columns(by_ends, at, end, GivenTurning(turnings[b].phi()).slope());
        else
            leastaction::turn_columns(by_ends, at, end, turnings[b].slope());
    }
}

void StepHessian::turn_rows(const Mechanism& m, const std::vector<Turning>& turnings, const double* start,
                            const double* end) {
    const int nd = m.n_dynamic, nq = m.n_variables();
    for (std::size_t b = 0; b < turnings.size(); ++b) {
        const int at = m.balls[b].variable;
        if (m.balls[b].prescribed) continue;
        leastaction::turn_rows(by_ends, at, nd + at, turnings[b].slope());
        leastaction::turn_rows(by_u, at, nd + at, turnings[b].slope());
        Turning::Vector6 values;
        for (int i = 0; i < 3; ++i) {
            values[i] = start[at + i];
            values[3 + i] = end[at + i];
        }
        // By X_u of the row of X_v: the row is v.
        const Turning::Matrix6 bend = turnings[b].bend(values);
        for (int k = 0; k < 6; ++k)
            for (int l = 0; l < 6; ++l)
                by_ends((k < 3 ? at : nd + at - 3) + k, (l < 3 ? at : nq + at - 3) + l) += bend(l, k);
    }
}

void turn_rows(const Turning& turning, double* start, double* end) {
    Turning::Vector6 values;
    values << start[0], start[1], start[2], end[0], end[1], end[2];
    values = (turning.slope().transpose() * values).eval();
    std::copy_n(values.data(), 3, start);
    std::copy_n(values.data() + 3, 3, end);
}

void turn_rows_of(const Mechanism& m, const std::vector<Turning>& turnings, double* start, double* end, int n) {
    for (std::size_t b = 0; b < turnings.size(); ++b) {
        const int at = m.balls[b].variable;
        if (at < n) turn_rows(turnings[b], start + at, end + at);
    }
}

}  // namespace leastaction
