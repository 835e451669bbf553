#include "continuous/dynamics.hpp"

#include <algorithm>
#include <cmath>

namespace leastaction {

namespace {

// A pivot of the mass matrix below this part of the inertia that it was is rounding.
constexpr double lost_inertia = 1e-14;

// With many right-hand sides the tree pays where a variable has this many above it on average (measured).
constexpr double deep_on_average = 16;

bool all_finite(const std::vector<double>& values) {
    double sum = 0;
    for (const double x : values) sum += 0.0 * x;
    return sum == 0.0;
}

}  // namespace

Continuous::Continuous(std::shared_ptr<const Mechanism> mechanism, double damping, double stiffness)
    : mechanism_(std::move(mechanism)),
      damping_(damping),
      stiffness_(stiffness),
      nd_(mechanism_->n_dynamic),
      nq_(mechanism_->n_variables()),
      nu_(mechanism_->n_inputs),
      nk_(mechanism_->n_kinematic),
      nc_(mechanism_->n_constraints()),
      n_theta_(2 * nq_ + nu_ + nk_),
      ld_(whole_lanes(n_theta_)),
      at_v_(nq_),
      at_u_(2 * nq_),
      at_rho_(2 * nq_ + nu_),
      massless_joints_(mechanism_->massless_joints_seen),
      bodies_(*mechanism_),
      newton_(*mechanism_),
      along_v_(*mechanism_),
      along_mu_(*mechanism_),
      constraints_along_v_(nc_) {
    q.assign(mechanism_->n_coordinates(), 0.0);
    for (auto* x : {&v, &a, &f_}) x->assign(nq_, 0.0);
    u.assign(nu_, 0.0);
    for (auto* x : {&lam, &g_}) x->assign(nc_, 0.0);
    C_.assign(static_cast<std::size_t>(nc_) * nq_, 0.0);
    diagonal_.assign(nd_, 0.0);
    of_rotors_.assign(nd_, 0.0);
    each_rotor_inertia(*mechanism_, [&](int i, double inertia) {
        if (i < nd_) of_rotors_[i] += inertia;
    });
    mu_.assign(nq_ + nc_, 0.0);
    for (auto* x : {&q_along_v_, &q_along_mu_}) x->resize(q.size());
    q_along_motion_.resize(q.size());
    for (const int joint : mechanism_->constraint_joints)
        if (joint >= mechanism_->n_massive &&
            std::find(massless_joints_.begin(), massless_joints_.end(), joint) == massless_joints_.end())
            massless_joints_.push_back(joint);
    std::sort(massless_joints_.begin(), massless_joints_.end());
    if (mechanism_->plain && !mechanism_->rotors_couple && TreeNewton::is_faster(*mechanism_))
        tree_ = std::make_unique<TreeNewton>(*mechanism_, false);
    double above = 0;
    for (int k = 0; k < nd_; ++k) above += static_cast<double>(mechanism_->coupled[k].size());
    tree_for_derivatives_ = above > deep_on_average * nd_;
}

// f - V_q, by variable.
void Continuous::add_elements() {
    const Mechanism& m = *mechanism_;
    std::fill(f_.begin(), f_.end(), 0.0);
    for (const auto& [i, slot] : m.damping) f_[i] -= m.numbers[slot] * v[i];
    for (const auto& [i, input] : m.joint_forces) f_[i] += u[input];
    place(massless_joints_, q.data(), bodies_.at);
    bodies_.at.time = t;
    along_mu_.time = t;
    for_each_entry(m.potentials, bodies_.at, q.data(), local_, [&](int i, double slope) { f_[i] -= slope; });
    for_each_entry(m.forces, force_point(), force_, [&](int i, double f) { f_[i] += f; });
}

// Dh, and g without what the unknown accelerations add to it; for derivatives with the third order along v at hand. What
// constraints change with the time counts as a variable at the velocity one: h' = Dh v + h_t, and in h'' the slope of h_t along
// v and t comes twice, by that of h' and of itself.
void Continuous::constraint_rows(bool derivatives) {
    const Mechanism& m = *mechanism_;
    if (nc_ == 0) return;
    std::fill(C_.begin(), C_.end(), 0.0);
    const bool timed = m.time_slot >= 0;
    if (timed) {
        place_motion(false);
        derivatives = true;
    }
    if (derivatives) {
        for (int i = 0; i < nq_; ++i) q_along_v_[i] = {q[i], v[i]};
        hold_rotations(q_along_v_);
        along_v_.time = {t, 1.0};
        place(m.constraint_joints, q_along_v_.data(), along_v_);
    }
    for (int c = 0; c < nc_; ++c) {
        const auto& constraint = *m.constraints[c];
        const auto& support = constraint.support();
        const std::size_t n = support.size();
        double* row = &C_[static_cast<std::size_t>(c) * nq_];
        double h, slope = 0, bend = 0;
        if (derivatives) {
            LocalTaylor<Dual<double>>& local = constraints_along_v_[c];
            constraint.evaluate(along_v_, q_along_v_.data(), Order::hessian, local);
            h = local.value.v;
            slope = local.value.d;
            for (std::size_t i = 0; i < n; ++i) {
                row[support[i]] = local.gradient[i].v;
                bend += local.gradient[i].d * v[support[i]];
            }
        } else {
            constraint.evaluate(bodies_.at, q.data(), Order::hessian, local_);
            h = local_.value;
            for (std::size_t i = 0; i < n; ++i) {
                double along = 0;
                for (std::size_t j = 0; j < n; ++j) along += local_.hessian[i * n + j] * v[support[j]];
                row[support[i]] = local_.gradient[i];
                slope += local_.gradient[i] * v[support[i]];
                bend += along * v[support[i]];
            }
        }
        g_[c] = bend + damping_ * slope + stiffness_ * h;
        for (int i = nd_; i < nq_; ++i) g_[c] += row[i] * a[i];
        if (timed) {
            constraint.evaluate(*along_motion_, q_along_motion_.data(), Order::value, hyper_local_);
            g_[c] += hyper_local_.value.d.d;
        }
    }
}

// What is evaluated there has in its d.d the second derivative by time along q, v, a, and t; or that along (v, t) and t.
void Continuous::place_motion(bool along_accelerations) {
    if (!along_motion_) along_motion_ = std::make_unique<Placement<HyperDual>>(*mechanism_);
    for (int i = 0; i < nq_; ++i) {
        q_along_motion_[i] = {{q[i], v[i]}, {}};
        if (along_accelerations) q_along_motion_[i].d = {v[i], a[i]};
    }
    hold_rotations(q_along_motion_);
    along_motion_->time = {{t, 1.0}, {1.0, 0.0}};
    place(mechanism_->constraint_joints, q_along_motion_.data(), *along_motion_);
}

// Which pivot of the mass matrix is no inertia, or -1.
int Continuous::singular_variable() const {
    for (int i = nd_ - 1; i >= 0; --i) {
        const double pivot = newton_.M[static_cast<std::size_t>(i) * newton_.stride + i];
        if (!(pivot > lost_inertia * diagonal_[i])) return i;
    }
    return -1;
}

MotionReport Continuous::solve(bool derivatives) {
    MotionReport report;
    change_accelerations(-1.0);
    std::fill(a.begin(), a.begin() + nd_, 0.0);
    bodies_.move(q.data(), v.data());
    bodies_.forces(a.data());
    bodies_.composites();
    add_elements();
    constraint_rows(derivatives);
    if (!all_finite(bodies_.r) || !all_finite(f_) || !all_finite(g_) || !all_finite(C_)) {
        report.status = MotionStatus::not_finite;
        return report;
    }
    in_tree_ = tree_ && (!derivatives || tree_for_derivatives_) && tree_->factor(bodies_, of_rotors_.data()) &&
               newton_.factor(*tree_, C_.data(), C_.data(), nq_);
    if (!in_tree_ && !factor_mass_matrix()) {
        report.status = MotionStatus::singular;
        report.variable = singular_variable();
        return report;
    }
    for (int i = 0; i < nd_; ++i) a[i] = f_[i] - bodies_.r[i];
    for (int c = 0; c < nc_; ++c) lam[c] = -g_[c];
    newton_.solve(a.data(), lam.data());
    report.rank_deficient = newton_.rank_deficient();
    return report;
}

bool Continuous::factor_mass_matrix() {
    bodies_.inertia();
    newton_.clear();
    each_pair(*mechanism_, bodies_.stride(), [&](int i, int j, std::size_t at, auto weight, bool mirrored) {
        if (i >= nd_ || j >= nd_) return;
        const double value = weight * bodies_.first.i_aj[at];
        newton_.M[static_cast<std::size_t>(i) * newton_.stride + j] += value;
        if (mirrored) newton_.M[static_cast<std::size_t>(j) * newton_.stride + i] += value;
    });
    for (int i = 0; i < nd_; ++i) diagonal_[i] = newton_.M[static_cast<std::size_t>(i) * newton_.stride + i];
    return newton_.factor(C_.data(), C_.data(), nq_) && singular_variable() < 0;
}

MotionReport Continuous::accelerate() {
    const MotionReport report = solve(false);
    change_accelerations(1.0);
    return report;
}

void Continuous::inverse_dynamics(std::vector<double>& needed) {
    bodies_.move(q.data(), v.data());
    change_accelerations(-1.0);
    bodies_.forces(a.data());
    change_accelerations(1.0);
    add_elements();
    for (int i = 0; i < nq_; ++i) needed[i] = bodies_.r[i] - f_[i];
    for (int c = 0; c < nc_; ++c) {
        if (lam[c] == 0.0) continue;
        for_each_entry(*mechanism_->constraints[c], bodies_.at, q.data(), local_,
                       [&](int i, double slope) { needed[i] -= lam[c] * slope; });
    }
}

}  // namespace leastaction
