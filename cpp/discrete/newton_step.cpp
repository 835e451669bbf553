#include "discrete/newton_step.hpp"

#include "discrete/root_trust.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

namespace leastaction {

namespace {

using namespace trust;

constexpr int max_halvings = 8;
constexpr double fresh_price = 0.5;   // of a new Newton matrix, in iterations
constexpr double same_point = 1e-14;  // relative moves below this leave the Newton matrix exact

// Apart, so that steps without balls are as quick as without it.
[[gnu::noinline]] void keep(const std::vector<double>& from, std::vector<double>& to) { to = from; }

}  // namespace

MidpointStep::MidpointStep(std::shared_ptr<const Mechanism> mechanism, const MidpointSettings& settings)
    : mechanism_(std::move(mechanism)),
      settings_(settings),
      nd_(mechanism_->n_dynamic),
      nq_(mechanism_->n_variables()),
      nc_(mechanism_->n_constraints()),
      lagrangian_(*mechanism_, true),
      newton_(*mechanism_),
      at1_(*mechanism_),
      at2_(*mechanism_),
      turned_middle_(*mechanism_) {
    const auto sized = [](std::vector<double>& a, std::size_t n) { a.assign(n, 0.0); };
    const std::size_t nd = nd_, nq = nq_, ny = nd_ + nc_;
    for (auto* a : {&q1, &q2, &q_mid_, &placed_}) sized(*a, mechanism_->n_coordinates());
    for (auto* a : {&v_, &still_, &expected_v_}) sized(*a, nq);
    if (!mechanism_->balls.empty())
        for (auto* a : {&raw_start_, &raw_end_, &turned_start_, &turned_end_}) sized(*a, nq);
    bends_.resize(mechanism_->balls.size());
    ball_turns_.resize(mechanism_->balls.size());
    if (mechanism_->time_slot >= 0) by_time_ = std::make_unique<TimeSlopes>(*mechanism_);
    for (auto* a : {&p1, &p2, &f_, &q2_kept_, &root_inertia_, &diagonal_, &inertia_}) sized(*a, nd);
    sized(u, mechanism_->n_inputs);
    for (auto* a : {&lam, &h_, &h_scale_, &lam_kept_}) sized(*a, nc_);
    for (auto* a : {&residual, &residual_kept_, &residual_scale, &first_scale_, &correction_}) sized(*a, ny);
    for (auto* a : {&mobility_, &pivots_, &path_v_, &path_slope_}) sized(*a, nd);
    sized(rho2_, mechanism_->n_kinematic);
    sized(turn_, nq);
    for (std::size_t j = 0; j < mechanism_->joints.size(); ++j) {
        if (turns_in_place(*mechanism_, static_cast<int>(j))) continue;  // no root is near another by that
        const Joint& joint = mechanism_->joints[j];
        const auto& w = joint.twist.w;
        const double turn = std::sqrt(w.x * w.x + w.y * w.y + w.z * w.z);
        joint.each_term([&](int i, double factor) { turn_[i] = std::max(turn_[i], turn * std::abs(factor)); });
    }
    const bool fits = mechanism_->plain && mechanism_->only_tree_couples;
    if (fits && (settings.solver == Solver::tree ||
                 (settings.solver == Solver::automatic && TreeNewton::is_faster(*mechanism_))))
        tree_ = std::make_unique<TreeNewton>(*mechanism_, true);
    if ((settings.solver == Solver::loops || settings.solver == Solver::automatic) && LoopNewton::fits(*mechanism_)) {
        loops_ = std::make_unique<LoopNewton>(*mechanism_);
        if (settings.solver == Solver::automatic && !loops_->is_faster()) loops_.reset();
    }
    if (loops_) {
        if (!tree_) tree_ = std::make_unique<TreeNewton>(*mechanism_, true);
        start_ = end_ = loops_->make_constraints();
    } else {
        for (auto* a : {&C1_, &C2_}) sized(*a, nc_ * nq);
        have_C1_ = have_C2_ = true;
    }
}

void MidpointStep::constraint_gradients(const Placement<double>& at, const double* q, double* C) {
    std::fill(C, C + nc_ * nq_, 0.0);
    for (int c = 0; c < nc_; ++c) {
        for_each_entry(*mechanism_->constraints[c], at, q, local_, [&](int i, double x) { C[c * nq_ + i] += x; });
        h_[c] = local_.value;
        h_scale_[c] = local_.scale;
    }
}

void MidpointStep::make_start_gradients() {
    if (have_C1_) return;
    for (auto* C : {&C1_, &C2_}) C->resize(static_cast<std::size_t>(nc_) * nq_);
    constraint_gradients(at1_, q1.data(), C1_.data());
    have_C1_ = true;
}

void MidpointStep::make_gradients() {
    if (have_C1_ && have_C2_) return;
    make_start_gradients();
    constraint_gradients(at2_, end(), C2_.data());
    have_C2_ = true;
}

void MidpointStep::place_start() {
    at1_.time = t;
    if (nc_ > 0) {
        place(mechanism_->constraint_joints, q1.data(), at1_);
        if (loops_) {
            loops_->evaluate(at1_, start_);
            have_C1_ = have_C2_ = false;
        } else {
            constraint_gradients(at1_, q1.data(), C1_.data());
        }
    }
    have_factors_ = have_pivots_ = have_limit_ = false;
    old_rate_ = no_contraction;
    std::fill(root_inertia_.begin(), root_inertia_.end(), 0.0);
}

void MidpointStep::kick(double for_how_long) {
    const Mechanism& m = *mechanism_;
    share = for_how_long;
    for (const auto& [i, input] : m.instant_joint_forces) p1[i] += share * u[input];
    if (m.instant_forces.empty()) return;
    place(m.instant_joints, q1.data(), at1_);
    at1_.time = t;
    for_each_entry(m.instant_forces, instant(), force_, [&](int i, double f) {
        if (i < nd_) p1[i] += share * f;
    });
}

void MidpointStep::momenta(double dt, double share, std::vector<double>& start, std::vector<double>& end) {
    const Mechanism& m = *mechanism_;
    kick(share);
    place_prescribed();
    evaluate(dt);
    const double km = kappa_minus(settings_.split, dt), kp = kappa_plus(settings_.split, dt);
    for (int i = 0; i < nq_; ++i) {
        const double half_slope = 0.5 * dt * lagrangian_.L_q[i], momentum = lagrangian_.L_v[i];
        start[i] = momentum - half_slope;
        end[i] = momentum + half_slope;
    }
    const auto add = [&](int i, double f) {
        start[i] -= km * f;
        end[i] += kp * f;
    };
    for (const auto& [i, slot] : m.damping) add(i, -m.numbers[slot] * v_[i]);
    for (const auto& [i, input] : m.joint_forces) add(i, u[input]);
    for_each_entry(m.forces, middle(), force_, add);
    if (!turnings_.empty()) {
        for (double& p : start) p = -p;
        turn_rows(start.data(), end.data(), nq_);
        for (double& p : start) p = -p;
    }
    for (const auto& [i, input] : m.instant_joint_forces) start[i] -= share * u[input];
    for_each_entry(m.instant_forces, instant(), force_, [&](int i, double f) { start[i] -= share * f; });
}

void MidpointStep::advance() {
    expected_v_ = v_;
    q1.swap(q2);
    p1.swap(p2);
    for (const Ball& ball : mechanism_->balls) std::fill_n(&q1[ball.variable], 3, 0.0);
    std::swap(at1_, at2_);
    C1_.swap(C2_);
    if (loops_) {
        std::swap(start_, end_);
        have_C1_ = std::exchange(have_C2_, false);
    }
    have_limit_ = false;
}

void MidpointStep::evaluate_middle(double dt) { middle_of(dt); }

inline void MidpointStep::middle_of(double dt) {
    for (int i = 0; i < nq_; ++i) {
        q_mid_[i] = 0.5 * (q1[i] + q2[i]);
        v_[i] = (q2[i] - q1[i]) / dt;
    }
    if (!mechanism_->balls.empty()) turn_middle();
    lagrangian_.at.time = t + 0.5 * dt;
    lagrangian_.gradient(q_mid_.data(), v_.data());
    if (turned_middle_.turns()) keep(lagrangian_.L_q, kernel_slopes_);
    add_elements();
}

void MidpointStep::evaluate(double dt) {
    middle_of(dt);
    if (nc_ > 0) {
        at2_.time = t + dt;
        if (!turnings_.empty()) turn_ends();
        place(mechanism_->free_constraint_joints, end(), at2_);
        if (loops_) {
            loops_->evaluate(at2_, end_);
            have_C2_ = false;
        } else {
            constraint_gradients(at2_, end(), C2_.data());
        }
    }

    const double km = kappa_minus(settings_.split, dt), kp = kappa_plus(settings_.split, dt);
    double size = 0.5 * dt * potential_size_;
    for (int i = 0; i < nd_; ++i) {
        const double half_slope = 0.5 * dt * lagrangian_.L_q[i], momentum = lagrangian_.L_v[i];
        residual[i] = p1[i] + half_slope - momentum + km * f_[i];
        p2[i] = half_slope + momentum + kp * f_[i];
        size = std::max({size, std::abs(p1[i]), std::abs(half_slope), std::abs(momentum), std::abs(km * f_[i])});
    }
    if (!turnings_.empty()) turn_residual();
    if (loops_) {
        size = std::max(size, loops_->subtract_forces(start_, lam.data(), residual.data()));
        std::copy(end_.value.begin(), end_.value.end(), residual.begin() + nd_);
        std::copy(end_.scale.begin(), end_.scale.end(), residual_scale.begin() + nd_);
    } else {
        for (int c = 0; c < nc_; ++c) {
            const double* row = &C1_[c * nq_];
            for (int i = 0; i < nd_; ++i) {
                const double term = row[i] * lam[c];
                residual[i] -= term;
                size = std::max(size, std::abs(term));
            }
            residual[nd_ + c] = h_[c];
            residual_scale[nd_ + c] = h_scale_[c];
        }
    }
    // Nor can a momentum be met better than the rounding of q2 allows, which near rest is more than the tolerance: an
    // error e in q2_j is one of L_vv[i, j] e / dt, and L_vv[i, j]^2 <= L_vv[i, i] L_vv[j, j].
    double rounding = 0;
    for (int i = 0; i < nd_; ++i) rounding = std::max(rounding, root_inertia_[i] * std::abs(q2[i]));
    rounding *= std::numeric_limits<double>::epsilon() / (settings_.tolerance * dt);
    for (int i = 0; i < nd_; ++i) residual_scale[i] = size + root_inertia_[i] * rounding;
}

double MidpointStep::largest_residual(const std::vector<double>& scale) const {
    double out = 0;
    for (std::size_t i = 0; i < residual.size(); ++i) {
        const double r = std::abs(residual[i]);
        if (!std::isfinite(r)) return std::numeric_limits<double>::infinity();
        if (r > 0) out = std::max(out, r / scale[i]);
        if (!(scale[i] >= 0)) return std::numeric_limits<double>::infinity();
    }
    return out;
}

double MidpointStep::mismatch(double dt) {
    place_prescribed();
    evaluate(dt);
    return largest_residual(residual_scale);
}

void MidpointStep::add_elements() {
    const Mechanism& m = *mechanism_;
    std::fill(f_.begin(), f_.end(), 0.0);
    for (const auto& [i, slot] : m.damping) f_[i] -= m.numbers[slot] * v_[i];
    for (const auto& [i, input] : m.joint_forces) f_[i] += u[input];
    potential_size_ = stored_ = stored_size_ = 0;
    if (m.potentials.empty() && m.forces.empty()) return;
    place(m.massless_joints_seen, q_mid_.data(), lagrangian_.at);
    for (const auto& potential : m.potentials) {
        for_each_entry(*potential, lagrangian_.at, q_mid_.data(), local_, [&](int i, double slope) {
            lagrangian_.L_q[i] -= slope;
            potential_size_ = std::max(potential_size_, std::abs(slope));
        });
        stored_ += local_.value;
        stored_size_ += std::abs(local_.value);
    }
    if (!with_forces_) return;
    for_each_entry(m.forces, middle(), force_, [&](int i, double f) {
        if (i < nd_) f_[i] += f;
    });
}

template <class Add>
void MidpointStep::element_matrix(double dt, const Add& add) {
    const Mechanism& m = *mechanism_;
    turned_middle_.visit([&](const auto& turned) {
        const double km = kappa_minus(settings_.split, dt), kp = kappa_plus(settings_.split, dt);
        const double at_v = 0.5 * dt * (kp - km);  // of fd- and fd+ as one row at the middle
        const auto add_row = [&](int i, int j, double at_q, double at_v, double by_q, double by_v) {
            if (i >= nd_ || j >= nd_) return;
            spread(turned, i, at_q, at_v, [&](int k, double start, double) {
                spread(turned, j, by_q, by_v, [&](int l, double, double end) { add(k, l, start * end); });
            });
        };
        for (const auto& [i, slot] : m.damping) add_row(i, i, km + kp, at_v, 0.0, -m.numbers[slot]);
        for_each_entry(m.potentials, lagrangian_.at, q_mid_.data(), local_,
                       [&](int i, int j, double bend) { add_row(i, j, dt, 0.0, -bend, 0.0); });
        if (!with_forces_) return;
        const auto by_variable = [&](int i, int j, double f_q, double f_v) { add_row(i, j, km + kp, at_v, f_q, f_v); };
        for_each_entry(m.forces, middle(), force_, by_variable, [](int, int, double) {});
    });
}

bool MidpointStep::refresh(double dt, bool in_tree) {
    turned_middle_.set(turnings_, dt);
    in_tree_ = in_tree && tree_;
    have_factors_ = in_tree_ && factor_tree(dt);
    if (!have_factors_) {
        in_tree_ = false;
        have_factors_ = factor_dense(dt);
    }
    factored_dt_ = dt;
    return have_factors_;
}

bool MidpointStep::factor_tree(double dt) {
    lagrangian_.composites();
    std::fill(diagonal_.begin(), diagonal_.end(), 0.0);
    std::fill(inertia_.begin(), inertia_.end(), 0.0);
    each_rotor_inertia(*mechanism_, [&](int i, double inertia) {
        if (i >= nd_) return;
        inertia_[i] += inertia;
        diagonal_[i] -= inertia / dt;
    });
    for (int joint = 0; joint < mechanism_->n_massive; ++joint) {
        const int i = mechanism_->joints[joint].variable;
        if (i >= nd_) continue;
        const JointVectors at = lagrangian_.vectors(joint);
        note_inertia(i, std::inner_product(at.S, at.S + 6, at.AB, inertia_[i]));
    }
    if (turned_middle_.turns()) make_ball_turns(dt);
    element_matrix(dt, [&](int i, int j, double value) {
        const int ball = turned_middle_.ball_of(i);
        if (ball < 0) {
            diagonal_[i] += value;
        } else {
            const int first = mechanism_->balls[ball].variable;
            ball_turns_[ball].more.rows[i - first][j - first] += value;
        }
    });
    if (!tree_->factor(lagrangian_, dt, diagonal_.data(), ball_turns_.data())) return false;
    if (loops_ && !loops_fail_) {
        if (loops_->factor(lagrangian_, dt, diagonal_.data(), start_, end_)) {
            newton_.take(*tree_, *loops_);
            return true;
        }
        loops_fail_ = true;
    }
    make_gradients();
    return newton_.factor(*tree_, C1_.data(), C2_.data(), nq_);
}

void MidpointStep::list_entries() {
    each_pair(*mechanism_, lagrangian_.pairs_stride(), [&](int i, int j, std::size_t at, auto weight, bool mirrored) {
        if (i >= nd_ || j >= nd_) return;
        const int ij = i * newton_.stride + j, ji = j * newton_.stride + i;
        (mirrored ? mirrored_entries_ : own_entries_).push_back({at, ij, ji, weight * 1.0});
    });
}

bool MidpointStep::factor_dense(double dt) {
    if (own_entries_.empty()) list_entries();
    if (turned_middle_.turns()) set_bends(dt);
    lagrangian_.hessian(turned_middle_.joints());
    newton_.clear();
    double* M = newton_.M.data();
    const PairDerivatives& d = lagrangian_.pairs;
    const double dt_4 = 0.25 * dt, per_dt = 1.0 / dt;
    std::fill(diagonal_.begin(), diagonal_.end(), 0.0);  // of the inertia, here
    for (const Entry& e : own_entries_) {
        M[e.ij] += e.weight * (dt_4 * d.qq[e.at] - per_dt * d.vv[e.at]);
        if (e.ij == e.ji) diagonal_[e.ij / newton_.stride] += e.weight * d.vv[e.at];
    }
    for (const Entry& e : mirrored_entries_) {
        const double even = e.weight * (dt_4 * d.qq[e.at] - per_dt * d.vv[e.at]);
        const double odd = 0.5 * e.weight * (d.q_v[e.at] - d.v_q[e.at]);
        M[e.ij] += even + odd;
        M[e.ji] += even - odd;
    }
    for (int i = 0; i < nd_; ++i) note_inertia(i, diagonal_[i]);
    element_matrix(dt, [&](int i, int j, double value) { M[i * newton_.stride + j] += value; });
    make_gradients();
    return newton_.factor(C1_.data(), C2_.data(), nq_);
}

void MidpointStep::place_prescribed() {
    const std::vector<int>& joints = mechanism_->prescribed_constraint_joints;
    if (joints.empty()) return;
    if (!mechanism_->balls.empty()) {
        turn_middle();
        turn_ends();
    }
    place(joints, end(), at2_);
}

// Whether a new Newton matrix is cheaper than going on with the old one. Within a step the contraction decides. At its
// start: an old matrix gains a factor `old_rate_` an iteration, a new one is done in two, at the price of `fresh_price`
// iterations. Each refresh makes the estimate a little more hopeful, so that the old matrix is tried again.
bool MidpointStep::wants_refresh(const StepReport& report, double merit, double previous) {
    if (report.iterations == 1 && report.factorizations == 0) old_rate_ = std::min(merit / previous, 0.5);
    if (report.factorizations > 0) return merit > slow_contraction * previous;
    if (merit > no_contraction * previous) return true;  // however near the tolerance it is
    const double iterations = std::log(report.residual / settings_.tolerance) / -std::log(old_rate_);
    const bool refresh = iterations > 2.0 + fresh_price;
    if (refresh) old_rate_ *= 0.9;
    return refresh;
}

StepReport MidpointStep::solve(double dt, bool known) {
    StepReport report;
    const double none = std::numeric_limits<double>::infinity();
    double previous = none;  // residual, in units of the first point's terms, where the last correction was made
    bool fresh = false;      // the last correction was made with the Newton matrix of its own point
    int halvings = 0;
    if (factored_dt_ != dt) have_factors_ = false;
    factored_at_solution_ = false;
    place_prescribed();
    for (;; ++report.iterations) {
        evaluate(dt);
        report.residual = largest_residual(residual_scale);
        if (report.residual <= settings_.tolerance) break;
        if (report.iterations == 0) first_scale_ = residual_scale;
        for (std::size_t i = 0; i < first_scale_.size(); ++i)  // what was nothing at all at first has a size now
            if (!(first_scale_[i] > 0)) first_scale_[i] = residual_scale[i];
        const double merit = largest_residual(first_scale_);
        if (fresh && merit > 0.25 * previous && std::min(report.residual, last_residual_) < rounding_floor) break;
        last_residual_ = report.residual;
        const bool finite = std::isfinite(merit);
        if (report.iterations >= settings_.max_iterations || (!finite && previous == none)) {
            report.status = finite ? StepStatus::no_convergence : StepStatus::not_finite;
            return report;
        }
        if (fresh && !(merit < previous) && halvings < max_halvings) {
            // A Newton step that makes things worse was too long: halve it.
            ++halvings;
            ++report.setbacks;
            for (int i = 0; i < nd_; ++i) q2[i] = 0.5 * (q2[i] + q2_kept_[i]);
            for (int c = 0; c < nc_; ++c) lam[c] = 0.5 * (lam[c] + lam_kept_[c]);
            continue;
        }
        if (!fresh && !(merit < 2.0 * previous)) {
            // Led astray by an old Newton matrix: back, and on with a new one.
            std::copy(q2_kept_.begin(), q2_kept_.end(), q2.begin());
            lam = lam_kept_;
            previous = none;
            have_factors_ = false;
            ++report.setbacks;
            continue;
        }
        fresh = !have_factors_ || wants_refresh(report, merit, previous);
        if (fresh) {
            ++report.factorizations;
            if (report.residual < rounding_floor) ++report.idle;
            if (!refresh(dt, !known)) {
                report.status = StepStatus::singular;
                return report;
            }
        }
        halvings = 0;
        previous = merit;
        std::copy(q2.begin(), q2.begin() + nd_, q2_kept_.begin());
        lam_kept_ = lam;
        for (int i = 0; i < nd_ + nc_; ++i) correction_[i] = -residual[i];
        newton_.solve(correction_.data(), correction_.data() + nd_);
        if (!turnings_.empty()) turn_correction();
        double moved = 0;
        for (int i = 0; i < nd_; ++i) {
            q2[i] += correction_[i];
            moved = std::max(moved, std::abs(correction_[i]) / (1.0 + std::abs(q2[i])));
        }
        factored_at_solution_ = fresh && !in_tree_ && moved < same_point;
        for (int c = 0; c < nc_; ++c) lam[c] += correction_[nd_ + c];
        if (known && factored_at_solution_) break;
    }
    if (!turnings_.empty() && nc_ == 0) turn_ends();
    if (!known) {
        // What is left of F1, a covector at q1, goes on with the momentum, so that what symmetries keep is kept:
        // p2 = p1 + dt L_q + (fd- + fd+) - Dh(q1)' lam.
        for (int i = 0; i < nd_; ++i) p2[i] += residual[i];
        if (!turnings_.empty()) hand_on_turns();
    }
    report.rank_deficient = newton_.rank_deficient();
    if (report.rank_deficient) newton_.take_least_norm(C1_.data(), nq_, lam.data());
    return report;
}

}  // namespace leastaction
