// The midpoint variational integrator and its exact derivatives (dissertation chapter 4 and appendix A.2).
//
// With Ld(q1, q2) = dt L((q1 + q2)/2, (q2 - q1)/dt) one step solves, for the dynamic part of q2 and the multipliers,
//
//   F1 = p1 + D1Ld(q1, q2) + fd-(q1, q2, u) - Dh(q1)' lam = 0,   F2 = h(q2) = 0,
//   p2 = D2Ld(q1, q2) + fd+(q1, q2, u),
//
// where the kinematic part of q2 is given. Forces act at the midpoint: split `symmetric` fd- = fd+ = dt/2 f (second
// order), split `left` fd- = dt f, fd+ = 0 (dissertation 4.12).
//
// State and input of the step as a discrete system, in the user's order of variables:
//   x = [q; rho; p; v_rho],   u = [inputs; rho_next],   rho+ = rho_next,   v_rho+ = (rho_next - rho)/dt.
#pragma once

#include <cmath>
#include <memory>
#include <vector>

#include "dynamics/lagrangian.hpp"
#include "dynamics/newton_matrix.hpp"

namespace leastaction {

enum class Split { symmetric, left };
// What eliminates the Newton matrix: NewtonMatrix, or TreeNewton where nothing couples variables but the tree.
enum class Solver { automatic, dense, tree };
enum class StepStatus { converged = 0, no_convergence = 1, not_finite = 2, singular = 3 };

struct MidpointSettings {
    Split split = Split::symmetric;
    double tolerance = 1e-13;  // residual relative to the size of its terms
    int max_iterations = 50;
    Solver solver = Solver::automatic;
};

struct StepReport {
    StepStatus status = StepStatus::converged;
    int iterations = 0;
    int factorizations = 0;
    double residual = 0;          // largest relative residual
    bool rank_deficient = false;  // constraints were redundant: least-norm multiplier
};

// A direction in the space of the mechanism's numbers: of the numbers of elements by slot (or none at all), and of spatial
// inertias by joint, in the joint's frame.
struct Parameter {
    std::vector<double> numbers;
    std::vector<std::pair<int, Inertia<double>>> inertias;
};

// One step and all that is derived from it, with its work space; one object per thread.
// Everything is in internal order of the variables (see Mechanism).
class MidpointStep {
public:
    MidpointStep(std::shared_ptr<const Mechanism> mechanism, const MidpointSettings& settings);

    // Problem and unknowns. Before solve(): q1, p1, u, the kinematic part of q2, and guesses of the rest of q2 and lam.
    std::vector<double> q1, p1, u, q2, lam, p2;

    // Begins anew, from q1: nothing is carried over from steps before. Without it the last step's Dh(q2) and Newton matrix
    // are taken over by advance().
    void place_start();
    // `known`: q2 is the solution already and only lam is sought, with differentiate() to follow; then p2 is not to the
    // last digit.
    StepReport solve(double dt, bool known = false);
    // The momenta at both ends of the segment from q1 to q2 under u, without constraints:
    // p1 = -(D1Ld + fd-) into `start`, p2 = D2Ld + fd+ into the member p2.
    void momenta(double dt, std::vector<double>& start);
    // Makes (q2, p2) the start of the next step; keeps the factors of the Newton matrix.
    void advance();

    // After solve(): derivatives of (q2, lam) and of p2 by th = [q1 | p1 | u | rho2], and of (q2, p2) by a shift of
    // the constraints h (columns). Returns false where the Newton matrix is singular.
    bool differentiate(double dt);
    // Allocates Y, P2 and H, which a step alone does without: for a caller that fills Y and P2 itself.
    void reserve_derivatives();
    int n_theta() const { return n_theta_; }
    int ld() const { return ld_; }
    std::vector<double> Y;   // (n_dynamic + n_constraints) x ld: d(q2; lam)/d[th | shift of h]
    std::vector<double> P2;  // n_dynamic x ld: dp2/d[th | shift of h]

    // Entries first .. first + length of th stand at `position` of the output; runs are ascending and cover all of th.
    struct Run {
        int first, length, position;
    };
    // Second derivatives by th, contracted with weights on the next state and the multipliers: the Hessian of
    // w_q.q2 + w_p.p2 + w_lam.lam into `out`, rows of ld_out. Needs Y and the columns of p1 and of shifts of P2, as
    // differentiate() leaves them, and q1, q2, u, lam.
    void curvature(double dt, const std::vector<Run>& runs, double* out, int ld_out);
    std::vector<double> w_q, w_p, w_lam;

