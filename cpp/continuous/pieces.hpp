// A motion in pieces by an implicit Runge-Kutta method, such as that of Radau: the states x_i = (q_i, v_i) of the points of
// a piece of length h, with the method's matrix A and its last point at the end, solve
//
//   q_i = q_0 + h sum_j A_ij N(q_j) v_j,    v_i = v_0 + h sum_j A_ij a(q_j, v_j, u_j, t_j),
//
// where kinematic variables follow from their accelerations alone. N is the identity, but for the numbers of a quaternion, of
// any length, which change by q (0, w) / 2: linear in q. So the q of all points are known from the v, and Newton's equations
// are those of v, with G the derivatives of the q (of quaternions by turns in the body) by the v:
//
//   dv_i - sum_l (h A_il a_v,l + sum_j h A_ij a_q,j G_jl) dv_l = r_v,i,    G_jl = h A_jl, where N is the identity.
//
// A matrix is used again while its steps shrink fast enough.
#pragma once

#include <Eigen/Dense>
#include <vector>

#include "continuous/dynamics.hpp"

namespace leastaction {

// Its work space is that of one thread. States are by the internal order: q with the quaternions of balls behind the variables,
// then v.
class PieceSolver {
public:
    // `matrix`: A, points x points.
    PieceSolver(Continuous& at, int points, const double* matrix);

    int size() const { return n_q_ + nq_; }  // of a state
    // Finds the states (points x size()) from a guess of their v, which is overwritten; x0 (size()), t (points), u (points x
    // inputs and kinematic accelerations). False where it does not come to an end.
    bool solve(double h, const double* x0, const double* t, const double* u, double* x);

private:
    using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic>;

    bool evaluate(const double* x, const double* t, const double* u, bool derivatives);
    void move_kinematic(double h, const double* x0, const double* u, double* x) const;
    void follow(double h, const double* x0, double* x);
    void turn_with(const Ball& ball, double h, const double* x);
    void factor(double h, const double* x);
    double step(double h, const double* x0, double* x);

    Continuous& at_;
    const Mechanism& m_;
    int points_, nd_, nq_, n_q_, nu_, nk_;
    std::vector<double> A_, A2_;         // the method's matrix, and A_ij A_jl at [(i points + j) points + l]
    std::vector<double> a_, a_q_, a_v_;  // of the points: accelerations and their derivatives, nd x nd
    std::vector<double> before_;
    std::vector<bool> in_ball_;  // of the variables
    Matrix turning_, turned_;    // of a ball: its equations, and G
    Matrix newton_;
    Eigen::PartialPivLU<Matrix> factors_;
    Eigen::VectorXd right_, dv_;
};

// A reference of a motion in pieces and its feedback, by the user's order of variables: states z = [x(last point); x(others);
// u(all points)] (pieces + 1), inputs of all points (pieces), gains (pieces) with as many rows as these, on differences of z.
struct PieceReference {
    const double *z, *u, *K;
};

// Simulates pieces of lengths h, with points at times t (pieces x points), under u = u_ref - K (z - z_ref), each found from
// where the reference has it: writes z (pieces + 1, the first of which is given) and u, and returns how many pieces were found
// before one was not.
int roll_out_pieces(Continuous& at, int points, const double* matrix, int pieces, const double* h, const double* t,
                    const PieceReference& reference, double* z, double* u);

}  // namespace leastaction
