// Second derivatives of a midpoint step, contracted with weights w on what it leads to: the Hessian of
// w_q.q2 + w_p.p2 + w_lam.lam by th = [q1 | p1 | u | rho2], exact.
//
// With the multipliers mu of the step's equations F(y, th) = 0, mu = -F_y^-T (w_y + G_y' w_p), which are the derivatives
// of the weighted sum by p1 and by a shift of h, it is [Y; I]' W [Y; I], W the Hessian of mu.F + w_p.G by (y, th).
// The Lagrangian's part of mu.F + w_p.G is the derivative of L along one direction, dq = dt/2 (mu + w_p), dv = w_p - mu,
// so W comes from one dual sweep; of the constraints, -mu.Dh(q1)'lam is a derivative of h along mu.
//
// By the time step: with S = dt e.L_q + g.L_v + dt c.f, e = (mu + w_p)/2, g = w_p - mu, dt c = kappa- mu + kappa+ w_p,
// v = (q2 - q1)/dt and T the part of L, whose second derivatives are those of the dual sweep,
//
//   S_dt     = e.(L_q - L_qv v) - g.L_vv v / dt + c.(f - f_v v)
//   S_dt,q   = L_qq e - T_qv v / dt + c.f_q - c.f_qv v,    S_dt,v = -(T_vv v + L_vv g) / dt - c.f_vv v
//   S_dt,dt  = v.T_vv v / dt^2 + 2 g.L_vv v / dt^2 + v.(c.f_vv) v / dt,    S_dt,u = c.f_u - c.f_uv v.
//
// Forces at the instants add share mu.f(q1, 0, u), and share grows with dt.
//
// By a number a of an element (number_curvature.cpp): the gradient of
//
//   S_a = -dt e.V_qa + dt c.f_a + share mu.f_a(q1, 0, u) - lam.(Dh_a(q1) mu) + mu_h.h_a(q2)
//
// by q1, q2, u and lam, from duals in the space of the numbers; S_ab from differences of it, at the same point.
#pragma once

#include <memory>
#include <vector>

#include "discrete/differentiate.hpp"
#include "discrete/parameters.hpp"

namespace leastaction {

class SecondOrder {
public:
    SecondOrder(const Mechanism& mechanism, Split split);

    // Where the step is, and the weights; in internal order.
    std::vector<double> q1, u, q2, lam, w_q, w_p, w_lam;
    std::vector<double> w_rho;  // on kinematic variables, of which only turns are not linear in th
    double share = 0;           // of forces at the instants (s)
    double t = 0;               // at the start (s)

