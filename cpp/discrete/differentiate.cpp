#include "discrete/differentiate.hpp"

#include <algorithm>

#include "discrete/step_hessian.hpp"

namespace leastaction {

FirstOrder::FirstOrder(const Mechanism& m)
    : n_theta(m.n_variables() + m.n_dynamic + m.n_controls()),
      ld((n_theta + m.n_constraints() + NewtonMatrix::lanes - 1) / NewtonMatrix::lanes * NewtonMatrix::lanes),
      Y(static_cast<std::size_t>(m.n_dynamic + m.n_constraints()) * ld),
      P2(static_cast<std::size_t>(m.n_dynamic) * ld) {}

void FirstOrder::take(const MidpointStep& step) {
    const Mechanism& m = step.mechanism();
    const int nd = m.n_dynamic, nk = m.n_kinematic, nq = nd + nk, ni = m.n_inputs, at_u = nq + nd, at_rho2 = at_u + ni;
    const StepHessian& table = step.table();
    using Rows = Eigen::Map<NewtonMatrix::Matrix>;
    Rows y(Y.data(), nd, ld), p2(P2.data(), nd, ld);
    y.leftCols(nq) = -table.by_ends.topLeftCorner(nd, nq);
    y.middleCols(at_u, ni) = -table.by_u.topRows(nd);
    y.middleCols(at_rho2, nk) = -table.by_ends.topRightCorner(nd, nk);
    p2.leftCols(nq) = table.by_ends.bottomLeftCorner(nd, nq);
    p2.middleCols(at_u, ni) = table.by_u.bottomRows(nd);
    p2.middleCols(at_rho2, nk) = table.by_ends.bottomRightCorner(nd, nk);
    G_y = table.by_ends.block(nd, nq, nd, nd);
}

bool FirstOrder::differentiate(MidpointStep& step, double dt) {
    if (!step.factor_at_solution(dt)) return false;
    const Mechanism& mechanism = step.mechanism();
    const int nd = mechanism.n_dynamic, nk = mechanism.n_kinematic, nq = nd + nk, nc = mechanism.n_constraints();
    const int at_p = nq, at_u = nq + nd, at_rho2 = at_u + mechanism.n_inputs, at_h = n_theta;
    const double km = kappa_minus(step.split(), dt), kp = kappa_plus(step.split(), dt);
    const ForcePoint<double> middle = step.middle();

    // The right-hand side -F_th, solved in place for Y, and the direct part of dp2/dth; G_y = dp2/dq2.
    std::fill(Y.begin(), Y.end(), 0.0);
    std::fill(P2.begin(), P2.end(), 0.0);
    G_y.setZero(nd, nd);
    // Second derivatives of Ld for rows i, dynamic: by q1_i q1_j, q1_i q2_j, q2_i q1_j and q2_i q2_j.
    const auto add = [&](int i, int j, double d11, double d12, double d21, double d22) {
        Y[i * ld + j] -= d11;
        P2[i * ld + j] += d21;
        if (j < nd) {
            G_y(i, j) += d22;
        } else {
            Y[i * ld + at_rho2 + j - nd] -= d12;
            P2[i * ld + at_rho2 + j - nd] += d22;
        }
    };
    const bool turns = !mechanism.balls.empty();
    if (turns) take(step);
    const PairDerivatives& d = step.lagrangian().pairs;
    if (!turns)
        each_pair(mechanism, d.stride, [&](int i, int j, std::size_t at, auto weight, bool mirrored) {
            const double qq = weight * (0.25 * dt * d.qq[at]), vv = weight * (d.vv[at] / dt);
            const double sum = weight * (0.5 * (d.q_v[at] + d.v_q[at])), odd = weight * (0.5 * (d.q_v[at] - d.v_q[at]));
            if (i < nd) add(i, j, qq - sum + vv, qq - vv + odd, qq - vv - odd, qq + sum + vv);
            if (j < nd && mirrored) add(j, i, qq - sum + vv, qq - vv - odd, qq - vv + odd, qq + sum + vv);
        });
    for (int i = 0; i < nd; ++i) Y[i * ld + at_p + i] = -1.0;
    const auto add_force = [&](int i, int j, double f_q, double f_v) {
        if (i >= nd) return;
        f_q *= 0.5;
        f_v /= dt;
        add(i, j, km * (f_q - f_v), km * (f_q + f_v), kp * (f_q - f_v), kp * (f_q + f_v));
    };
    const auto add_input = [&](int i, int input, double f_u) {
        if (i >= nd) return;
        Y[i * ld + at_u + input] -= km * f_u;
        P2[i * ld + at_u + input] += kp * f_u;
    };
    if (!turns) {
        for (const auto& [i, slot] : mechanism.damping) add_force(i, i, 0.0, -mechanism.numbers[slot]);
        for (const auto& [i, input] : mechanism.joint_forces) add_input(i, input, 1.0);
        for_each_entry(mechanism.potentials, middle.at, middle.q, local_, [&](int i, int j, double bend) {
            const double qq = -0.25 * dt * bend;
            if (i < nd) add(i, j, qq, qq, qq, qq);
        });
        for_each_entry(mechanism.forces, middle, force_, add_force, add_input);
    }
    const auto add_instant_input = [&](int i, int input, double f_u) {
        if (i < nd) Y[i * ld + at_u + input] -= step.share * f_u;
    };
    const auto add_instant_force = [&](int i, int j, double f_q, double) {
        if (i < nd) Y[i * ld + j] -= step.share * f_q;
    };
    for (const auto& [i, input] : mechanism.instant_joint_forces) add_instant_input(i, input, 1.0);
    for_each_entry(mechanism.instant_forces, step.instant(), force_, add_instant_force, add_instant_input);
    for (int c = 0; c < nc; ++c) {
        for_each_entry(*mechanism.constraints[c], step.start(), step.q1.data(), local_, [&](int i, int j, double bend) {
            if (i < nd) Y[i * ld + j] += step.lam[c] * bend;
        });
        double* y = &Y[(nd + c) * ld];
        for (int k = 0; k < nk; ++k) y[at_rho2 + k] = -step.end_gradients()[c * nq + nd + k];
        y[at_h + c] = -1.0;  // a shift of h: F2 = h + s
    }
    for (const Ball& ball : mechanism.balls) {
        if (ball.prescribed) {
            const GivenTurning::Matrix36 end = GivenTurning(&step.q2[ball.variable]).end_slope();
            for (int c = 0; c < nc; ++c) {
                const Eigen::Map<const Eigen::Vector3d> by_end(step.end_gradients() + c * nq + ball.variable);
                const Turning::Vector6 by = end.transpose() * by_end;
                double* y = &Y[(nd + c) * ld];
                for (int i = 0; i < 3; ++i) {
                    y[ball.variable + i] -= by[i];
                    y[at_rho2 + ball.variable - nd + i] = -by[3 + i];
                }
            }
            continue;
        }
        Eigen::Vector3d slope = Eigen::Vector3d::Zero();
        for_each_entry(mechanism.instant_forces, step.instant(), force_, [&](int i, double f) {
            if (i >= ball.variable && i < ball.variable + 3) slope[i - ball.variable] -= step.share * f;
        });
        for (int c = 0; c < nc; ++c)
            for (int i = 0; i < 3; ++i) slope[i] += step.lam[c] * step.start_gradients()[c * nq + ball.variable + i];
        const Eigen::Matrix3d bend = chart_bend(slope);
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j) Y[(ball.variable + i) * ld + ball.variable + j] += bend(j, i);
    }
    step.newton().solve(Y.data(), Y.data() + nd * ld, n_theta + nc, ld);

    // p2 depends on th through q2 as well.
    using Rows = Eigen::Map<NewtonMatrix::Matrix>;
    Rows p2_rows(P2.data(), nd, ld), q2_rows(Y.data(), nd, ld);
    p2_rows.noalias() += G_y * q2_rows;
    return true;
}

}  // namespace leastaction
