// A motion in pieces by an implicit Runge-Kutta method, such as that of Radau: the states x_i = (q_i, v_i) of the points of
// a piece of length h, with the method's matrix A and its last point at the end, solve
//
//   q_i = q_0 + h sum_j A_ij v_j,    v_i = v_0 + h sum_j A_ij a(q_j, v_j, u_j),
//
// where kinematic variables follow from their accelerations alone. Of Newton's equations those of q are eliminated: with
// the residuals r,
//
//   dv_i - sum_l (h A_il a_v,l + h^2 sum_j A_ij A_jl a_q,j) dv_l = r_v,i + h sum_j A_ij a_q,j r_q,j.
//
// A matrix is used again while its steps shrink fast enough.
#pragma once

#include <Eigen/Dense>
#include <vector>

#include "continuous/dynamics.hpp"

namespace leastaction {

// Its work space is that of one thread.
class PieceSolver {
public:
    // `matrix`: A, points x points.
    PieceSolver(Continuous& at, int points, const double* matrix);

    // Finds the states (points x 2 nq) from a guess of them, which is overwritten; x0 (2 nq), u (points x inputs and
    // kinematic accelerations). By the internal order of variables. False where it does not come to an end.
    bool solve(double h, const double* x0, const double* u, double* x);

private:
    using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic>;

    bool evaluate(const double* x, const double* u, bool derivatives);
    void move_kinematic(double h, const double* x0, const double* u, double* x) const;
    void factor(double h);
    double step(double h, const double* x0, double* x);

    Continuous& at_;
    int points_, nd_, nq_, nu_, nk_;
    std::vector<double> A_, A2_;         // the method's matrix, and A_ij A_jl at [(i points + j) points + l]
    std::vector<double> a_, a_q_, a_v_;  // of the points: accelerations and their derivatives, nd x nd
    std::vector<double> r_q_;
    Matrix newton_;
    Eigen::PartialPivLU<Matrix> factors_;
    Eigen::VectorXd right_, dv_;
};

// A reference of a motion in pieces and its feedback, by the user's order of variables: states z = [x(last point); x(others);
// u(all points)] (pieces + 1), inputs of all points (pieces), gains (pieces) with as many rows as these.
struct PieceReference {
    const double *z, *u, *K;
};

// Simulates pieces of lengths h under u = u_ref - K (z - z_ref), each found from where the reference has it: writes z
// (pieces + 1, the first of which is given) and u, and returns how many pieces were found before one was not.
int roll_out_pieces(Continuous& at, int points, const double* matrix, int pieces, const double* h,
                    const PieceReference& reference, double* z, double* u);

}  // namespace leastaction
