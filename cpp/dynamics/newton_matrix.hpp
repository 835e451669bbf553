// The linear system of one Newton iteration, and of everything that is differentiated through the step:
//
//   [ M   -C1' ] [ y ]   [ f ]        M  = D2D1Ld + D2fd-   (not symmetric, but with the sparsity of the tree)
//   [ C2    0  ] [ l ] = [ g ]        C1 = Dh(q1), C2 = Dh(q2), dynamic columns
//
// M is eliminated from the leaves to the root without pivoting (nothing fills in, and for a step that resolves the
// motion the inertia -L_vv / dt dominates it), here or, for large trees, by TreeNewton; the constraints by their Schur
// complement S = C2 M^-1 C1', pivoted. Where S has lost rank, because constraints are redundant, the multiplier of
// least norm is taken. Where loops are many and short, LoopNewton eliminates both at once.
#pragma once

#include <Eigen/Dense>
#include <vector>

#include "dynamics/loop_newton.hpp"
#include "dynamics/tree_newton.hpp"
#include "mechanism/mechanism.hpp"
#include "numerics/wide_rows.hpp"

namespace leastaction {

// Of all x for which |A x - b| is least the one of least norm, by a complete orthogonal decomposition A P = Q [T 0; 0 0] Z.
// Eigen's own solve() allocates; here only the first compute() does.
class LeastNorm {
public:
    // Pivots below `tolerance` times the largest one count as none.
    template <class AnyMatrix>
    void compute(const AnyMatrix& A, double tolerance) {
        decomposition_.setThreshold(tolerance);
        decomposition_.compute(A);
    }
    void solve(const double* b, double* x);  // they may be the same

private:
    Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> decomposition_;
    Eigen::VectorXd b_, y_;
};

class NewtonMatrix {
public:
    using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

    explicit NewtonMatrix(const Mechanism& mechanism);

    static constexpr int lanes = row_lanes;  // rows are padded, so that wide loops may run past their ends

    const int stride;       // of the rows of M
    std::vector<double> M;  // n rows; filled by the caller after clear(), overwritten by its factors
    void clear();           // M = 0; allocates it the first time

    // C1, C2: n_constraints x `ld`, row-major, of which the first n columns are used. False where M is singular.
    bool factor(const double* C1, const double* C2, int ld);
    // The same where `tree`, which must outlive the factors, has factored M.
    bool factor(TreeNewton& tree, const double* C1, const double* C2, int ld);
    // Where both have factored their parts and must outlive the factors: `tree` M, `loops` the whole.
    void take(const TreeNewton& tree, LoopNewton& loops);
    bool rank_deficient() const { return rank_deficient_; }
    // Reciprocals of the pivots of M, of the last factor(): all negative where -M is near an inertia.
    const std::vector<double>& reciprocal_pivots() const { return reciprocal_; }
    // Determinant of the bordered matrix with as many constraints as are independent; choose_independent() lists them
    // for a matrix with C1 = C2.
    struct Determinant {
        double log2 = 0;
        int sign = 1, sign_of_M = 1;
    };
    // Whether the sign of the Schur complement is that of one with C1 = C2 and a definite -M.
    bool schur_keeps_sign() const { return rank_deficient_ || schur_keeps_sign_; }
    void choose_independent();
    int independent() const { return static_cast<int>(independent_.size()); }
    Determinant determinant();
    // Of all multipliers with the same C1' lam the one of least norm: what redundancy leaves open would otherwise be
    // carried on, and grow, from guess to guess. C1 as in factor().
    void take_least_norm(const double* C1, int ld, double* lam);

    // Solves for many right-hand sides at once: rows f (n x cols) and g (n_constraints x cols), row-major with leading
    // dimension ld, a multiple of `lanes` and at least cols, overwritten by y and l.
    void solve(double* f, double* g, int cols, int ld);
    // The same for one right-hand side, f (n) and g (n_constraints).
    void solve(double* f, double* g);

private:
    bool eliminate();
    bool factor_schur(const double* C1, const double* C2, int ld);
    template <int wides>
    void solve_panel(double* b, int ld) const;
    void solve_M(double* b, int cols, int ld) const;
    void solve_M(double* b) const;
    void solve_schur(double* g, int cols, int ld);
    void solve_schur(double* g);

    const SharedLists& coupled_;
    TreeNewton* tree_ = nullptr;   // has the factors of M; null: they are here
    LoopNewton* loops_ = nullptr;  // has those of the whole; null: they are here
    int n_, nc_, nc_padded_;
    std::vector<double> L_t_;         // the lower factors once more, by rows, for one right-hand side
    std::vector<double> reciprocal_;  // of the pivots
    Matrix M_inv_C1t_;                // n x nc, padded
    Matrix C2_;                       // nc x n
    Matrix schur_;                    // nc x nc, padded; its LU factors
    Matrix unfactored_;
    Matrix reduced_;                // rows and columns of unfactored_ that count in the determinant
    std::vector<int> independent_;  // constraints
    std::vector<int> pivots_;
    LeastNorm schur_least_norm_, C1t_least_norm_;
    Eigen::VectorXd C1t_lam_;
    std::vector<double> padded_;  // a right-hand side, with room for the last lanes
    Eigen::VectorXd column_;
    bool rank_deficient_ = false, schur_keeps_sign_ = true;
};

}  // namespace leastaction
