#include "elements/wrench.hpp"

#include <algorithm>

namespace leastaction {

namespace {

template <class T>
Vec3<T> vector_of(const T* a) {
    return {a[0], a[1], a[2]};
}

Motion<double>& operator+=(Motion<double>& a, const Motion<double>& b) { return a = a + b; }

}  // namespace

Wrench::Wrench(const Constants& constants, Kind kind, int joint, int point, const std::array<int, 3>& axes,
               const std::array<int, 6>& slots, const std::array<int, 6>& inputs)
    : kind_(kind),
      support_joints_(constants.joints, joints_above(constants.joints, joint)),
      point_(point),
      axes_(axes),
      slots_(slots) {
    support_ = support_joints_.support();
    joints_ = support_joints_.joints();
    for (int c = 0; c < 6; ++c) {
        local_inputs_[c] = -1;
        if (inputs[c] < 0) continue;
        const auto found = std::find(inputs_.begin(), inputs_.end(), inputs[c]);
        local_inputs_[c] = static_cast<int>(found - inputs_.begin());
        if (found == inputs_.end()) inputs_.push_back(inputs[c]);
    }
}

// The number of a component; without one that of an input is 1.
template <class T>
T Wrench::gain(const Placement<T>& at, int c) const {
    return slots_[c] >= 0 ? at.number(slots_[c]) : T(local_inputs_[c] >= 0 ? 1.0 : 0.0);
}

template <class T>
void Wrench::components(const ForcePoint<T>& point, T* out) const {
    for (int c = 0; c < 6; ++c) {
        out[c] = gain(point.at, c);
        if (local_inputs_[c] >= 0) out[c] = out[c] * point.u[inputs_[local_inputs_[c]]];
    }
}

template <class T>
Force<T> Wrench::about_origin(const Placement<T>& at, const T* components) const {
    Force<T> phi{vector_of(components), vector_of(components + 3)};
    if (kind_ == Kind::body) {
        const auto turned = [&](const Vec3<T>& a) {
            return a.x * at.direction(axes_[0]) + a.y * at.direction(axes_[1]) + a.z * at.direction(axes_[2]);
        };
        phi = {turned(phi.f), turned(phi.n)};
    }
    if (kind_ != Kind::spatial) phi.n += cross(at.position(point_), phi.f);
    return phi;
}

// By the terms of the joints, onto the variables of the support.
template <class T>
void Wrench::add_force(const Placement<T>& at, const T* components, std::vector<T>& f) const {
    const Force<T> phi = about_origin(at, components);
    for (int i = 0; i < support_joints_.count(); ++i) {
        const T power = dot(phi, at.twist[support_joints_.joint(i)]);
        for (const Term& term : support_joints_.terms(i)) f[term.variable] += term.factor * power;
    }
}

// df_i/dq_j by joints.
template <class T>
T Wrench::slope(const Placement<T>& at, const Force<T>& phi, const Vec3<T>& F, int i, int j) const {
    const Motion<T>&S_i = at.twist[support_joints_.joint(i)], &S_j = at.twist[support_joints_.joint(j)];
    T out{};
    switch (kind_) {
        case Kind::spatial:
            if (j < i) out = dot(phi, cross(S_j, S_i));
            break;
        case Kind::body:  // Phi is carried along by j, and so is S_i where i is behind it
            if (j > i) out = dot(phi, cross(S_i, S_j));
            break;
        case Kind::hybrid:
            if (j < i) out = dot(phi, cross(S_j, S_i));
            out += dot(cross(S_j.v + cross(S_j.w, at.position(point_)), F), S_i.w);
            break;
    }
    return out;
}

template <class T>
void Wrench::evaluate_on(const ForcePoint<T>& point, Order order, LocalForce<T>& out) const {
    const std::size_t m = support_.size(), r = inputs_.size();
    T w[6];
    components(point, w);
    out.f.assign(m, T{});
    add_force(point.at, w, out.f);
    if (order == Order::value) return;

    out.f_q.assign(m * m, T{});
    out.f_v.assign(m * m, T{});
    out.f_u.assign(m * r, T{});
    const Force<T> phi = about_origin(point.at, w);
    const Vec3<T> F = vector_of(w);
    for (int i = 0; i < support_joints_.count(); ++i)
        for (int j = 0; j < support_joints_.count(); ++j) {
            const T value = slope(point.at, phi, F, i, j);
            for (const Term& a : support_joints_.terms(i))
                for (const Term& b : support_joints_.terms(j))
                    out.f_q[a.variable * m + b.variable] += a.factor * b.factor * value;
        }
    for (int c = 0; c < 6; ++c) {
        if (local_inputs_[c] < 0) continue;
        T unit[6] = {};
        unit[c] = gain(point.at, c);
        out.work.assign(m, T{});
        add_force(point.at, unit, out.work);
        for (std::size_t i = 0; i < m; ++i) out.f_u[i * r + local_inputs_[c]] += out.work[i];
    }
}

void Wrench::first_by_place(const Placement<double>& at, const double* components, const std::vector<double>& mu,
                            std::vector<double>& P) const {
    const Force<double> phi = about_origin(at, components);
    const Vec3<double> F = vector_of(components);
    for (int j = 0; j < support_joints_.count(); ++j) {
        P[j] = 0;
        for (int i = 0; i < support_joints_.count(); ++i)
            if (mu[i] != 0.0) P[j] += mu[i] * slope(at, phi, F, i, j);
    }
}

// Second derivatives of mu.f = Phi.X, X = sum mu_i S_i, by joints j <= k of the row:
//   spatial   -(S_j x* Phi).(S_k x X_k), X_k the sum over i behind k, from d2S_i/dq_j dq_k = S_j x (S_k x S_i);
//   body      (S_k x* Phi).(X_j x S_j), X_j the sum over i before j;
//   hybrid    the torque as a spatial wrench without a force, and F.d2(dp)/dq_j dq_k, dp = sum mu_i dp/dq_i, where the third
//             derivative of a place by a <= b <= c is w_a x (w_b x dp/dq_c).
void Wrench::second_by_place(const Placement<double>& at, const double* components, const std::vector<double>& mu,
                             std::vector<double>& P) const {
    const int n = support_joints_.count();
    const Force<double> phi = about_origin(at, components);
    const Vec3<double> F = vector_of(components), torque = vector_of(components + 3);
    const auto S = [&](int i) -> const Motion<double>& { return at.twist[support_joints_.joint(i)]; };
    const Vec3<double> p = at.position(point_);
    const auto moves = [&](int i) { return S(i).v + cross(S(i).w, p); };
    for (int k = 0; k < n; ++k) {
        Motion<double> behind;      // sum over i > k
        Vec3<double> moved_behind;  // of dp/dq_i
        for (int i = k + 1; i < n; ++i) {
            behind += mu[i] * S(i);
            moved_behind += mu[i] * moves(i);
        }
        Motion<double> before;  // sum over i < j
        for (int j = 0; j <= k; ++j) {
            double value = 0;
            if (kind_ == Kind::spatial) {
                value = dot(phi, cross(S(j), cross(S(k), behind)));
            } else if (kind_ == Kind::body) {
                value = dot(cross_dual(S(k), phi), cross(before, S(j)));
            } else {
                const Vec3<double> w_j = S(j).w, w_k = S(k).w, turn_k = cross(w_j, moves(k));
                value = dot(torque, cross(w_j, cross(w_k, behind.w)));
                value += dot(F, cross(w_j, cross(w_k, moved_behind)));
                value += dot(F, cross(before.w + mu[j] * w_j, turn_k));
                Vec3<double> between;
                for (int i = j + 1; i <= k; ++i) between += mu[i] * S(i).w;
                value += dot(F, cross(w_j, cross(between, moves(k))));
            }
            P[j * n + k] = P[k * n + j] = value;
            before += mu[j] * S(j);
        }
    }
}

void Wrench::curvature(const ForcePoint<double>& point, const ForceDirections& directions,
                       LocalForce<double>& out) const {
    const std::size_t n = support_joints_.count(), m = support_.size(), r = inputs_.size(), size = 2 * m + r;
    double w[6];
    components(point, w);
    std::vector<double>& mu = out.law.by_joint;  // by joint
    mu.assign(n, 0.0);
    for (std::size_t i = 0; i < n; ++i)
        for (const Term& term : support_joints_.terms(static_cast<int>(i)))
            mu[i] += term.factor * directions.mu[support_[term.variable]];
    out.work.assign(n * n, 0.0);
    second_by_place(point.at, w, mu, out.work);
    out.second.assign(size * size, 0.0);
    for (std::size_t i = 0; i < n; ++i)
        for (std::size_t j = 0; j < n; ++j)
            for (const Term& a : support_joints_.terms(static_cast<int>(i)))
                for (const Term& b : support_joints_.terms(static_cast<int>(j)))
                    out.second[a.variable * size + b.variable] += a.factor * b.factor * out.work[i * n + j];
    for (int c = 0; c < 6; ++c) {
        if (local_inputs_[c] < 0) continue;
        double unit[6] = {};
        unit[c] = gain(point.at, c);
        first_by_place(point.at, unit, mu, out.work);
        const std::size_t column = 2 * m + local_inputs_[c];
        for (std::size_t j = 0; j < n; ++j)
            for (const Term& b : support_joints_.terms(static_cast<int>(j))) {
                out.second[b.variable * size + column] += b.factor * out.work[j];
                out.second[column * size + b.variable] += b.factor * out.work[j];
            }
    }
}

LEASTACTION_FORCE_ON_ANY_SCALAR(Wrench);

}  // namespace leastaction
