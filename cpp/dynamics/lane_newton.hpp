// The linear system of newton_matrix.hpp for several configurations side by side, by elimination without any pivoting.
//
// Constraints are eliminated in their order: their Schur complement is near one of C1 = C2, which is definite. A lane for which
// that does not go well, because constraints are redundant or the matrix is far from an inertia, is told: its factors are
// worth nothing.
#pragma once

#include <vector>

#include "dynamics/lagrangian.hpp"

namespace leastaction {

class LaneNewton {
public:
    explicit LaneNewton(const Mechanism& mechanism);

    // Calls f(i, j, weight, mirrored, vv, v_q, q_v, qq) as each_pair() does, with the second derivatives themselves, at the
    // point of the last composites(); those of rotors with weight 1 and nothing but vv.
    template <class F>
    void each_entry(const Lagrangian<Lanes>& lagrangian, const F& f) const {
        for (const Pair& pair : pairs_) {
            const Lanes* A = lagrangian.vectors(pair.joint).AB;
            const VectorsOf<Lanes> j = lagrangian.vectors(pair.above);
            Lanes vv(0.0), v_q(0.0), q_v(0.0), qq(0.0);
            for (int c = 0; c < 6; ++c) {
                vv += A[c] * j.S[c];
                v_q -= A[c] * j.W[c];
                q_v += A[6 + c] * j.S[c];
                qq -= A[6 + c] * j.W[c];
            }
            for (int c = 0; c < 3; ++c) qq -= A[c] * j.G[c];
            for (const Entry& e : pair.entries) f(e.i, e.j, e.weight, e.mirrored, vv, v_q, q_v, qq);
        }
        for (const Fixed& rotor : rotors_)
            f(rotor.i, rotor.j, 1.0, rotor.mirrored, Lanes(rotor.inertia), Lanes(0.0), Lanes(0.0), Lanes(0.0));
    }
    // M = D2D1Ld without what forces add, at the point of the last composites(); and sqrt |L_vv[i, i]|.
    void assemble(const Lagrangian<Lanes>& lagrangian, double dt, Lanes* root_inertia);
    Lanes& M(int i, int j) { return M_[i * n_ + j]; }
    // C1, C2 (n_constraints x ld), of which the first n columns are used. The lanes that have factors.
    Lanes::Mask factor(const Lanes* C1, const Lanes* C2, int ld);
    // The entries (i, j) of M that are not zero, once it is factored.
    const std::vector<std::pair<int, int>>& pattern() const { return pattern_; }
    const std::vector<Lanes>& reciprocal_pivots() const { return reciprocal_; }
    // Overwrites f (n) and g (n_constraints) by y and l.
    void solve(Lanes* f, Lanes* g) const;

private:
    void solve_M(Lanes* b, int stride) const;

    // The pair derivatives of a joint and one above it, and where they go in M.
    struct Entry {
        int i, j;
        double weight;
        bool mirrored;
    };
    struct Pair {
        int joint, above;
        std::vector<Entry> entries;
    };
    struct Fixed {  // of rotors: what they add to L_vv
        int i, j;
        bool mirrored;
        double inertia;
    };
    const Mechanism& mechanism_;
    int n_, nc_;
    std::vector<Pair> pairs_;
    std::vector<Fixed> rotors_;
    std::vector<std::pair<int, int>> pattern_;
    std::vector<Lanes> M_, L_, reciprocal_, inertia_;
    std::vector<Lanes> M_inv_C1t_, C2_, schur_;  // n x nc, nc x n, nc x nc
    std::vector<Lanes> schur_reciprocal_;
};

}  // namespace leastaction
