// The Newton matrix M = D2D1Ld + D2fd- of a large tree, eliminated in O(n) without ever being formed.
//
// With the vectors of lagrangian.hpp the entries of M by an ancestor (or self) j of joint i are products of 12-vectors,
//
//   M_ij = a_i.b_j      a_i = [A_i; B_i]     b_j = [-S_j/dt + W_j/2 - dt/4 G_j;  S_j/2 - dt/4 W_j]
//   M_ji = a_i.c_j      (j above i)          c_j = [-S_j/dt - W_j/2 - dt/4 G_j; -S_j/2 - dt/4 W_j]
//
// and what forces add to the diagonal. Row i of M d = r therefore sees the other unknowns only through the sum over its
// path, x_i = x_parent + b_i d_i, and the sums over its subtrees, F_i = sum of the children's F + a_i d_i:
//
//   a_i.x_i + c_i.(sum of the children's F) + diagonal_i d_i = r_i.
//
// Eliminated from the leaves, each child leaves F = P x_parent + f; with P and f now summed over the children of i,
//
//   u = a_i + P'c_i,   w = a_i + P b_i,   pivot = u.b_i + diagonal_i,
//   d_i = (r_i - c_i.f - u.x_parent) / pivot,    P_i = P - w u'/pivot,    f_i = f + w (r_i - c_i.f)/pivot,
//
// and a sweep from the root gives x and d. Joints whose variable is kinematic have d = 0 and drop out.
//
// A ball (discrete/turning.hpp) goes as one, with a pivot of three by three. Turns of its start and its end turn its middle by x and
// change its rates by n/dt each, so with X = sum (S n/dt - W x) and Y = -sum G x
//
//   b = [dt/2 Y - X; dt/2 X]  and  a = [2 sum x A; 2 sum (x B + n A/dt) - 4/dt sum x A]  (as a column)  of each turn of the end,
//   c = [dt/2 Y + X; dt/2 X]  and  a = [2 sum x A; 2 sum (x B + n A/dt) + 4/dt sum x A]  (as a row)     of one of the start,
//
// which are those above where x = 1/2 and n = -+1. Its own three by three are the products a.b too, and what their symmetric part
// differs by (BallTurn::more).
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "dynamics/lagrangian.hpp"
#include "dynamics/newton_euler.hpp"
#include "numerics/small_matrix.hpp"
#include "numerics/wide_rows.hpp"

namespace leastaction {

// What the turn of a ball's middle and its rates (rows) change by with turns of its start and its end (columns), and what is added
// to the products of its own rows and columns: the order of turns (discrete/turning.hpp), forces, and the turns' own second
// derivatives.
struct BallTurn {
    const SmallMatrix<6>* by_ends;
    SmallMatrix<3> more;
};

class TreeNewton {
public:
    static constexpr int lanes = row_lanes;

    // Whether it beats the elimination of the matrix itself.
    static bool is_faster(const Mechanism& mechanism);

    // `turning`: balls are turned, and not three joints as others are.
    TreeNewton(const Mechanism& mechanism, bool turning);

    // Factors at the point of the last composites(); `diagonal` (n_dynamic) is what forces add, `turns` by ball. False where
    // a pivot is lost to rounding.
    bool factor(const Lagrangian<double>& lagrangian, double dt, const double* diagonal, const BallTurn* turns);
    // The mass matrix at the point of the last composites(): a = [Y; 0], b = c = [S; 0]; `diagonal` is that of rotors.
    bool factor(const NewtonEuler& bodies, const double* diagonal);
    // Reciprocals of the pivots, by dynamic variable.
    void copy_reciprocals(double* out) const {
        for (const Factors& at : factors_) *out++ = at.reciprocal;
    }
    // Overwrites b (n_dynamic) by the solution.
    void solve(double* b);
    // The same for many right-hand sides, row-major with leading dimension ld, a multiple of `lanes`.
    void solve(double* b, int cols, int ld);

private:
    static constexpr int rank = 12;
    using Vector = Eigen::Array<double, rank, 1>;
    using Wide = Eigen::Array<double, lanes, 1>;

    // One dynamic variable, or the three of a ball. Sums live in slots: a node that is an only child works on in its parent's
    // slot, so along a chain nothing is copied; children of a fork have a slot of their own. Slot 0 is the world.
    struct Node {
        int joint, variable, ball;  // -1: none
        int slot = 0, parent_slot = 0;
        bool is_leaf = false, has_only_child = false, is_last_child = false;
        bool joins_sum() const { return slot != parent_slot && parent_slot > 0; }  // over the children of a fork
    };
    struct Factors {
        Vector b, c, u, w;  // u is divided by the pivot; of a ball u and c by its block of pivots
        double reciprocal;
    };
    using Block = double[3][3];
    // P of a slot by its columns, and once more by its rows: products from both sides are sums of whole vectors.
    struct Projection {
        Vector columns[rank], rows[rank];
    };

    // `load(node, u, w, factors, block)` fills u and w with a as a row and as a column, b and c, and the block of one or three
    // variables by themselves; `load_ball` does so of a ball, null: there is none.
    template <class Load, class LoadBall>
    bool eliminate(const Load& load, const LoadBall& load_ball);
    template <int size, class Load>
    bool eliminate_node(std::size_t n, const Load& load);
    template <int size, int below>
    void add_products(Projection& P, const Factors* below_it, Factors* at, Vector* u, Vector* w);
    template <class F>
    static void by_size(const Node& node, const F& f);
    template <int size>
    void join_sum(const Node& node);
    static void load_ball(const Lagrangian<double>& lagrangian, int joint, double dt, const BallTurn& turn, Vector* u,
                          Vector* w, Factors* at, Block& block);

    std::vector<Node> nodes_;                                     // parents first, subtrees in one piece
    std::vector<Factors> factors_;                                // by dynamic variable
    std::vector<std::array<std::array<double, 3>, 3>> inverses_;  // of the blocks of balls
    std::vector<Projection> P_;                                   // by slot
    std::vector<Vector> sums_;                                    // by slot
    std::vector<Wide> wide_sums_;                                 // rank by slot
};

}  // namespace leastaction
