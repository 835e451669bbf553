#include "discrete/step_hessian.hpp"

#include <algorithm>

namespace leastaction {

void StepHessian::evaluate(const Mechanism& m, const Lagrangian<double>& lagrangian, const ForcePoint<double>& middle,
                           Split split, double dt, LocalTaylor<double>& local, LocalForce<double>& force) {
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
    const PairDerivatives& d = lagrangian.pairs;
    each_pair(m, d.stride, [&](int i, int j, std::size_t at, auto weight, bool mirrored) {
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

void StepHessian::turn_columns(const Mechanism& m, const std::vector<Turning>& turnings) {
    const int nq = m.n_variables();
    for (std::size_t b = 0; b < turnings.size(); ++b) {
        const int at = m.balls[b].variable;
        const Turning::Matrix6 slope =
            m.balls[b].prescribed ? GivenTurning(turnings[b].phi()).slope() : turnings[b].slope();
        Eigen::Matrix<double, Eigen::Dynamic, 6> columns(by_ends.rows(), 6);
        columns << by_ends.middleCols(at, 3), by_ends.middleCols(nq + at, 3);
        columns = (columns * slope).eval();
        by_ends.middleCols(at, 3) = columns.leftCols(3);
        by_ends.middleCols(nq + at, 3) = columns.rightCols(3);
    }
}

void StepHessian::turn_rows(const Mechanism& m, const std::vector<Turning>& turnings, const double* start,
                            const double* end) {
    const int nd = m.n_dynamic, nq = m.n_variables();
    for (std::size_t b = 0; b < turnings.size(); ++b) {
        const int at = m.balls[b].variable;
        if (m.balls[b].prescribed) continue;
        for (auto* table : {&by_ends, &by_u}) {
            Eigen::Matrix<double, 6, Eigen::Dynamic> rows(6, table->cols());
            rows << table->middleRows(at, 3), table->middleRows(nd + at, 3);
            rows = (turnings[b].slope().transpose() * rows).eval();
            table->middleRows(at, 3) = rows.topRows(3);
            table->middleRows(nd + at, 3) = rows.bottomRows(3);
        }
        Turning::Vector6 values;
        for (int i = 0; i < 3; ++i) {
            values[i] = start[at + i];
            values[3 + i] = end[at + i];
        }
        // By X_u of the row of X_v: the row is v.
        const Turning::Matrix6 bend = turnings[b].bend(values).transpose();
        by_ends.block(at, at, 3, 3) += bend.topLeftCorner(3, 3);
        by_ends.block(at, nq + at, 3, 3) += bend.topRightCorner(3, 3);
        by_ends.block(nd + at, at, 3, 3) += bend.bottomLeftCorner(3, 3);
        by_ends.block(nd + at, nq + at, 3, 3) += bend.bottomRightCorner(3, 3);
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
