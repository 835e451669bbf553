// The one kernel for the Lagrangian L = T - V of the bodies under uniform gravity, its gradient and its Hessian.
//
// World coordinates, spatial vectors at the world origin. With joint twists S_i, V_i = V_parent + S_i v_i, and, summed
// over all that is behind joint i, the inertia IC_i = sum I_k and the momentum H_i = sum I_k V_k; gravity g as the motion
// a_g = [g; 0]; W_i = S_i x V_i and G_i = S_i x a_g:
//
//   L_v[i] = S_i.H_i                      L_q[i] = S_i.(IC_i a_g) - H_i.W_i
//
// and for every j that is i or an ancestor of i, with A_i = IC_i S_i and B_i = S_i x* H_i - IC_i W_i:
//
//   L_vv[i,j]       =  A_i.S_j            d(L_v[i])/dq_j = -A_i.W_j
//   d(L_v[j])/dq_i  =  B_i.S_j            L_qq[i,j]      = -B_i.W_j - A_i.G_j
//
// A rotor adds J/2 (sum f_k v_k)^2, which is f_k J sum to L_v[k] and f_k f_l J to L_vv[k,l].
//
// The three joints of a ball stand, where so asked, for turns of its body along exp, by which its angular velocity is held, and for
// this: V_i is then that of the body, and in W_i = S_i x V_i that of what is before the ball. Of two of them the last turn is that of
// j, in B_i.S_j without the turn of S_j by i (discrete/turning.hpp). Derivatives along a direction turn their axes too.
//
// Pairs in different branches are zero. The gradient and the vectors A and B are O(n), the Hessian O(n depth). On
// Dual<double> the same sweep gives the third order along one direction, on HyperDual the fourth along two.
#pragma once

#include <span>
#include <type_traits>
#include <vector>

#include "mechanism/mechanism.hpp"
#include "numerics/small_matrix.hpp"

namespace leastaction {

// Second derivatives by pair of massive joints (i, j), j in the path of i, in rows of `stride`.
// Only entries on paths are meaningful; others hold whatever the wide loops left there.
struct PairDerivatives {
    std::size_t stride = 0;
    std::vector<double> vv, v_q, q_v, qq;  // L_vv, d(L_v[i])/dq_j, d(L_v[j])/dq_i, L_qq

    void resize(const Mechanism& mechanism);
};

// A ball, by its first joint: its turns and rates (rows) are functions of three other coordinates and rates, by which second
// derivatives are taken instead; of duals also how that changes along their direction; and what its own second derivatives have
// besides the symmetric part of products. Then
//
//   S' = S v_v - W q_v,   W' = W q_q - S v_q,   A' = A v_v + B q_v,   B' = B q_q + A v_q,
//
// and of L_qq, q_v, v_q and vv the terms -A_i.G_j are with A and G times q_q or q_v.
struct TurnedJoints {
    int joint;
    bool keeps_q;  // by.aa is the identity
    const SmallMatrix<6>*by, *along;
    SmallMatrix<6> own;
};

// The vectors above of one joint, component by component; G as [w x g; 0].
template <class T>
struct VectorsOf {
    T S[6], W[6], G[6];
    const T* AB;  // [A; B]
};
using JointVectors = VectorsOf<double>;

template <class T>
class Lagrangian {
public:
    // `along_exp`: derivatives by balls are so, on duals of first order too; else they are by their charts.
    explicit Lagrangian(const Mechanism& mechanism, bool along_exp = false);

