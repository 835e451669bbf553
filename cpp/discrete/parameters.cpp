#include "discrete/parameters.hpp"

namespace leastaction {

namespace {

// Products of second derivatives at the midpoint with its velocity, by variable: L_qv v, L_vv v, f_v v, and the force f.
struct AlongVelocity {
    std::vector<double> L_qv, L_vv, f_v, f;
};

AlongVelocity along_velocity(const MidpointStep& step) {
    const Mechanism& m = step.mechanism();
    const std::vector<double> none(m.n_variables());
    AlongVelocity out{none, none, none, none};
    const ForcePoint<double> at = step.middle();
    const PairDerivatives& d = step.lagrangian().pairs;
    each_pair(m, d.stride, [&](int i, int j, std::size_t pair, auto weight, bool mirrored) {
        out.L_qv[i] += weight * (d.q_v[pair] * at.v[j]);
        out.L_vv[i] += weight * (d.vv[pair] * at.v[j]);
        if (!mirrored) return;
        out.L_qv[j] += weight * (d.v_q[pair] * at.v[i]);
        out.L_vv[j] += weight * (d.vv[pair] * at.v[i]);
    });
    for (const auto& [i, slot] : m.damping) {
        out.f[i] -= m.numbers[slot] * at.v[i];
        out.f_v[i] -= m.numbers[slot] * at.v[i];
    }
    for (const auto& [i, input] : m.joint_forces) out.f[i] += at.u[input];
    LocalForce<double> local;
    for_each_entry(m.forces, at, local, [&](int i, double f) { out.f[i] += f; });
    for_each_entry(
        m.forces, at, local, [&](int i, int j, double, double f_v) { out.f_v[i] += f_v * at.v[j]; },
        [](int, int, double) {});
    return out;
}

}  // namespace

ParameterSlopes differentiate_by(MidpointStep& step, const FirstOrder& first, double dt,
                                 const std::vector<Parameter>& parameters) {
    const Mechanism& m = step.mechanism();
    const int nd = m.n_dynamic, nq = m.n_variables(), nc = m.n_constraints(), ny = nd + nc;
    const int count = static_cast<int>(parameters.size());
    const double km = kappa_minus(step.split(), dt), kp = kappa_plus(step.split(), dt);
    const int ld = (count + NewtonMatrix::lanes - 1) / NewtonMatrix::lanes * NewtonMatrix::lanes;
    ParameterSlopes out{ld, AlignedVector(static_cast<std::size_t>(ny) * ld),
                        AlignedVector(static_cast<std::size_t>(nd) * ld)};
    const ForcePoint<double> at = step.middle();
    Placement<Dual<double>> start(m), end(m), middle(m);
    const auto still = [](const double* q, int n) { return std::vector<Dual<double>>(q, q + n); };
    const auto Q1 = still(step.q1.data(), nq), Q2 = still(step.q2.data(), nq), Q = still(at.q, nq), V = still(at.v, nq);
    const auto U = still(at.u, m.n_inputs);
    const std::vector<Dual<double>> none(nq);
    place(m.constraint_joints, Q1.data(), start);
    place(m.instant_joints, Q1.data(), start);
    place(m.constraint_joints, Q2.data(), end);
    place(m.element_joints, Q.data(), middle);
    LocalTaylor<Dual<double>> local;
    LocalForce<Dual<double>> force_taylor;
    LocalForce<double> instant_taylor;
    std::vector<double> L_q(nq), L_v(nq), f(nq), kick(nq);
    for (int k = 0; k < count; ++k) {
        const Parameter& parameter = parameters[k];
        for (auto* a : {&L_q, &L_v, &f, &kick}) std::fill(a->begin(), a->end(), 0.0);
        const auto y = [&](int row) -> double& { return out.Y[row * ld + k]; };
        for (const auto& [joint, inertia] : parameter.inertias)
            step.lagrangian().add_inertia_slope(joint, inertia, L_q, L_v);
        if (!parameter.numbers.empty()) {
            const double* g = parameter.numbers.data() + m.gravity_slot;
            if (m.gravity_slot >= 0) step.lagrangian().add_gravity_slope({g[0], g[1], g[2]}, L_q);
            start.number_slopes = end.number_slopes = middle.number_slopes = parameter.numbers.data();
            for (const auto& [i, slot] : m.damping) f[i] -= parameter.numbers[slot] * at.v[i];
            for_each_entry(m.potentials, middle, Q.data(), local,
                           [&](int i, const Dual<double>& slope) { L_q[i] -= slope.d; });
            for_each_entry(m.forces, ForcePoint<Dual<double>>{middle, Q.data(), V.data(), U.data()}, force_taylor,
                           [&](int i, const Dual<double>& force) { f[i] += force.d; });
            for_each_entry(m.instant_forces, ForcePoint<Dual<double>>{start, Q1.data(), none.data(), U.data()},
                           force_taylor, [&](int i, const Dual<double>& force) { kick[i] += step.share * force.d; });
            for (int c = 0; c < nc; ++c) {
                for_each_entry(*m.constraints[c], start, Q1.data(), local, [&](int i, const Dual<double>& slope) {
                    if (i < nd) y(i) += step.lam[c] * slope.d;
                });
                m.constraints[c]->evaluate(end, Q2.data(), Order::value, local);
                y(nd + c) = -local.value.d;
            }
        }
        if (parameter.time_step) {
            const AlongVelocity along = along_velocity(step);
            for (int i = 0; i < nd; ++i) {
                L_q[i] += (step.lagrangian().L_q[i] - along.L_qv[i]) / dt;
                L_v[i] -= along.L_vv[i] / dt;
                f[i] += (along.f[i] - along.f_v[i]) / dt;
            }
            const double grows = step.share / dt;
            for (const auto& [i, input] : m.instant_joint_forces) kick[i] += grows * at.u[input];
            for_each_entry(m.instant_forces, step.instant(), instant_taylor,
                           [&](int i, double force) { kick[i] += grows * force; });
        }
        for (int i = 0; i < nd; ++i) {
            y(i) -= 0.5 * dt * L_q[i] - L_v[i] + km * f[i] + kick[i];
            out.P2[i * ld + k] = 0.5 * dt * L_q[i] + L_v[i] + kp * f[i];
        }
    }
    step.newton().solve(out.Y.data(), out.Y.data() + nd * ld, count, ld);
    Eigen::Map<NewtonMatrix::Matrix> p2(out.P2.data(), nd, ld);
    p2.noalias() += first.G_y * Eigen::Map<NewtonMatrix::Matrix>(out.Y.data(), nd, ld);
    return out;
}

}  // namespace leastaction
