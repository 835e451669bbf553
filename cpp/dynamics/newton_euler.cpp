#include "dynamics/newton_euler.hpp"

#include <Eigen/Core>
#include <algorithm>

#include "dynamics/world_inertia.hpp"

namespace leastaction {

namespace {

constexpr int lanes = 8;
using Wide = Eigen::Array<double, lanes, 1>;

void put(std::vector<double>& rows, int i, const Force<double>& a) {
    double* to = &rows[6 * i];
    to[0] = a.f.x, to[1] = a.f.y, to[2] = a.f.z, to[3] = a.n.x, to[4] = a.n.y, to[5] = a.n.z;
}
void put(std::vector<double>& columns, std::size_t stride, int i, const Motion<double>& a) {
    double* to = &columns[i];
    to[0] = a.v.x, to[stride] = a.v.y, to[2 * stride] = a.v.z;
    to[3 * stride] = a.w.x, to[4 * stride] = a.w.y, to[5 * stride] = a.w.z;
}

// Sum of row times columns over components from..6, added to a wide value.
template <int from = 0>
inline void add_products(Wide& sum, const double* row, const double* columns, std::size_t stride) {
    for (int c = from; c < 6; ++c) sum += row[c] * Eigen::Map<const Wide>(columns + c * stride);
}

// T = int s r' dm of a rigid body with the velocity field s(r) = V.v + V.w x r: V.v h' + [V.w]x (int r r' dm).
Mat3<double> flow(const Inertia<double>& body, const Motion<double>& V) {
    const Sym3<double>& J = body.I;
    const double half = 0.5 * (J.xx + J.yy + J.zz);
    const Vec3<double> r0{half - J.xx, -J.xy, -J.xz}, r1{-J.xy, half - J.yy, -J.yz}, r2{-J.xz, -J.yz, half - J.zz};
    return {body.h.x * V.v + cross(V.w, r0), body.h.y * V.v + cross(V.w, r1), body.h.z * V.v + cross(V.w, r2)};
}
Mat3<double>& operator+=(Mat3<double>& a, const Mat3<double>& b) {
    a.c0 += b.c0;
    a.c1 += b.c1;
    a.c2 += b.c2;
    return a;
}
// K x and K'x of K = tr(T) - T.
double trace(const Mat3<double>& T) { return T.c0.x + T.c1.y + T.c2.z; }
Vec3<double> turned(const Mat3<double>& T, const Vec3<double>& x) { return trace(T) * x - T * x; }
Vec3<double> turned_back(const Mat3<double>& T, const Vec3<double>& x) { return trace(T) * x - transposed_times(T, x); }

}  // namespace

NewtonEuler::NewtonEuler(const Mechanism& mechanism)
    : at(mechanism),
      r(mechanism.n_variables()),
      mechanism_(mechanism),
      stride_((mechanism.n_massive + lanes - 1) / lanes * lanes + lanes) {
    const std::size_t n = mechanism.n_massive;
    for (auto* a : {&I_, &IC_}) a->resize(n);
    for (auto* a : {&V_, &P_, &A_, &X_, &U_, &D_}) a->resize(n);
    for (auto* a : {&H_, &F_, &N_}) a->resize(n);
    for (auto* a : {&p_, &C_}) a->resize(n);
    for (auto* a : {&T_, &T_u_}) a->resize(n);
    for (auto* a : {&S_wide_, &P_wide_, &X_wide_, &D_wide_}) a->assign(6 * stride_, 0.0);
    for (auto* a : {&Y_, &b_, &c_, &e_, &d_, &g_, &k_}) a->assign(6 * n, 0.0);
}

void NewtonEuler::move(const double* q, const double* v) {
    const Mechanism& m = mechanism_;
    place(m.massive_joints, q, at);
    for (int i = 0; i < m.n_massive; ++i) {
        const Joint& joint = m.joints[i];
        const Motion<double>& S = at.twist[i];
        const Motion<double> own = joint.rate(v) * S;
        V_[i] = joint.parent < 0 ? own : V_[joint.parent] + own;
        P_[i] = cross(V_[i], S);
        const Body& body = m.bodies[i];
        if (body.is_empty()) {
            I_[i] = Inertia<double>{};
            H_[i] = Force<double>{};
            continue;
        }
        I_[i] = world_inertia(body, at.pose[i], body.mass * (at.pose[i].R * body.com + at.pose[i].p));
        H_[i] = I_[i] * V_[i];
    }
}

void NewtonEuler::forces(const double* a) {
    const Mechanism& m = mechanism_;
    const Motion<double> still{-m.gravity, {}};
    std::fill(r.begin(), r.end(), 0.0);
    for (int i = 0; i < m.n_massive; ++i) {
        const Joint& joint = m.joints[i];
        const Motion<double>& S = at.twist[i];
        // V_i - V_parent = S_i v_i, so P_i v_i = V_i x (V_i - V_parent) = V_parent x V_i.
        const Motion<double>& before = joint.parent < 0 ? still : A_[joint.parent];
        const double own = joint.rate(a);
        A_[i] = before + own * S;
        if (joint.parent >= 0) A_[i] = A_[i] + cross(V_[joint.parent], V_[i]);
        F_[i] = Force<double>{};
        if (m.bodies[i].is_empty()) continue;
        F_[i] = I_[i] * A_[i];
        F_[i] += cross_dual(V_[i], H_[i]);
    }
    for (int i = m.n_massive - 1; i >= 0; --i) {
        const Joint& joint = m.joints[i];
        const double force = dot(F_[i], at.twist[i]);
        joint.each_term([&](int variable, double factor) { r[variable] += factor * force; });
        if (joint.parent >= 0) F_[joint.parent] += F_[i];
    }
    for (const Rotor& rotor : m.rotors)
        rotor.each_momentum(m, a, [&](int variable, double force) { r[variable] += force; });
}

void NewtonEuler::composites() {
    const Mechanism& m = mechanism_;
    const int n = m.n_massive;
    std::copy(I_.begin(), I_.end(), IC_.begin());
    for (int i = n - 1; i >= 0; --i) {
        const int parent = m.joints[i].parent;
        if (parent >= 0) IC_[parent] += IC_[i];
        put(Y_, i, IC_[i] * at.twist[i]);
        put(S_wide_, stride_, i, at.twist[i]);
    }
}

void NewtonEuler::inertia() {
    const Mechanism& m = mechanism_;
    const int n = m.n_massive;
    if (first.i_aj.empty()) {
        first.i_aj.assign(pair_entries(m, stride_), 0.0);
        put_rotors(m, first.i_aj);
    }
    for (int i = 0; i < n; ++i)
        for (const auto& [begin, end] : m.runs[i])
            for (int j = begin; j < end; j += lanes) {
                Wide value = Wide::Zero();
                add_products(value, &Y_[6 * i], &S_wide_[j], stride_);
                Eigen::Map<Wide>(&first.i_aj[i * stride_ + j]) = value;
            }
}

void NewtonEuler::differentiate() {
    const Mechanism& m = mechanism_;
    const int n = m.n_massive;
    if (first.i_qj.empty())
        for (auto* table : {&first.i_qj, &first.j_qi, &first.i_vj, &first.j_vi})
            table->assign(pair_entries(m, stride_), 0.0);
    for (int i = 0; i < n; ++i) {
        p_[i] = H_[i].f;
        T_[i] = m.bodies[i].is_empty() ? Mat3<double>{} : flow(I_[i], V_[i]);
    }
    for (int i = n - 1; i >= 0; --i) {
        const int parent = m.joints[i].parent;
        if (parent >= 0) {
            p_[parent] += p_[i];
            T_[parent] += T_[i];
        }
        const Motion<double>&S = at.twist[i], &P = P_[i];
        X_[i] = cross(A_[i], S) + cross(V_[i], P);
        put(b_, i, {{}, 2.0 * (cross(p_[i], S.v) + turned_back(T_[i], S.w))});
        Force<double> c = IC_[i] * P;
        c += {cross(S.w, p_[i]), turned(T_[i], S.w)};
        put(c_, i, {2.0 * c.f, 2.0 * c.n});
        Force<double> e = IC_[i] * X_[i];
        e += cross_dual(S, F_[i]);
        e += {2.0 * cross(P.w, p_[i]), 2.0 * turned(T_[i], P.w)};
        put(e_, i, e);
        put(P_wide_, stride_, i, P);
        put(X_wide_, stride_, i, X_[i]);
    }
    for (int i = 0; i < n; ++i) {
        const double *Y = &Y_[6 * i], *b = &b_[6 * i], *c = &c_[6 * i], *e = &e_[6 * i];
        for (const auto& [begin, end] : m.runs[i])
            for (int j = begin; j < end; j += lanes) {
                Wide twice = Wide::Zero(), i_qj = Wide::Zero(), j_qi = Wide::Zero(), i_vj = Wide::Zero(),
                     j_vi = Wide::Zero();
                add_products(i_qj, Y, &X_wide_[j], stride_);
                add_products<3>(i_qj, b, &P_wide_[j], stride_);
                add_products(j_qi, e, &S_wide_[j], stride_);
                add_products<3>(i_vj, b, &S_wide_[j], stride_);
                add_products(twice, Y, &P_wide_[j], stride_);
                add_products(j_vi, c, &S_wide_[j], stride_);
                const std::size_t to = i * stride_ + j;
                Eigen::Map<Wide>(&first.i_qj[to]) = i_qj;
                Eigen::Map<Wide>(&first.j_qi[to]) = j_qi;
                Eigen::Map<Wide>(&first.i_vj[to]) = i_vj + 2.0 * twice;
                Eigen::Map<Wide>(&first.j_vi[to]) = j_vi;
            }
    }
}

void NewtonEuler::curvature(const double* mu) {
    const Mechanism& m = mechanism_;
    const int n = m.n_massive;
    if (second.qq.empty())
        for (auto* table : {&second.qq, &second.vq, &second.vv, &second.qv, &second.aq, &second.qa})
            table->assign(pair_entries(m, stride_), 0.0);
    for (int i = 0; i < n; ++i) {
        const Joint& joint = m.joints[i];
        const Motion<double>& S = at.twist[i];
        const Motion<double> own = joint.rate(mu) * S;
        U_[i] = joint.parent < 0 ? own : U_[joint.parent] + own;
        D_[i] = cross(U_[i], S);
        if (m.bodies[i].is_empty()) {
            N_[i] = Force<double>{};
            T_u_[i] = Mat3<double>{};
            C_[i] = Vec3<double>{};
            continue;
        }
        const Inertia<double>& I = I_[i];
        const Motion<double>&V = V_[i], &U = U_[i];
        N_[i] = I * U;
        T_u_[i] = flow(I, U);
        // int (V.v + V.w x r) x (U.v + U.w x r) dm, where (a x r) x (b x r) = r r'(a x b)
        const Vec3<double> turn = cross(V.w, U.w);
        const double half = 0.5 * (I.I.xx + I.I.yy + I.I.zz);
        C_[i] = 2.0 * (cross(H_[i].f, U.v) + cross(V.v, cross(U.w, I.h)) + half * turn - I.I * turn);
    }
    for (int i = n - 1; i >= 0; --i) {
        const int parent = m.joints[i].parent;
        if (parent >= 0) {
            N_[parent] += N_[i];
            T_u_[parent] += T_u_[i];
            C_[parent] += C_[i];
        }
        const Motion<double>&S = at.twist[i], &P = P_[i], &D = D_[i];
        const auto n_of = [&](const Motion<double>& Z) {
            return cross(Z.w, N_[i].n) + cross(Z.v, N_[i].f) - turned(T_u_[i], Z.w);
        };
        put(d_, i, {{}, 2.0 * n_of(S)});
        Force<double> g = IC_[i] * D;
        g += cross_dual(S, N_[i]);
        put(g_, i, g);
        put(k_, i, {{}, 2.0 * (n_of(P) + cross(p_[i], D.v) + turned_back(T_[i], D.w)) + cross(S.w, C_[i])});
        put(D_wide_, stride_, i, D);
    }
    for (int i = 0; i < n; ++i) {
        const double *Y = &Y_[6 * i], *c = &c_[6 * i], *e = &e_[6 * i], *d = &d_[6 * i], *g = &g_[6 * i],
                     *k = &k_[6 * i];
        for (const auto& [begin, end] : m.runs[i])
            for (int j = begin; j < end; j += lanes) {
                Wide qq = Wide::Zero(), vq = Wide::Zero(), vv = Wide::Zero(), qv = Wide::Zero(), aq = Wide::Zero(),
                     qa = Wide::Zero(), twice = Wide::Zero();
                add_products(qq, g, &X_wide_[j], stride_);
                add_products<3>(qq, k, &P_wide_[j], stride_);
                add_products(qq, e, &D_wide_[j], stride_);
                add_products(vq, c, &D_wide_[j], stride_);
                add_products<3>(vq, d, &P_wide_[j], stride_);
                add_products<3>(vv, d, &S_wide_[j], stride_);
                add_products(twice, g, &P_wide_[j], stride_);
                add_products<3>(qv, k, &S_wide_[j], stride_);
                add_products(aq, Y, &D_wide_[j], stride_);
                add_products(qa, g, &S_wide_[j], stride_);
                const std::size_t to = i * stride_ + j;
                Eigen::Map<Wide>(&second.qq[to]) = qq;
                Eigen::Map<Wide>(&second.vq[to]) = vq;
                Eigen::Map<Wide>(&second.vv[to]) = vv;
                Eigen::Map<Wide>(&second.qv[to]) = qv + 2.0 * twice;
                Eigen::Map<Wide>(&second.aq[to]) = aq;
                Eigen::Map<Wide>(&second.qa[to]) = qa;
            }
    }
}

}  // namespace leastaction
