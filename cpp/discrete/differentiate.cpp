#include "discrete/differentiate.hpp"

#include <algorithm>

namespace leastaction {

FirstOrder::FirstOrder(const Mechanism& m)
    : n_theta(m.n_variables() + m.n_dynamic + m.n_controls()),
      ld(whole_lanes(n_theta + m.n_constraints())),
      Y(static_cast<std::size_t>(m.n_dynamic + m.n_constraints()) * ld),
      P2(static_cast<std::size_t>(m.n_dynamic) * ld) {}

bool FirstOrder::differentiate(MidpointStep& step, double dt) {
    if (!step.factor_at_solution(dt)) return false;
    const Mechanism& mechanism = step.mechanism();
    const int nd = mechanism.n_dynamic, nk = mechanism.n_kinematic, nq = nd + nk, nc = mechanism.n_constraints();
    const int at_p = nq, at_u = nq + nd, at_rho2 = at_u + mechanism.n_inputs, at_h = n_theta;

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
    const PairDerivatives& d = step.pairs();
    each_pair(mechanism, d.stride, [&](int i, int j, std::size_t at, auto weight, bool mirrored) {
        const double qq = weight * (0.25 * dt * d.qq[at]), vv = weight * (d.vv[at] / dt);
        const double sum = weight * (0.5 * (d.q_v[at] + d.v_q[at])), odd = weight * (0.5 * (d.q_v[at] - d.v_q[at]));
        if (i < nd) add(i, j, qq - sum + vv, qq - vv + odd, qq - vv - odd, qq + sum + vv);
        if (j < nd && mirrored) add(j, i, qq - sum + vv, qq - vv - odd, qq - vv + odd, qq + sum + vv);
    });
    for (int i = 0; i < nd; ++i) Y[i * ld + at_p + i] = -1.0;
    // Rows of elements at the middle: weights by q_i and v_i, times derivatives by q_j and v_j.
    step.turned_middle().visit([&](const auto& turned) {
        const ForcePoint<double> middle = step.middle();
        const double km = kappa_minus(step.split(), dt), kp = kappa_plus(step.split(), dt);
        const double force_at_v = 0.5 * dt * (kp - km);  // of fd- and fd+ as one row at the middle
        const auto add_row = [&](int i, int j, double at_q, double at_v, double by_q, double by_v) {
            if (i >= nd) return;
            spread(turned, i, at_q, at_v, [&](int k, double start, double end) {
                spread(turned, j, by_q, by_v, [&](int l, double by_start, double by_end) {
                    add(k, l, start * by_start, start * by_end, end * by_start, end * by_end);
                });
            });
        };
        const auto add_force = [&](int i, int j, double f_q, double f_v) {
            add_row(i, j, km + kp, force_at_v, f_q, f_v);
        };
        const auto add_input = [&](int i, int input, double f_u) {
            if (i >= nd) return;
            spread(turned, i, km + kp, force_at_v, [&](int k, double start, double end) {
                Y[k * ld + at_u + input] -= start * f_u;
                P2[k * ld + at_u + input] += end * f_u;
            });
        };
        for (const auto& [i, slot] : mechanism.damping) add_force(i, i, 0.0, -mechanism.numbers[slot]);
        for (const auto& [i, input] : mechanism.joint_forces) add_input(i, input, 1.0);
        for_each_entry(mechanism.potentials, middle.at, middle.q, local_,
                       [&](int i, int j, double bend) { add_row(i, j, dt, 0.0, -bend, 0.0); });
        for_each_entry(mechanism.forces, middle, force_, add_force, add_input);
    });
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
    if (!mechanism.balls.empty()) add_balls(step);
    step.newton().solve(Y.data(), Y.data() + nd * ld, n_theta + nc, ld);

    // p2 depends on th through q2 as well.
    multiply_rows<Into::add>(G_y, nd, Y.data(), P2.data(), n_theta + nc, ld);
    return true;
}

void FirstOrder::add_balls(const MidpointStep& step) {
    const Mechanism& mechanism = step.mechanism();
    const int nd = mechanism.n_dynamic, nq = mechanism.n_variables(), nc = mechanism.n_constraints();
    const int at_rho2 = nq + nd + mechanism.n_inputs;
    for (std::size_t b = 0; b < mechanism.balls.size(); ++b) {
        const Ball& ball = mechanism.balls[b];
        const int at = ball.variable;
        if (ball.prescribed) {
            if (nc == 0) continue;
            const GivenTurning::Matrix36 end = GivenTurning(&step.q2[at]).end_slope();
            for (int c = 0; c < nc; ++c) {
                const Eigen::Map<const Eigen::Vector3d> by_end(step.end_gradients() + c * nq + at);
                const Eigen::Matrix<double, 6, 1> by = end.transpose() * by_end;
                double* y = &Y[(nd + c) * ld];
                for (int i = 0; i < 3; ++i) {
                    y[at + i] -= by[i];
                    y[at_rho2 + at - nd + i] = -by[3 + i];
                }
            }
            continue;
        }
        // Half the commutator: X_u of the row of v, by u x v of each end.
        const auto [start, end] = step.turned_rows(ball);
        const auto add_crossing = [&](int i, int j, double at_start, double at_end) {
            Y[(at + i) * ld + at + j] += 0.5 * at_start, Y[(at + j) * ld + at + i] -= 0.5 * at_start;
            G_y(at + i, at + j) -= 0.5 * at_end, G_y(at + j, at + i) += 0.5 * at_end;
        };
        add_crossing(0, 1, start.z, end.z);
        add_crossing(1, 2, start.x, end.x);
        add_crossing(2, 0, start.y, end.y);
        if (nc == 0 && mechanism.instant_forces.empty()) continue;
        Eigen::Vector3d slope = Eigen::Vector3d::Zero();
        for_each_entry(mechanism.instant_forces, step.instant(), force_, [&](int i, double f) {
            if (i >= ball.variable && i < ball.variable + 3) slope[i - ball.variable] -= step.share * f;
        });
        for (int c = 0; c < nc; ++c)
            for (int i = 0; i < 3; ++i) slope[i] += step.lam[c] * step.start_gradients()[c * nq + at + i];
        const Eigen::Matrix3d by_constraints = chart_bend(slope);
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j) Y[(at + i) * ld + at + j] += by_constraints(j, i);
    }
}

}  // namespace leastaction
