// The Newton matrix of a mechanism with closed loops (newton_matrix.hpp), constraints and all, eliminated in O(n) where the
// loops are short or follow one another, as in a lift or in a chain of particles.
//
// In the notation of tree_newton.hpp the rows of the bordered matrix see the other unknowns through sums over paths and
// subtrees alone, once these hold what constraints need as well. A constraint of two points has the slope w.S_i by a joint
// that moves one of them, w = [e; p x e] with its slope e by the point's place p, w1 and S1 at the start of the step and
// w2 and S2 at its end. So with x_i = x_parent + [b_i; S2_i] d_i and F_i = [the F of tree_newton.hpp; -sum of w1 lam]
//
//   row i:         [a_i; 0].x_i + [c_i; S1_i].F_i + diagonal_i d_i = r_i
//   constraint c:  w2.x_A + w2'.x_B = g_c        at the nodes A and B that carry its two points.
//
// The front is what the unknowns eliminated so far leave for the others: F = P X + f, where X are the x of the nodes whose
// subtrees are done and the multipliers that are still open. Each unknown leaves it by an update of rank one; a multiplier
// does so as soon as both of its points are in the front and enough of what moves them is gone for its pivot to be sound,
// which is judged anew each time. In which order the nodes go is settled once.
//
// All twists, and what gravity adds to them, lie in a space that is closed under the bracket of the joints: three
// dimensions instead of six where a mechanism is planar. Everything is taken in a basis of it.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "dynamics/lagrangian.hpp"
#include "numerics/wide_rows.hpp"

namespace leastaction {

class LoopNewton {
public:
    static constexpr int lanes = row_lanes;

    // Whether constraints are of two points each that dynamic variables alone move; plain trees only (`Mechanism::plain`,
    // `only_tree_couples`).
    static bool fits(const Mechanism& mechanism);

    explicit LoopNewton(const Mechanism& mechanism);
    // Whether it beats TreeNewton and a Schur complement.
    bool is_faster() const;

    // The constraints at one configuration: twists S by node, and w of both points, in the basis.
    struct Constraints {
        std::vector<double> S, w, value, scale;
    };
    Constraints make_constraints() const;
    void evaluate(const Placement<double>& at, Constraints& out);

    // residual -= Dh'lam; returns the largest term.
    double subtract_forces(const Constraints& at, const double* lam, double* residual);
    // Whether no gradient changes by more than `part` of its size, in the norm that `mobility` gives.
    bool keeps_directions(const Constraints& start, const Constraints& end, const double* mobility, double part);

    // Factors at the point of the last composites(); false where pivots are lost.
    bool factor(const Lagrangian<double>& lagrangian, double dt, const double* diagonal, const Constraints& start,
                const Constraints& end);
    // Overwrites f (n_dynamic) and g (n_constraints) by the solution.
    void solve(double* f, double* g);
    // Of the bordered matrix.
    double log2_determinant() const;
    int sign() const { return sign_; }

private:
    using Wide = Eigen::Array<double, lanes, 1>;

    struct Node {
        int joint, parent;  // the node above, -1: the world
        bool constrained;   // a constraint looks at it
    };
    // Node after node. Blocks of the front: where the x of the node is, and that of its parent (-1: it is zero).
    struct Step {
        int node, block, into;
        int attach_end, ripe_end;  // of the lists below
    };
    struct Attachment {
        int constraint, side;
        bool is_first;
    };
    struct Pivot {
        int step, constraint, slot;  // of a node, and -1; of a constraint
        double reciprocal;
    };

    void find_basis();
    void plan();
    void lay_out(const std::vector<int>& order);
    void to_basis(const Vec3<double>& v, const Vec3<double>& w, double* out) const;
    template <int known>  // the dimension of the basis, or 0
    bool eliminate(const Lagrangian<double>& lagrangian, double dt, const double* diagonal, const Constraints& start,
                   const Constraints& end);
    void subtract_product(const double* w, const double* u, double reciprocal);

    const Mechanism& mechanism_;
    int n_, nc_;
    std::vector<Node> nodes_;
    std::vector<int> ends_;       // two nodes a constraint, -1: the world
    std::vector<int> common_;     // by constraint: the last node above both of its ends, -1: none
    std::vector<double> basis_;   // k x 6
    int k_ = 0, r_ = 0, ld_ = 0;  // dimensions of the basis, of an x, of the front with its padding
    int first_slot_ = 0;          // of multipliers in the front
    std::vector<Step> steps_;
    std::vector<Attachment> attachments_;
    std::vector<int> ripe_;  // constraints

    std::vector<double> P_, gross_;       // gross_: of the terms that a multiplier's pivot is the sum of
    std::vector<double> a_, b_, c_;       // by step
    std::vector<double> rows_, columns_;  // u and w by pivot
    std::vector<Pivot> pivots_;
    std::vector<int> slot_of_, free_, open_;
    std::vector<double> front_, F_, reach_, K_;
    int sign_ = 1;
};

}  // namespace leastaction
