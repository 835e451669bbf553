// One step of the midpoint variational integrator, by Newton's method (dissertation chapter 4 and appendix A.2).
//
// With Ld(q1, q2) = dt L((q1 + q2)/2, (q2 - q1)/dt) one step solves, for the dynamic part of q2 and the multipliers,
//
//   F1 = p1 + D1Ld(q1, q2) + fd-(q1, q2, u) - Dh(q1)' lam = 0,   F2 = h(q2) = 0,
//   p2 = D2Ld(q1, q2) + fd+(q1, q2, u),
//
// where the kinematic part of q2 is given. Forces act at the midpoint: split `symmetric` fd- = fd+ = dt/2 f (second
// order), split `left` fd- = dt f, fd+ = 0 (dissertation 4.12). Those at the instants (at_instants()) act as constraints'
// do: share f(q1, 0, u) is added to p1, share = dt but for an instant before which there was no step.
//
// A ball whose rotation is a quaternion (turning.hpp): of its three variables q1 is zero and q2 the rotation vector phi of the
// step; p1 and p2 are momenta of turns in the body. Its quaternions at both ends stand behind the variables.
//
// State and input of the step as a discrete system, in the user's order of variables:
//   x = [q; rho; p; v_rho],   u = [inputs; rho_next],   rho+ = rho_next,   v_rho+ = (rho_next - rho)/dt.
#pragma once

#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include "discrete/turned_middle.hpp"
#include "discrete/turning.hpp"
#include "dynamics/lagrangian.hpp"
#include "dynamics/newton_matrix.hpp"
#include "mechanism/time_slopes.hpp"

namespace leastaction {

enum class Split { symmetric, left };
// What eliminates the Newton matrix: NewtonMatrix, or TreeNewton where nothing couples variables but the tree, or
// LoopNewton where constraints besides are of two points each.
enum class Solver { automatic, dense, tree, loops };
enum class StepStatus { converged = 0, no_convergence = 1, not_finite = 2, singular = 3, too_coarse = 4 };

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
    int idle = 0;                 // factorizations where little more than rounding was left to correct
    double residual = 0;          // largest relative residual
    bool rank_deficient = false;  // constraints were redundant: least-norm multiplier
    int setbacks = 0;             // corrections that were taken back, wholly or in part
    bool followed = false;        // the root was followed from dt -> 0; then, or by judge():
    double s = NAN;               // the determinant of the Newton matrix for dt -> 0 over that of the solution
    double reached = 0;           // of a step that is too coarse: the longest that could be followed (s)
};

// What of a force over a step of length dt counts to its start, and to its end.
inline double kappa_minus(Split split, double dt) { return split == Split::left ? dt : 0.5 * dt; }
inline double kappa_plus(Split split, double dt) { return split == Split::left ? 0.0 : 0.5 * dt; }

// Energy at the middle of a step, and the impulses that do work (internal order): of forces on dynamic variables, of all but
// constraints on prescribed ones, which are whatever moves these.
struct StepEnergy {
    double kinetic = 0, potential = 0;
    double size = 0;                          // of the terms that the energy is the sum of
    double grown = 0;                         // what potentials that change with the time add over the step
    double pushed = 0;                        // and what constraints that do add at its start
    std::vector<double> v, at_start, at_end;  // velocity over the step; impulses
};

// One step, with its work space; one object per thread. Its derivatives: differentiate.hpp, curvature.hpp, parameters.hpp.
// Everything is in internal order of the variables (see Mechanism).
class MidpointStep {
public:
    MidpointStep(std::shared_ptr<const Mechanism> mechanism, const MidpointSettings& settings);

    // Problem and unknowns. Before solve(): q1, p1, u, the kinematic part of q2, and guesses of the rest of q2 and lam.
    std::vector<double> q1, p1, u, q2, lam, p2;
    double t = 0;  // at its start (s), for elements that change with the time: at the middle, constraints at the ends
    double share = 0;  // for how long forces at the instants act at the start (s)