    // Entries first .. first + length of th stand at `position` of the output; runs are ascending and cover all of th.
    struct Run {
        int first, length, position;
    };
    // Of the first order Y and the columns of p1 and of shifts of P2 are needed.
    void hessian(double dt, const FirstOrder& first);
    // After that: all of it into `out`, rows of ld_out.
    void write(const std::vector<Run>& runs, double* out, int ld_out);
    // Its lower triangle into `out`, one row after the other; `order`: which entry of th stands where.
    void write_packed(const std::vector<int>& order, double* out) const;
    // After that: second derivatives by th and the time step into `out` (n_theta); returns that by the time step twice.
    // slopes: of the step by its length alone.
    double by_time_step(double dt, const FirstOrder& first, MidpointStep& step, const ParameterSlopes& slopes,
                        double* out);
    // After hessian(): second derivatives by numbers of elements, in directions of their space (with none of gravity), and
    // by th, rows of n_theta of `out`, and by two of them, `twice`. slopes: of the step by these directions.
    void by_numbers(double dt, const FirstOrder& first, const MidpointStep& step,
                    const std::vector<Parameter>& directions, ParameterSlopes& slopes, double* out, double* twice);

private:
    void set_multipliers(const FirstOrder& first);
    // Where rotations are quaternions (turned_curvature.cpp): what comes before all else, after each kind of element, after
    // add_forces(), and around add_constraints().
    void begin_balls();
    void place_balls();       // in q_mid_
    void place_dual_balls();  // in dual_q_ and dual_q1_
    const double* end() const { return turned_ ? turned_end() : q2.data(); }
    const double* turned_end() const;
    // mu and w_p as what q1 and q2 change by, of balls theta -+ phi/2, of the first n variables; of others they are zero.
    struct Directions {
        const double *mu, *w;
        int n;
    };
    Directions directions() const {
        return turned_ ? Directions{mu_z_.data(), w_z_.data(), nq_} : Directions{mu_.data(), w_p.data(), nd_};
    }
    void begin_turned(double dt);
    void add_turned_potential(const ConfigurationFunction& potential, double dt);
    void add_turned_forces(double dt);
    void add_bends(double dt);
    // Around add_constraints(): what it tells of both ends, and what becomes of it.
    void begin_turned_ends();
    void note_bend_at_start(int i, int j, double bend);
    void note_constraint_at_start(int c);
    void note_constraint_at_end(int c);
    void turn_ends();
    // What a number, or the time step, changes of balls: gradients by the middle and both ends, as turns of the ends in place.
    void turn_changes(double dt);
    // After that of a change of S by_instants_, by_q_ and by_v_, and by_y_ of the multipliers: second derivatives by it and
    // th into `out`, and by_y_ of q2. own, bent: (q2; lam) by it, and W_yy times that, of which `column` is used.
    void by_theta(double dt, const FirstOrder& first, int column, const Eigen::VectorXd& own, double* out);
    TurnedAxis axis_at_start(const Ball& ball) const;  // of mu
    double& entry(int a, int b);                       // of (q1, q2) by (q1, q2), a kept triangle of it
    void add_ends(int a, int b, double value);         // of what is symmetric there, called for (a, b) and (b, a)
    void add_input(int i, int input, double start, double end);
    // Of i and j, both ways, by the start and the end of either.
    void add_both(int i, int j, double ss, double se, double es, double ee) {
        add_11(i, j, ss);
        add_11(j, i, ss);
        add_12(i, j, se);
        add_12(j, i, es);
        add_22(i, j, ee);
        add_22(j, i, ee);
    }
    void add_prescribed_turns();
    void evaluate_along(double dt);  // the Lagrangian, in dual_
    void add_lagrangian(double dt);
    void add_potentials(double dt);
    void begin_middle(double dt);
    void add_forces(double dt);
    void add_instant_forces();
    // Calls sink(force, size, second) with the Hessian of mu_force_.f by [q; v; u], (size, size), at q_mid_, v_, u, time.
    template <class Sink>
    void each_force_curvature(const std::vector<std::shared_ptr<const GeneralizedForce>>& forces,
                              const std::vector<int>& joints, double time, const Sink& sink);
    void add_constraints();
    // Second derivatives by (q1, q2), each put where the variable lives: q2 is y (dynamic) or rho2 (kinematic). Of what is
    // symmetric add_11 and add_22 are called for both (i, j) and (j, i), and the upper triangle of W_thth is kept.
    [[gnu::always_inline]] void add_11(int i, int j, double value) {
        if (i <= j) W_thth_(i, j) += value;
    }
    [[gnu::always_inline]] void add_12(int i1, int j2, double value) {
        if (j2 < nd_)
            W_yth_(j2, i1) += value;
        else
            W_thth_(i1, at_rho2_ + j2 - nd_) += value;
    }
    [[gnu::always_inline]] void add_22(int i, int j, double value) {
        if (i < nd_ && j < nd_)
            W_yy_(i, j) += value;
        else if (i < nd_)
            W_yth_(i, at_rho2_ + j - nd_) += value;
        else if (j >= nd_ && i <= j)
            W_thth_(at_rho2_ + i - nd_, at_rho2_ + j - nd_) += value;
    }
    // W_thth becomes H = W_thth + Y'Z + Z'Y with Z = W_yy Y / 2 + W_yth, upper triangle.
    void add_products(const FirstOrder& first);

    const Mechanism& mechanism_;
    Split split_;
    int nd_, nq_, nu_, nc_, n_theta_, at_rho2_;
    Lagrangian<Dual<double>> dual_;
    Placement<double> at_middle_, at2_;
    Placement<Dual<double>> dual_at1_;
    // For potentials beside balls, of which they see the charts.
    std::unique_ptr<Placement<Dual<double>>> chart_middle_;
    LocalTaylor<double> local_;
    LocalTaylor<Dual<double>> dual_local_;
    LocalForce<double> force_;
    NewtonMatrix::Matrix W_yy_, W_yth_, half_W_yy_, Z_;
    Eigen::MatrixXd W_thth_;
    std::vector<double> mu_, mu_force_, q_mid_, v_;
    std::vector<double> mu_z_, w_z_;  // directions() of balls
    TurnedMiddle turned_middle_;
    struct Turned;  // null where no rotation is a quaternion
    std::shared_ptr<Turned> turned_;
    bool prescribed_turns_ = false;  // some of these are prescribed
    std::vector<Dual<double>> dual_q_, dual_v_, dual_q1_;
    std::unique_ptr<Placement<Dual<double>>> along_v_, along_mu_;  // for forces; null where there are none
    std::vector<Dual<double>> q_along_v_, q_along_mu_;

    // Weights of dt L_q and of forces by variable, and derivatives by what a step begins and ends with.
    struct AtInstants {
        Eigen::VectorXd e, c, q1, q2, u;
        void begin(int nq, int nu) {
            for (auto* a : {&e, &c, &q1, &q2}) a->setZero(nq);
            u.setZero(nu);
        }
    };
    AtInstants by_instants_;
    Eigen::VectorXd g_, at_v_, by_q_, by_v_, T_vv_v_, L_vv_g_, L_qv_v_;
    Eigen::MatrixXd by_y_, bent_;
    // What turn_changes() reads, by variable: changes of the rows of (theta, phi) and of the start; and of elements alone those of
    // theta, and by_v_.
    Eigen::MatrixXd changes_;
    std::vector<double> moved_;
};

}  // namespace leastaction
