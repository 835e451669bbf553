#include "dynamics/lagrangian.hpp"

#include <Eigen/Core>
#include <algorithm>

#include "dynamics/lagrangian_gradient.hpp"
#include "dynamics/world_inertia.hpp"

namespace leastaction {

namespace {

constexpr int lanes = 8;
using Wide = Eigen::Array<double, lanes, 1>;

// The doubles of a scalar: its value, and for a dual its derivative; for a hyper-dual those of both its duals.
inline double part_of(double x, int) { return x; }
inline const Lanes& part_of(const Lanes& x, int) { return x; }
inline double part_of(const Dual<double>& x, int part) { return part == 0 ? x.v : x.d; }
inline double part_of(const HyperDual& x, int part) { return part_of(part < 2 ? x.v : x.d, part % 2); }

// From a frame with the given pose to the world: with b = R h, the rotational part is
// R I R' + 2 (p.b) E - p b' - b p' + m (p.p E - p p').
Inertia<double> moved(const Inertia<double>& a, const Pose<double>& pose) {
    const Vec3<double>& p = pose.p;
    const Vec3<double> b = pose.R * a.h;
    const Mat3<double> turned{pose.R * (a.I * transposed_times(pose.R, Vec3<double>{1, 0, 0})),
                              pose.R * (a.I * transposed_times(pose.R, Vec3<double>{0, 1, 0})),
                              pose.R * (a.I * transposed_times(pose.R, Vec3<double>{0, 0, 1}))};
    const double diagonal = 2.0 * dot(p, b) + a.m * dot(p, p);
    Inertia<double> out{a.m, b + a.m * p, {}};
    out.I.xx = turned.c0.x + diagonal - 2.0 * p.x * b.x - a.m * p.x * p.x;
    out.I.yy = turned.c1.y + diagonal - 2.0 * p.y * b.y - a.m * p.y * p.y;
    out.I.zz = turned.c2.z + diagonal - 2.0 * p.z * b.z - a.m * p.z * p.z;
    out.I.xy = turned.c1.x - p.x * b.y - p.y * b.x - a.m * p.x * p.y;
    out.I.xz = turned.c2.x - p.x * b.z - p.z * b.x - a.m * p.x * p.z;
    out.I.yz = turned.c2.y - p.y * b.z - p.z * b.y - a.m * p.y * p.z;
    return out;
}

}  // namespace

void PairDerivatives::resize(const Mechanism& mechanism) {
    stride = (mechanism.n_massive + lanes - 1) / lanes * lanes + lanes;
    for (auto* plane : {&vv, &v_q, &q_v, &qq}) plane->assign(pair_entries(mechanism, stride), 0.0);
}

template <class T>
Lagrangian<T>::Lagrangian(const Mechanism& mechanism, bool along_exp) : at(mechanism), mechanism_(mechanism) {
    const std::size_t n = mechanism.n_massive;
    ball_of_.assign(n, -1);
    for (const Ball& ball : mechanism.balls) {
        if (!along_exp || ball.joint >= mechanism.n_massive) continue;
        balls_.push_back(ball.joint);
        std::fill_n(&ball_of_[ball.joint], 3, ball.joint);
    }
    at.turns_along_exp = along_exp;
    L_q.assign(mechanism.n_variables(), T{});
    L_v.assign(mechanism.n_variables(), T{});
    V_.resize(n);
    W_.resize(n);
    h_own_.resize(n);
    h_.resize(n);
    m_.resize(n);
    H_own_.resize(n);
    H_.resize(n);
    IC_.resize(n);
    stride_ = (n + lanes - 1) / lanes * lanes + lanes;
    for (int part = 0; part < parts; ++part) {
        S_wide_[part].assign(6 * stride_, 0.0);
        W_wide_[part].assign(6 * stride_, 0.0);
        G_wide_[part].assign(3 * stride_, 0.0);
        AB_[part].assign(12 * n + 1, 0.0);  // and what is read beyond the last in turned_lagrangian.cpp
        if (balls_.empty()) continue;
        turned_G_wide_[part].assign(3 * stride_, 0.0);
        turned_A_[part].assign(6 * n, 0.0);
    }
}

template <class T>
void Lagrangian<T>::gradient(const T* q, const T* v) {
    if (balls_.empty())
        gradient_with<false>(q, v);
    else
        gradient_with<true>(q, v);
}

template <class T>
void Lagrangian<T>::composites() {
    const Mechanism& m = mechanism_;
    const int n = m.n_massive;
    for (int i = 0; i < n; ++i)
        IC_[i] = m.bodies[i].is_empty() ? Inertia<T>{} : world_inertia(m.bodies[i], at.pose[i], h_own_[i]);
    for (int i = n - 1; i >= 0; --i) {
        const Joint& joint = m.joints[i];
        if (joint.parent >= 0) IC_[joint.parent] += IC_[i];
        const Motion<T>& S = at.twist[i];
        const Force<T> A = IC_[i] * S;
        const Force<T> B = cross_dual(S, H_[i]) - IC_[i] * W_[i];
        const T ab[12] = {A.f.x, A.f.y, A.f.z, A.n.x, A.n.y, A.n.z, B.f.x, B.f.y, B.f.z, B.n.x, B.n.y, B.n.z};
        for (int part = 0; part < parts; ++part)
            for (int c = 0; c < 12; ++c) AB_[part][i * 12 + c] = part_of(ab[c], part);
    }
}

template <class T>
void Lagrangian<T>::inertias(double* by_variable) const
    requires std::is_same_v<T, double>
{
    const Mechanism& m = mechanism_;
    std::fill_n(by_variable, m.n_variables(), 0.0);
    for (int i = 0; i < m.n_massive; ++i)
        m.joints[i].each_term([&](int variable, double factor) {
            const double* A = &AB_[0][i * 12];
            // Joints of one variable that stand above each other move the same masses.
            const auto above = m.plain ? m.path[i].last(1) : m.path[i];
            for (const int j : above)
                m.joints[j].each_term([&](int other, double other_factor) {
                    if (other != variable) return;
                    const Motion<T>& S = at.twist[j];
                    const double pair = dot(Force<T>{{A[0], A[1], A[2]}, {A[3], A[4], A[5]}}, S);
                    by_variable[variable] += (i == j ? 1.0 : 2.0) * factor * other_factor * pair;
                });
        });
    each_rotor_inertia(m, [&](int variable, double inertia) { by_variable[variable] += inertia; });
}

template <class T>
void Lagrangian<T>::hessian(std::span<const TurnedJoints> turned)
    requires(!std::is_same_v<T, Lanes>)
{
    const int n = mechanism_.n_massive;
    if (pairs.stride == 0) {
        pairs.resize(mechanism_);
        if constexpr (std::is_same_v<T, double>) put_rotors(mechanism_, pairs.vv);
    }
    composites();
    for (int i = 0; i < n; ++i) {
        const Motion<T>& S = at.twist[i];
        const Vec3<T> G = cross(S.w, mechanism_.gravity);
        const T s[6] = {S.v.x, S.v.y, S.v.z, S.w.x, S.w.y, S.w.z};
        const T w[6] = {W_[i].v.x, W_[i].v.y, W_[i].v.z, W_[i].w.x, W_[i].w.y, W_[i].w.z};
        const T gv[3] = {G.x, G.y, G.z};
        for (int part = 0; part < parts; ++part) {
            for (int c = 0; c < 6; ++c) {
                S_wide_[part][c * stride_ + i] = part_of(s[c], part);
                W_wide_[part][c * stride_ + i] = part_of(w[c], part);
            }
            for (int c = 0; c < 3; ++c) G_wide_[part][c * stride_ + i] = part_of(gv[c], part);
        }
    }
    if (!turned.empty()) return turned_products(turned);
    for (int i = 0; i < n; ++i) pair_products<false>(i);
    if (!balls_.empty()) order_own_pairs();
}

// For a dual scalar the derivative of each product: by the product rule the sum of two products of plain numbers, for a
// hyper-dual of four.
template <class T>
struct Lagrangian<T>::Products {
    Wide vv = Wide::Zero(), v_q = Wide::Zero(), q_v = Wide::Zero(), qq = Wide::Zero();