    // Begins anew, from q1: nothing is carried over from steps before. Without it the last step's Dh(q2) and Newton matrix
    // are taken over by advance().
    void place_start();
    // Adds to p1 what forces at the instants leave there; once, when q1, p1 and u are those of the start.
    void kick(double for_how_long);
    // `known`: q2 is the solution already and only lam is sought, with differentiate() to follow; then p2 is not to the
    // last digit.
    StepReport solve(double dt, bool known = false);
    // The solution that is continuous with q2 = q1 for dt -> 0, whatever the guess, or the status `too_coarse` where
    // there is none (root.cpp).
    StepReport find(double dt);
    // Makes the guess q2 = q1 + dt v(q1, p1), with v on the constraints: the limit of the solution for dt -> 0.
    // False where the equations of motion are singular.
    bool guess_limit(double dt);
    // After guess_limit() and a solution: s at (q1, q2).
    double judge(double dt);
    // After place_start(): the largest relative residual at (q2, lam).
    double mismatch(double dt);
    // The most that an angle moves from q1 to q2, and the variable.
    double largest_turn() const;
    int most_turned() const;
    // The momenta at both ends of the segment from q1 to q2 under u, without constraints, of prescribed variables too:
    // p1 = -(D1Ld + fd- + share f(q1, 0, u)) into `start`, p2 = D2Ld + fd+ into `end`.
    void momenta(double dt, double share, std::vector<double>& start, std::vector<double>& end);
    // The Lagrangian, potentials and forces at the middle of the step from q1 to q2.
    void evaluate_middle(double dt);
    // After that, or after solve(): the energy there, and what does work at both ends (energy.cpp).
    void energy(double dt, const double* p, StepEnergy& out);
    // Makes (q2, p2) the start of the next step; keeps the factors of the Newton matrix.
    void advance();

    // After solve(), for derivatives: the Newton matrix at the solution itself, by elimination; false where it is singular.
    bool factor_at_solution(double dt) { return factored_at_solution_ || refresh(dt, false); }
    NewtonMatrix& newton() { return newton_; }
    // q2 as configurations are placed: as it is, but for balls.
    const double* end() const { return mechanism_->balls.empty() ? q2.data() : placed_.data(); }
    const double* start_gradients() const { return C1_.data(); }
    // Rows of the first n variables, of which balls have theirs by (q1, q2) of the kernel, to turns of the ends.
    void turn_rows(double* start, double* end, int n) const;
    // After factor_at_solution(): the second derivatives of L, of balls by the ends' turns; those by turns of the middle and rates,
    // which take their place; the rows of a ball as turns of its start and its end.
    const TurnedMiddle& turned_middle() const { return turned_middle_; }
    const PairDerivatives& pairs() const { return lagrangian_.pairs; }
    const PairDerivatives& kernel_pairs();
    std::pair<Vec3<double>, Vec3<double>> turned_rows(const Ball& ball) const;
    // The Lagrangian at the midpoint, with its second derivatives; what forces see there; the constraints at the start, and
    // their gradients (n_constraints x n_variables) at the end.
    const Lagrangian<double>& lagrangian() const { return lagrangian_; }
    ForcePoint<double> middle() const { return {lagrangian_.at, q_mid_.data(), v_.data(), u.data()}; }
    const Placement<double>& start() const { return at1_; }
    ForcePoint<double> instant() const { return {at1_, q1.data(), still_.data(), u.data()}; }
    const double* end_gradients() const { return C2_.data(); }

    // Where solve() stood when it gave up, for the error message: residuals by row, dynamics then constraints.
    std::vector<double> residual, residual_scale;

    const Mechanism& mechanism() const { return *mechanism_; }
    Split split() const { return settings_.split; }
    double tolerance() const { return settings_.tolerance; }
    bool is_dense() const { return !tree_; }  // the Newton matrix is eliminated as a whole
    // For find(), by variable: |angle| moved by it; by dynamic variable, of the last step found: square roots of the
    // inertia, pivots times dt, and reciprocals of the inertia.
    const std::vector<double>& turns() const { return turn_; }
    const std::vector<double>& root_inertia() const { return root_inertia_; }
    const std::vector<double>& pivots() const { return pivots_; }
    const std::vector<double>& mobility() const { return mobility_; }

private:
    void turn_middle();       // of balls: turnings_, their quaternions in q_mid_
    void turn_ends();         // and after that those in q2 and placed_
    void turn_residual();     // and their rows of residual and p2
    void place_prescribed();  // what constraints see at the end that no dynamic variable moves
    void turn_correction();   // of balls: from turns of the end to changes of phi
    void hand_on_turns();     // of balls, what is left of the residual
    inline void middle_of(double dt);
    void evaluate(double dt);  // residuals and p2 at (q2, lam)
    double largest_residual(const std::vector<double>& scale) const;
    // Newton matrix at the point of the last evaluate(), by the O(n) solver if `in_tree` and it can.
    bool refresh(double dt, bool in_tree);
    bool factor_tree(double dt);
    bool factor_dense(double dt);
    void make_bends(double dt);       // of balls
    void set_bends(double dt);        // for the dense Newton matrix
    void make_ball_turns(double dt);  // for tree_, with them
    void make_gradients();            // C1_ and C2_, where loops_ made do without
    void make_start_gradients();
    void list_entries();
    void add_elements();  // forces into f_, potentials into L_q
    // Calls add(i, j, value) for all that potentials and forces add to the Newton matrix.
    template <class Add>
    void element_matrix(double dt, const Add& add);
    void constraint_gradients(const Placement<double>& at, const double* q, double* C);
    bool wants_refresh(const StepReport& report, double merit, double previous);
    // A trial that overflowed must not leave its mark on the tolerance of the next.
    void note_inertia(int i, double inertia) {
        if (std::isfinite(inertia)) root_inertia_[i] = std::sqrt(std::abs(inertia));
    }
    bool correct_limit(double tau);
    bool is_trusted(double dt, const StepReport& report);
    bool turns_as_expected(double dt) const;
    bool keeps_constraint_directions() const;
    bool follow(double from, double to, double dt);
    StepReport follow_from_limit(double dt, const StepReport& first);
    double judge_here(double dt);  // where the last evaluate() was
    double determinant_ratio(double dt);
    void keep_pivots(double dt);

