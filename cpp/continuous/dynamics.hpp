// The equations of motion in continuous time and their exact derivatives (dissertation chapter 3 and appendix A.1).
//
// With r = d/dt L_v - L_q - f, the dynamic part of the accelerations a and the multipliers lam solve
//
//   r(q, v, a, u) - Dh(q)' lam = 0  (dynamic rows),     g = Dh a + v'D2h v + d Dh v + s h = 0,
//
// and g = h'' + d h' + s h of constraints h(q, t) that change with the time, where h' = Dh v + h_t. In these equations
// where the kinematic part rho_a of a is given. The damping d and the stiffness s are Baumgarte's stabilisation, h'' + d h' +
// s h = 0: constraints that are violated come back like an oscillator; zero leaves them to drift.
//
// Derivatives are by th = [q | v | u | rho_a]. Of the bodies they come from newton_euler.hpp; of the constraints from their
// third order along v, and for the second derivatives from their fourth order along the motion q + v s + a s^2/2.
//
// Where a rotation is a quaternion, its three rates are the body's angular velocity, a their derivatives by time, and derivatives
// by q are by turns in the body: the kernel's are turned at the end (turned.hpp).
#pragma once

#include <memory>
#include <vector>

#include "continuous/turned.hpp"
#include "dynamics/newton_euler.hpp"
#include "dynamics/newton_matrix.hpp"
#include "numerics/aligned.hpp"

namespace leastaction {

enum class MotionStatus { solved = 0, not_finite = 1, singular = 2 };

struct MotionReport {
    MotionStatus status = MotionStatus::solved;
    int variable = -1;            // of a singular mass matrix: the one whose inertia is lost, internal order
    bool rank_deficient = false;  // constraints were redundant: multipliers of least norm
};

// One point of a motion and all that is derived from it, with its work space; one object per thread.
// Everything is in internal order of the variables (see Mechanism).
class Continuous {
public:
    // Damping and stiffness of constraints: d (1/s) and s (1/s^2) above.
    Continuous(std::shared_ptr<const Mechanism> mechanism, double damping, double stiffness);

    // Before a call: q, v, u, the kinematic part of a, and the time (s). The rest of a and lam are results. Of q the
    // quaternions of balls stand behind the variables.
    std::vector<double> q, v, u, a, lam;
    double t = 0;

    MotionReport accelerate();
    // r - Dh' lam for the whole of a and lam as they are: what every variable, kinematic ones too, needs besides the
    // forces of the elements under u.
    void inverse_dynamics(std::vector<double>& needed);

    // accelerate(), and the derivatives of (a, lam) by th in Y.
    MotionReport differentiate();
    int n_theta() const { return n_theta_; }
    int ld() const { return ld_; }
    AlignedVector Y;  // (n_dynamic + n_constraints) x ld

    // After differentiate(): the Hessian of z_a.a + z_lam.lam by th. Of H only the blocks on and below the diagonal, by q, v,
    // u and rho_a, are made, each of them in full; rows of n_theta().
    void curvature(const double* z_a, const double* z_lam);
    AlignedVector H;

    const Mechanism& mechanism() const { return *mechanism_; }

private:
    MotionReport solve(bool derivatives);
    bool factor_mass_matrix();
    void add_elements();  // forces and slopes of potentials, into f_
    void constraint_rows(bool derivatives);
    void place_motion(bool along_accelerations);
    void add_force_derivatives();
    void add_constraint_derivatives();
    void force_curvature();
    void constraint_curvature();
    int singular_variable() const;
    // Of a, between the derivatives of angular velocities and those of the kernel's coordinates twice.
    void change_accelerations(double sign);
    TurnedPoint turned_point(const Ball& ball) const;
    void turn_columns(double* of, std::size_t rows, std::size_t stride) const;
    void turn_slopes();
    void turn_curvature(const double* z_a, const double* z_lam);
    // The quaternions of q behind the variables of a point that moves along a direction.
    template <class T>
    void hold_rotations(std::vector<T>& of) const {
        for (std::size_t i = nq_; i < q.size(); ++i) of[i] = q[i];
    }
    ForcePoint<double> force_point() const { return {bodies_.at, q.data(), v.data(), u.data()}; }

    std::shared_ptr<const Mechanism> mechanism_;
    double damping_, stiffness_;
    int nd_, nq_, nu_, nk_, nc_, n_theta_, ld_;
    int at_v_, at_u_, at_rho_;          // in th
    std::vector<int> massless_joints_;  // that elements look at
    bool in_tree_ = false;              // tree_ has the factors of the mass matrix
    bool tree_for_derivatives_ = false;

    NewtonEuler bodies_;
    NewtonMatrix newton_;
    std::unique_ptr<TreeNewton> tree_;  // null: not for this mechanism
    Placement<Dual<double>> along_v_, along_mu_;
    std::unique_ptr<Placement<HyperDual>> along_motion_;  // of constraints; made when it is asked for
    std::vector<Dual<double>> q_along_v_, q_along_mu_;
    std::vector<HyperDual> q_along_motion_;
    LocalTaylor<double> local_;
    LocalTaylor<Dual<double>> dual_local_;
    LocalTaylor<HyperDual> hyper_local_;
    std::vector<LocalTaylor<Dual<double>>> constraints_along_v_;
    LocalForce<double> force_;
    std::vector<double> f_, C_, g_, diagonal_;
    std::vector<double> of_rotors_;  // the inertia that they give each dynamic variable alone
    std::vector<double>
        mu_;  // of the equations, the dynamic ones by variable (zero for kinematic ones), then constraints
    NewtonMatrix::Matrix Z_;        // Hessian of mu.equations by (a, lam) and q
    NewtonMatrix::Matrix product_;  // Y'Z
    AlignedVector kernel_Y_;        // Y before it was turned, where a rotation is a quaternion
};

}  // namespace leastaction
