#include "discrete/parameters.hpp"

#include <algorithm>

namespace leastaction {

NumberDuals::NumberDuals(const Mechanism& m) : start(m), end(m), middle(m), m_(m), still_(m.n_variables()) {}

void NumberDuals::place_at(const MidpointStep& step, double dt) {
    start.time = step.t;
    middle.time = step.t + 0.5 * dt;
    end.time = step.t + dt;
    const ForcePoint<double> at = step.middle();
    Q1.assign(step.q1.begin(), step.q1.end());
    Q2.assign(step.end(), step.end() + m_.n_coordinates());
    Q.assign(at.q, at.q + m_.n_coordinates());
    V.assign(at.v, at.v + m_.n_variables());
    U_.assign(at.u, at.u + m_.n_inputs);
    place(m_.constraint_joints, Q1.data(), start);
    place(m_.instant_joints, Q1.data(), start);
    place(m_.constraint_joints, Q2.data(), end);
    place(m_.element_joints, Q.data(), middle);
}

void NumberDuals::look(const double* numbers, const double* direction) {
    for (auto* at : {&start, &end, &middle}) {
        at->numbers = numbers;
        at->number_slopes = direction;
        at->time.d = 0;
    }
}

ParameterSlopes::ParameterSlopes(const Mechanism& mechanism)
    : duals(mechanism), m_(mechanism), still_(mechanism.numbers.size()) {
    for (auto* a : {&L_q, &L_v, &f, &kick_, &L_qv_v_, &L_vv_v_, &f_v_v_, &force_, &start_, &end_})
        a->resize(m_.n_variables());
}

void ParameterSlopes::set_along_velocity(MidpointStep& step) {
    for (auto* a : {&L_qv_v_, &L_vv_v_, &f_v_v_, &force_}) std::fill(a->begin(), a->end(), 0.0);
    const ForcePoint<double> at = step.middle();
    const PairDerivatives& d = step.kernel_pairs();
    each_pair(m_, d.stride, [&](int i, int j, std::size_t pair, auto weight, bool mirrored) {
        L_qv_v_[i] += weight * (d.q_v[pair] * at.v[j]);
        L_vv_v_[i] += weight * (d.vv[pair] * at.v[j]);
        if (!mirrored) return;
        L_qv_v_[j] += weight * (d.v_q[pair] * at.v[i]);
        L_vv_v_[j] += weight * (d.vv[pair] * at.v[i]);
    });
    for (const auto& [i, slot] : m_.damping) {
        force_[i] -= m_.numbers[slot] * at.v[i];
        f_v_v_[i] -= m_.numbers[slot] * at.v[i];
    }
    for (const auto& [i, input] : m_.joint_forces) force_[i] += at.u[input];
    for_each_entry(m_.forces, at, local_, [&](int i, double f) { force_[i] += f; });
    for_each_entry(
        m_.forces, at, local_, [&](int i, int j, double, double f_v) { f_v_v_[i] += f_v * at.v[j]; },
        [](int, int, double) {});
}

void ParameterSlopes::add_time_step(MidpointStep& step, double dt) {
    set_along_velocity(step);
    for (int i = 0; i < m_.n_dynamic; ++i) {
        L_q[i] += (step.lagrangian().L_q[i] - L_qv_v_[i]) / dt;
        L_v[i] -= L_vv_v_[i] / dt;
        f[i] += (force_[i] - f_v_v_[i]) / dt;
    }
    const double grows = step.share / dt;
    for (const auto& [i, input] : m_.instant_joint_forces) kick_[i] += grows * step.middle().u[input];
    for_each_entry(m_.instant_forces, step.instant(), local_, [&](int i, double force) { kick_[i] += grows * force; });
}

void ParameterSlopes::add_numbers(const Parameter& parameter, const MidpointStep& step, int column) {
    const double* direction = parameter.numbers.empty() ? still_.data() : parameter.numbers.data();
    duals.look(m_.numbers.data(), direction);
    duals.start.time.d = parameter.time;
    duals.middle.time.d = parameter.middle_time();
    duals.end.time.d = parameter.end_time();
    for (const auto& [i, slot] : m_.damping) f[i] -= direction[slot] * step.middle().v[i];
    for (const Rotor& rotor : m_.rotors)
        rotor.each_momentum(duals.middle, duals.V.data(),
                            [&](int i, const Dual<double>& momentum) { L_v[i] += momentum.d; });
    for_each_entry(m_.potentials, duals.middle, duals.Q.data(), duals.local,
                   [&](int i, const Dual<double>& slope) { L_q[i] -= slope.d; });
    for_each_entry(m_.forces, duals.at_middle(), duals.force,
                   [&](int i, const Dual<double>& force) { f[i] += force.d; });
    for_each_entry(m_.instant_forces, duals.at_start(), duals.force,
                   [&](int i, const Dual<double>& force) { kick_[i] += step.share * force.d; });
    const int nd = m_.n_dynamic;
    for (int c = 0; c < m_.n_constraints(); ++c) {
        for_each_entry(*m_.constraints[c], duals.start, duals.Q1.data(), duals.local,
                       [&](int i, const Dual<double>& slope) {
                           if (i < nd) Y[i * ld + column] += step.lam[c] * slope.d;
                       });
        m_.constraints[c]->evaluate(duals.end, duals.Q2.data(), Order::value, duals.local);
        Y[(nd + c) * ld + column] = -duals.local.value.d;
    }
}

void ParameterSlopes::differentiate(MidpointStep& step, const FirstOrder& first, double dt,
                                    const std::vector<Parameter>& parameters) {
    const int nd = m_.n_dynamic, ny = nd + m_.n_constraints(), count = static_cast<int>(parameters.size());
    const double km = kappa_minus(step.split(), dt), kp = kappa_plus(step.split(), dt);
    ld = whole_lanes(count);
    Y.assign(static_cast<std::size_t>(ny) * ld, 0.0);
    P2.assign(static_cast<std::size_t>(nd) * ld, 0.0);
    const auto by_duals = [&](const Parameter& p) {
        return !p.numbers.empty() || (m_.time_slot >= 0 && p.middle_time() != 0);
    };
    if (std::any_of(parameters.begin(), parameters.end(), by_duals)) duals.place_at(step, dt);
    for (int k = 0; k < count; ++k) {
        const Parameter& parameter = parameters[k];
        for (auto* a : {&L_q, &L_v, &f, &kick_}) std::fill(a->begin(), a->end(), 0.0);
        for (const auto& [joint, inertia] : parameter.inertias)
            step.lagrangian().add_inertia_slope(joint, inertia, L_q, L_v);
        if (!parameter.numbers.empty() && m_.gravity_slot >= 0) {
            const double* g = parameter.numbers.data() + m_.gravity_slot;
            step.lagrangian().add_gravity_slope({g[0], g[1], g[2]}, L_q);
        }
        if (by_duals(parameter)) add_numbers(parameter, step, k);
        if (parameter.time_step) add_time_step(step, dt);
        for (int i = 0; i < nd; ++i) {
            start_[i] = 0.5 * dt * L_q[i] - L_v[i] + km * f[i];
            end_[i] = 0.5 * dt * L_q[i] + L_v[i] + kp * f[i];
        }
        step.turn_rows(start_.data(), end_.data(), nd);
        for (int i = 0; i < nd; ++i) {
            Y[i * ld + k] -= start_[i] + kick_[i];
            P2[i * ld + k] = end_[i];
        }
    }
    step.newton().solve(Y.data(), Y.data() + nd * ld, count, ld);
    multiply_rows<Into::add>(first.G_y, nd, Y.data(), P2.data(), count, ld);
}

}  // namespace leastaction
