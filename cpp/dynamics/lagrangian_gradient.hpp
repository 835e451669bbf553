// The gradient of the Lagrangian, for the two files that compile it: with balls that turn along exp, and without.
#pragma once

#include <algorithm>

#include "dynamics/lagrangian.hpp"

namespace leastaction {

template <class T>
template <bool has_balls>
void Lagrangian<T>::gradient_with(const T* q, const T* v) {
    const Mechanism& m = mechanism_;
    const int n = m.n_massive;
    place(m.massive_joints, q, at);
    for (int i = 0; i < n; ++i) {
        const Joint& joint = m.joints[i];
        const Motion<T>& S = at.twist[i];
        const T rate = joint.rate(v);
        V_[i] = joint.parent < 0 ? rate * S : V_[joint.parent] + rate * S;
        if (has_balls && ball_of_[i] >= 0) {
            const int before = m.joints[ball_of_[i]].parent;
            W_[i] = before < 0 ? Motion<T>{} : cross(S, V_[before]);
        } else {
            W_[i] = cross(S, V_[i]);
        }

        const Body& body = m.bodies[i];
        m_[i] = T(body.mass);
        if (body.is_empty()) {  // one of several joints in a row: no body of its own
            h_[i] = h_own_[i] = Vec3<T>{};
            H_[i] = H_own_[i] = Force<T>{};
            continue;
        }
        const Pose<T>& pose = at.pose[i];
        const Vec3<T> c = pose.R * body.com + pose.p;
        const Vec3<T> momentum = body.mass * (V_[i].v + cross(V_[i].w, c));
        h_[i] = h_own_[i] = body.mass * c;
        const Vec3<T> spin = pose.R * (body.inertia * transposed_times(pose.R, V_[i].w));
        H_[i] = H_own_[i] = {momentum, spin + cross(c, momentum)};
    }
    const Vec3<double>& g = m.gravity;
    std::fill(L_q.begin(), L_q.end(), T{});
    std::fill(L_v.begin(), L_v.end(), T{});
    for (int i = n - 1; i >= 0; --i) {
        const Joint& joint = m.joints[i];
        const Motion<T>& S = at.twist[i];
        const T momentum = dot(H_[i], S);
        const T weight = m_[i] * dot(g, S.v) + dot(cross(h_[i], g), S.w), slope = weight - dot(H_[i], W_[i]);
        if (m.plain)
            L_v[joint.variable] = momentum, L_q[joint.variable] = slope;
        else
            joint.each_term([&](int variable, double factor) {
                L_v[variable] += factor * momentum;
                L_q[variable] += factor * slope;
            });
        if (joint.parent >= 0) {
            H_[joint.parent] += H_[i];
            h_[joint.parent] += h_[i];
            m_[joint.parent] += m_[i];
        }
    }
    twice_of_rotors_ = T{};
    for (const Rotor& rotor : m.rotors)
        rotor.each_momentum(m, v, [&](int variable, const T& momentum) {
            L_v[variable] += momentum;
            twice_of_rotors_ += momentum * v[variable];
        });
}

extern template void Lagrangian<double>::gradient_with<true>(const double*, const double*);
extern template void Lagrangian<Dual<double>>::gradient_with<true>(const Dual<double>*, const Dual<double>*);
extern template void Lagrangian<HyperDual>::gradient_with<true>(const HyperDual*, const HyperDual*);
extern template void Lagrangian<Lanes>::gradient_with<true>(const Lanes*, const Lanes*);

}  // namespace leastaction