    // Of the vectors [A; B] of the row by a part, and those of the joints from j on by another.
    [[gnu::always_inline]] void add(const Lagrangian& of, const double* A, int part, int j) {
        const double* B = A + 6;
        const double *S = &of.S_wide_[part][j], *W = &of.W_wide_[part][j];
        for (int c = 0; c < 6; ++c) {
            const Wide s = Eigen::Map<const Wide>(S + c * of.stride_), w = Eigen::Map<const Wide>(W + c * of.stride_);
            vv += A[c] * s;
            v_q -= A[c] * w;
            q_v += B[c] * s;
            qq -= B[c] * w;
        }
    }
    [[gnu::always_inline]] void add_weight(const Lagrangian& of, const double* A, int part, int j) {
        const double* G = &of.G_wide_[part][j];
        for (int c = 0; c < 3; ++c) qq -= A[c] * Eigen::Map<const Wide>(G + c * of.stride_);
    }
    // Where joints are turned: of a row that is not, [A q_q; A q_v] = [A; 0], and of one that is.
    [[gnu::always_inline]] void add_weights(const Lagrangian& of, const double* A, int part, int j) {
        add_weight(of, A, part, j);
        const double* turned_G = &of.turned_G_wide_[part][j];
        for (int c = 0; c < 3; ++c) q_v -= A[c] * Eigen::Map<const Wide>(turned_G + c * of.stride_);
    }
    [[gnu::always_inline]] void add_turned_weights(const Lagrangian& of, const double* A, int part, int j) {
        const double *G = &of.G_wide_[part][j], *turned_G = &of.turned_G_wide_[part][j];
        for (int c = 0; c < 3; ++c) {
            const Wide by_q = Eigen::Map<const Wide>(G + c * of.stride_),
                       by_v = Eigen::Map<const Wide>(turned_G + c * of.stride_);
            qq -= A[c] * by_q;
            q_v -= A[c] * by_v;
            v_q -= A[3 + c] * by_q;
            vv -= A[3 + c] * by_v;
        }
    }
};

// The products of row i with all joints of its runs, `lanes` joints at a time.
template <class T>
template <bool turned>
void Lagrangian<T>::pair_products(int i)
    requires(!std::is_same_v<T, Lanes>)
{
    const std::size_t row = i * pairs.stride;
    const bool turned_row = turned && ball_of_[i] >= 0;
    // A ball sees all of its own joints.
    const auto end = [&](int last) { return turned_row && last == i + 1 ? ball_of_[i] + 3 : last; };
    for (const auto& [first, last] : mechanism_.runs[i]) {
        for (int j = first; j < end(last); j += lanes) {
            Products sum;
            for (int part = 0; part < parts; ++part) {
                const double* A = &AB_[parts - 1 - part][i * 12];
                sum.add(*this, A, part, j);
                if constexpr (!turned)
                    sum.add_weight(*this, A, part, j);
                else if (turned_row)
                    sum.add_turned_weights(*this, &turned_A_[parts - 1 - part][i * 6], part, j);
                else
                    sum.add_weights(*this, A, part, j);
            }
            Eigen::Map<Wide>(&pairs.vv[row + j]) = sum.vv;
            Eigen::Map<Wide>(&pairs.v_q[row + j]) = sum.v_q;
            Eigen::Map<Wide>(&pairs.q_v[row + j]) = sum.q_v;
            Eigen::Map<Wide>(&pairs.qq[row + j]) = sum.qq;
        }
    }
}

template <class T>
void Lagrangian<T>::add_inertia_slope(int joint, const Inertia<double>& inertia, std::vector<double>& L_q,
                                      std::vector<double>& L_v) const
    requires std::is_same_v<T, double>
{
    const Inertia<double> I = moved(inertia, at.pose[joint]);
    const Force<double> H = I * V_[joint], weight = I * Motion<double>{mechanism_.gravity, {}};
    for (int i = joint; i >= 0; i = mechanism_.joints[i].parent) {
        const double momentum = dot(H, at.twist[i]), slope = dot(weight, at.twist[i]) - dot(H, W_[i]);
        mechanism_.joints[i].each_term([&](int variable, double factor) {
            L_v[variable] += factor * momentum;
            L_q[variable] += factor * slope;
        });
    }
}

template <class T>
void Lagrangian<T>::add_gravity_slope(const Vec3<double>& change, std::vector<double>& L_q) const
    requires std::is_same_v<T, double>
{
    for (int i = 0; i < mechanism_.n_massive; ++i) {
        const Motion<double>& S = at.twist[i];
        const double slope = m_[i] * dot(change, S.v) + dot(cross(h_[i], change), S.w);
        mechanism_.joints[i].each_term([&](int variable, double factor) { L_q[variable] += factor * slope; });
    }
}

template <class T>
T Lagrangian<T>::kinetic_energy() const {
    T twice = twice_of_rotors_;
    for (int i = 0; i < mechanism_.n_massive; ++i) twice += dot(H_own_[i], V_[i]);
    return 0.5 * twice;
}

template <class T>
T Lagrangian<T>::potential_energy() const {
    T energy(mechanism_.fixed_potential);
    for (int i = 0; i < mechanism_.n_massive; ++i) energy += T(-1.0) * dot(mechanism_.gravity, h_own_[i]);
    return energy;
}

template <class T>
double Lagrangian<T>::potential_size() const
    requires std::is_same_v<T, double>
{
    double size = std::abs(mechanism_.fixed_potential);
    for (int i = 0; i < mechanism_.n_massive; ++i) size += std::abs(dot(mechanism_.gravity, h_own_[i]));
    return size;
}

// For those in turned_lagrangian.cpp.
template void Lagrangian<double>::pair_products<true>(int);
template void Lagrangian<Dual<double>>::pair_products<true>(int);
template void Lagrangian<HyperDual>::pair_products<true>(int);
template class Lagrangian<double>;
template class Lagrangian<Dual<double>>;
template class Lagrangian<HyperDual>;
template class Lagrangian<Lanes>;

}  // namespace leastaction
