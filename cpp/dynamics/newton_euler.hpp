// The inertial and gravitational forces r = d/dt L_v - L_q of the bodies for a motion (q, v, a), in closed form with their first
// derivatives, and the second derivatives of mu.r for given weights mu.
//
// World coordinates and spatial vectors at the world origin, as in lagrangian.hpp; x is the motion cross product, x* its
// dual. Over the path to joint i, V_i = sum S_j v_j, U_i = sum S_j mu_j (the weights as a velocity), and the acceleration
// less gravity A_i = A_parent + S_i a_i + P_i v_i with P_i = V_i x S_i = dS_i/dt. Body k needs the force
// F_k = I_k A_k + V_k x* I_k V_k, and with F_i the sum over all that is behind joint i
//
//   r_i = S_i.F_i,      mu.r = sum over the bodies of U_k.F_k.
//
// Turning joint i by dq_i is, seen from all that is behind it, the opposite turn of all that is before it. Seen so, a
// variable of joint i changes (U_k, V_k, A_k - dV x V_k) of every body behind it by the same (dU, dV, dA):
//
//   q_i: (D_i, P_i, X_i)    v_i: (0, S_i, 2 P_i)    a_i: (0, 0, S_i)      D_i = U_i x S_i,  X_i = A_i x S_i + V_i x P_i.
//
// F_k is linear in A and quadratic in V: it changes by I dA + 2B dV, where by mass elements dm at r with the velocity s(r),
// 2B (t_v; t_w) = 2 [t_w x p; K t_w] holds nothing but p = int s dm and K = tr(T) - T, T = int s r' dm. The same with U
// for V gives N = int of U, K^u, and the bilinear C = 2 int s x u dm. All are summed over what is behind joint i, and
//
//   Y_i = IC_i S_i              b_i = 2 [0; p x S_v + K'S_w]
//   c_i = 2B S_i + 2 IC_i P_i   e_i = 2B P_i + IC_i X_i + S_i x* F_i
//   d_i = 2 [0; n(S_i)]         g_i = IC_i D_i + S_i x* N_i
//   k_i = 2 [0; n(P_i) + p x D_v + K'D_w] + S_i x* [0; C_i],     n(Z) = Z_w x N_n + Z_v x N_f - K^u Z_w
//
// give, for every j that is i or an ancestor of i,
//
//   dr_i/dq_j = b_i.P_j + Y_i.X_j     dr_j/dq_i = e_i.S_j     dr_i/da_j = Y_i.S_j
//   dr_i/dv_j = b_i.S_j + 2 Y_i.P_j   dr_j/dv_i = c_i.S_j
//
// and of mu.r, by the variable of i first,
//
//   q q: g_i.X_j + k_i.P_j + e_i.D_j     v q: c_i.D_j + d_i.P_j     a q: Y_i.D_j
//   q v: 2 g_i.P_j + k_i.S_j             v v: d_i.S_j               q a: g_i.S_j     (v a, a a: none).
//
// A rotor (J, factors f) adds f_k J sum f_l a_l to r_k.
//
// Sweeps are O(n), tables of pairs O(n depth); pairs in different branches are zero.
#pragma once

#include <vector>

#include "mechanism/mechanism.hpp"

namespace leastaction {

class NewtonEuler {
public:
    explicit NewtonEuler(const Mechanism& mechanism);

    // Placement, velocities and inertias at (q, v), internal order; leaves `at` placed.
    void move(const double* q, const double* v);
    // The forces r (by variable, internal order) for the accelerations a, after move().
    void forces(const double* a);
    // By pair of massive joints (i, j), j in the path of i, in rows of stride(): only entries on paths are meaningful.
    std::size_t stride() const { return stride_; }
    struct First {
        std::vector<double> i_aj, i_qj, j_qi, i_vj, j_vi;  // of r_i or r_j, by a, q or v
    };
    struct Second {
        std::vector<double> qq, vq, vv, qv, aq, qa;  // of mu.r, by the variable of i, then of j
    };
    // Composite inertias and the vectors Y, after move(): all that the mass matrix is products of.
    void composites();
    const double* inertia_vector(int joint) const { return &Y_[6 * joint]; }
    // dr_i/da_j, the mass matrix, after composites().
    void inertia();
    // The rest of `first`, after forces() and composites().
    void differentiate();
    // `second` for the weights mu (internal order), after differentiate().
    void curvature(const double* mu);

    Placement<double> at;
    std::vector<double> r;
    First first;
    Second second;

private:
    using Columns = std::vector<double>;  // component-major, for the wide products
    using Rows = std::vector<double>;     // six by joint

    const Mechanism& mechanism_;
    std::size_t stride_;
    std::vector<Inertia<double>> I_, IC_;
    std::vector<Motion<double>> V_, P_, A_, X_, U_, D_;
    std::vector<Force<double>> H_, F_, N_;  // H: momentum of the own body; F and N of all behind the joint
    std::vector<Vec3<double>> p_, C_;       // of all behind the joint
    std::vector<Mat3<double>> T_, T_u_;     // of all behind the joint
    Columns S_wide_, P_wide_, X_wide_, D_wide_;
    Rows Y_, b_, c_, e_, d_, g_, k_;
};

}  // namespace leastaction