    // After differentiate(): derivatives of (q2, lam) and of p2 by parameters, which allocates.
    void differentiate_by(double dt, const std::vector<Parameter>& parameters);
    std::vector<double> Y_parameters, P2_parameters;  // rows of ld_parameters()
    int ld_parameters() const { return ld_parameters_; }

    // Where solve() stood when it gave up, for the error message: residuals by row, dynamics then constraints.
    std::vector<double> residual, residual_scale;

    const Mechanism& mechanism() const { return *mechanism_; }

private:
    void evaluate(double dt);  // residuals and p2 at (q2, lam)
    double largest_residual(const std::vector<double>& scale) const;
    // Newton matrix at the point of the last evaluate(), by the O(n) solver if `in_tree` and it can.
    bool refresh(double dt, bool in_tree);
    bool factor_tree(double dt);
    bool factor_dense(double dt);
    void list_entries();
    void add_elements();  // forces into f_, potentials into L_q
    // Calls add(i, j, value) for all that potentials and forces add to the Newton matrix.
    template <class Add>
    void element_matrix(double dt, const Add& add);
    ForcePoint<double> force_point() const { return {lagrangian_.at, q_mid_.data(), v_.data(), u.data()}; }
    void differentiate_forces(double dt);
    template <class Add11, class Add12, class Add22>
    void potential_curvature(const Add11& add_11, const Add12& add_12, const Add22& add_22);
    template <class Add11, class Add12, class Add22>
    void force_curvature(double dt, const Add11& add_11, const Add12& add_12, const Add22& add_22);
    void constraint_gradients(const Placement<double>& at, const double* q, double* C);
    bool wants_refresh(const StepReport& report, double merit, double previous);
    // A trial that overflowed must not leave its mark on the tolerance of the next.
    void note_inertia(int i, double inertia) {
        if (std::isfinite(inertia)) root_inertia_[i] = std::sqrt(std::abs(inertia));
    }
    double kappa_minus(double dt) const { return settings_.split == Split::left ? dt : 0.5 * dt; }
    double kappa_plus(double dt) const { return settings_.split == Split::left ? 0.0 : 0.5 * dt; }

    std::shared_ptr<const Mechanism> mechanism_;
    MidpointSettings settings_;
    int nd_, nq_, nu_, nk_, nc_, n_theta_, ld_, ld_parameters_ = 0;

    Lagrangian<double> lagrangian_;
    Lagrangian<Dual<double>> dual_;
    NewtonMatrix newton_;
    // Where the pair derivatives of dynamic variables go in the Newton matrix: of a joint by itself, and of two.
    struct Entry {
        std::size_t at;
        int ij, ji;
        double weight;
    };
    std::vector<Entry> own_entries_, mirrored_entries_;
    std::unique_ptr<TreeNewton> tree_;  // null: not for this mechanism
    Placement<double> at1_, at2_;
    Placement<Dual<double>> dual_at1_;
    LocalTaylor<double> local_;
    LocalTaylor<Dual<double>> dual_local_;
    LocalForce<double> force_;
    std::vector<double> q_mid_, v_, f_;
    double potential_size_ = 0;     // of the largest slope of a potential
    std::vector<double> diagonal_;  // what forces and potentials add to the Newton matrix's, where they add to no more
    std::vector<double> root_inertia_;  // of the diagonal of L_vv, where the Newton matrix was made last
    std::vector<double> C1_, C2_, h_, h_scale_;
    std::vector<double> correction_, q2_kept_, lam_kept_, first_scale_;
    NewtonMatrix::Matrix G_y_, W_yy_, W_yth_, W_thth_, YZ_, ZY_, strip_;  // second order, see curvature()
    std::vector<Dual<double>> dual_q_, dual_v_, dual_q1_;
    std::unique_ptr<Placement<Dual<double>>> along_v_, along_mu_;  // for forces; null where there are none
    std::vector<Dual<double>> q_along_v_, q_along_mu_;
    std::vector<double> mu_force_;
    std::vector<double> mu_;
    bool have_factors_ = false;
    bool in_tree_ = false;               // they are tree_'s
    bool factored_at_solution_ = false;  // dense factors and pair derivatives are those of the solution
    double factored_dt_ = 0;
    double last_residual_ = 0;
    double old_rate_ = 0.5;  // contraction seen with the Newton matrix of an earlier step
};

}  // namespace leastaction
