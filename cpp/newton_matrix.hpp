// The linear system of one Newton iteration, and of everything that is differentiated through the step:
//
//   [ M   -C1' ] [ y ]   [ f ]        M  = D2D1Ld + D2fd-   (not symmetric, but with the sparsity of the tree)
//   [ C2    0  ] [ l ] = [ g ]        C1 = Dh(q1), C2 = Dh(q2), dynamic columns
//
// M is eliminated from the leaves to the root without pivoting (nothing fills in, and for a step that resolves the
// motion the inertia -L_vv / dt dominates it); the constraints by their Schur complement S = C2 M^-1 C1', pivoted. Where S
// has lost rank, because constraints are redundant, the multiplier of least norm is taken.
#pragma once

#include <Eigen/Dense>
#include <vector>

#include "mechanism.hpp"

namespace leastaction {

class NewtonMatrix {
public:
    using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

    explicit NewtonMatrix(const Mechanism& mechanism);

    std::vector<double> M;  // n x n row-major; filled by the caller, overwritten by its factors

    // C1, C2: n_constraints x `ld`, row-major, of which the first n columns are used. False where M is singular.
    bool factor(const double* C1, const double* C2, int ld);
    bool rank_deficient() const { return rank_deficient_; }

    // Solves for many right-hand sides at once: rows f (n x cols) and g (n_constraints x cols), row-major with leading
    // dimension ld, overwritten by y and l.
    void solve(double* f, double* g, int cols, int ld);

private:
    void solve_M(double* b, int cols, int ld) const;

    const std::vector<std::vector<int>>& coupled_;
    int n_, nc_;
    std::vector<double> reciprocal_;     // of the pivots
    Matrix M_inv_C1t_;                   // n x nc
    Matrix C2_;                          // nc x n
    Matrix schur_;                       // nc x nc, its LU factors
    std::vector<int> pivots_;
    Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> orthogonal_;
    Eigen::VectorXd column_;
    bool rank_deficient_ = false;
};

}  // namespace leastaction