    std::shared_ptr<const Mechanism> mechanism_;
    MidpointSettings settings_;
    int nd_, nq_, nc_;

    Lagrangian<double> lagrangian_;
    NewtonMatrix newton_;
    // Where the pair derivatives of dynamic variables go in the Newton matrix: of a joint by itself, and of two.
    struct Entry {
        std::size_t at;
        int ij, ji;
        double weight;
    };
    std::vector<Entry> own_entries_, mirrored_entries_;
    std::unique_ptr<TreeNewton> tree_;     // null: not for this mechanism
    std::unique_ptr<LoopNewton> loops_;    // null: not for this mechanism, or nothing gained; else tree_ is there too
    LoopNewton::Constraints start_, end_;  // for loops_
    bool have_C1_ = false, have_C2_ = false;
    bool with_forces_ = true;  // all forces but those by one number or input
    bool loops_fail_ = false;  // at the limit of the path that is followed
    Placement<double> at1_, at2_;
    LocalTaylor<double> local_;
    LocalForce<double> force_;
    std::vector<double> q_mid_, v_, f_, still_;
    std::vector<Turning> turnings_;
    TurnedMiddle turned_middle_;
    std::vector<BallTurn> ball_turns_;                  // for tree_
    std::vector<double> kernel_slopes_;                 // L_q without elements, for these
    std::vector<Turning::Matrix6> bends_;               // by ball, by (s, d): what no pair of joints has
    std::vector<double> placed_, raw_start_, raw_end_;  // and the rows D1Ld + fd- and D2Ld + fd+ before they are turned
    std::vector<double> turned_start_, turned_end_;     // and then
    std::unique_ptr<TimeSlopes> by_time_;               // null where nothing changes with the time
    double potential_size_ = 0;                         // of the largest slope of a potential
    double stored_ = 0, stored_size_ = 0;               // energy in potentials, and the sum of their sizes
    std::vector<double> inertia_;                       // that rotors give each dynamic variable alone
    std::vector<double> diagonal_;  // what forces and potentials add to the Newton matrix's, where they add to no more
    std::vector<double> root_inertia_;  // of the diagonal of L_vv, where the Newton matrix was made last
    std::vector<double> C1_, C2_, h_, h_scale_;
    std::vector<double> correction_, q2_kept_, lam_kept_, first_scale_;
    // For find(): the velocity of the last step found, or of this one for dt -> 0, as it may go on.
    std::vector<double> expected_v_;
    // And |angle| moved by a variable; pivots of the Newton matrix of the last step found, times dt; and the solution at a
    // part of the time step, by its velocity and how that changes with the part.
    std::vector<double> turn_, mobility_, pivots_, path_v_, path_slope_, rho2_, residual_kept_;
    double path_s_ = 1;
    bool s_is_by_constraints_ = false;  // its sign is not that of M's part
    bool have_pivots_ = false, have_limit_ = false;
    NewtonMatrix::Determinant limit_;  // of the Newton matrix for dt -> 0, as of a dt of 1
    bool have_factors_ = false;
    bool in_tree_ = false;               // they are tree_'s
    bool factored_at_solution_ = false;  // dense factors and pair derivatives are those of the solution
    double factored_dt_ = 0;
    double last_residual_ = 0;
    double old_rate_ = 0.5;  // contraction seen with the Newton matrix of an earlier step
};

}  // namespace leastaction