    // Gradient at (q, v), both in internal order; fills L_q and L_v (internal order) and leaves `at` placed.
    void gradient(const T* q, const T* v);
    // Composite inertias, A and B at the point of the last gradient: all that the second derivatives are products of.
    void composites();
    VectorsOf<T> vectors(int joint) const
        requires(!is_dual<T>)
    {
        const Motion<T>&S = at.twist[joint], &W = W_[joint];
        const Vec3<T> G = cross(S.w, mechanism_.gravity);
        return {{S.v.x, S.v.y, S.v.z, S.w.x, S.w.y, S.w.z},
                {W.v.x, W.v.y, W.v.z, W.w.x, W.w.y, W.w.z},
                {G.x, G.y, G.z, 0, 0, 0},
                &AB_[0][joint * 12]};
    }
    const Vec3<double>& gravity() const { return mechanism_.gravity; }
    const Motion<T>& W(int joint) const { return W_[joint]; }
    const auto* AB(int joint) const { return &AB_[0][joint * 12]; }
    // The inertia that each variable moves, L_vv[k, k], at the point of the last composites().
    void inertias(double* by_variable) const
        requires std::is_same_v<T, double>;
    // Second derivatives at the point of the last gradient, in `pairs`; for a dual scalar, their derivatives along the
    // direction.
    void hessian(std::span<const TurnedJoints> turned = {})
        requires(!std::is_same_v<T, Lanes>);
    std::size_t pairs_stride() const { return stride_; }  // of the planes in `pairs`, before they are made too

    // Adds what the gradient changes by where a joint's own body gets more inertia (in the frame of the joint, about its
    // origin): L is linear in it.
    void add_inertia_slope(int joint, const Inertia<double>& inertia, std::vector<double>& L_q,
                           std::vector<double>& L_v) const
        requires std::is_same_v<T, double>;

    // The same where gravity changes, in which L is linear too.
    void add_gravity_slope(const Vec3<double>& change, std::vector<double>& L_q) const
        requires std::is_same_v<T, double>;

    T kinetic_energy() const;    // at the point of the last gradient
    T potential_energy() const;  // of uniform gravity
    // The sum of its terms' sizes.
    double potential_size() const
        requires std::is_same_v<T, double>;

    Placement<T> at;
    std::vector<T> L_q, L_v;
    PairDerivatives pairs;

private:
    const Mechanism& mechanism_;
    std::vector<Motion<T>> V_, W_;
    std::vector<Vec3<T>> h_own_, h_;  // first moments: of the own body, of all behind the joint
    std::vector<T> m_;                // mass behind the joint
    T twice_of_rotors_{};             // of the kinetic energy
    std::vector<Force<T>> H_own_, H_;
    std::vector<Inertia<T>> IC_;
    // Component-major copies for the wide pair products: part 0 the value, the others derivatives (of duals, hyper-duals).
    using Part = SizeOf<T>;
    static constexpr int parts = sizeof(T) / sizeof(Part);
    std::vector<double> S_wide_[parts], W_wide_[parts], G_wide_[parts];
    std::vector<Part> AB_[parts];  // [A; B] by joint
    std::size_t stride_;

    std::vector<double> turned_G_wide_[parts], turned_A_[parts];  // G q_v, and [A q_q; A q_v] by joint
    std::vector<int> balls_;                                      // that turn along exp, by their first joints
    std::vector<int> ball_of_;                                    // by joint, its first; -1: none
    std::vector<SmallMatrix<6>> own_;                             // of those before which there is no joint

    template <bool has_balls>
    void gradient_with(const T* q, const T* v);
    void order_own_pairs()
        requires(!std::is_same_v<T, Lanes>);
    // Eight products, or derivatives of products, of a row and the joints from j on.
    struct Products;
    template <bool turned>
    void pair_products(int i)
        requires(!std::is_same_v<T, Lanes>);
    void turned_products(std::span<const TurnedJoints> turned)
        requires(!std::is_same_v<T, Lanes>);
    SmallMatrix<6> own_products(int ball, bool values) const
        requires(!std::is_same_v<T, Lanes>);
    SmallMatrix<6> own_turned(const TurnedJoints& of) const
        requires(!std::is_same_v<T, Lanes>);
    void add_to_own_pairs(int ball, const SmallMatrix<6>& own);
    void put_own_pairs(int ball, const SmallMatrix<6>& own);
    void turn(const TurnedJoints& of)
        requires(!std::is_same_v<T, Lanes>);
    template <bool keeps_q>
    void turn_columns(const TurnedJoints& of)
        requires(!std::is_same_v<T, Lanes>);
    template <bool keeps_q>
    void turn_rows(const TurnedJoints& of)
        requires(!std::is_same_v<T, Lanes>);
};

extern template class Lagrangian<double>;
extern template class Lagrangian<Dual<double>>;
extern template class Lagrangian<HyperDual>;
extern template class Lagrangian<Lanes>;

}  // namespace leastaction
