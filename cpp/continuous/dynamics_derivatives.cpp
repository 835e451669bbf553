// Derivatives of the equations of motion at a point: of first order, and the second order contracted with weights. What
// rotations that are quaternions add to them is in turned_dynamics.cpp.
#include <algorithm>

#include "continuous/dynamics.hpp"

namespace leastaction {

// With y = (a, lam) and F(y, th) the equations, Y = -F_y^-1 F_th: the right-hand side -F_th is solved in place.
MotionReport Continuous::differentiate() {
    const MotionReport report = solve(true);
    if (report.status != MotionStatus::solved) return report;
    Y.assign(static_cast<std::size_t>(nd_ + nc_) * ld_, 0.0);
    bodies_.forces(a.data());
    if (in_tree_) bodies_.inertia();
    bodies_.differentiate();
    const NewtonEuler::First& d = bodies_.first;
    each_pair(*mechanism_, bodies_.stride(), [&](int i, int j, std::size_t at, auto weight, bool mirrored) {
        if (i < nd_) {
            double* row = &Y[static_cast<std::size_t>(i) * ld_];
            row[j] -= weight * d.i_qj[at];
            row[at_v_ + j] -= weight * d.i_vj[at];
            if (j >= nd_) row[at_rho_ + j - nd_] -= weight * d.i_aj[at];
        }
        if (j < nd_ && mirrored) {
            double* row = &Y[static_cast<std::size_t>(j) * ld_];
            row[i] -= weight * d.j_qi[at];
            row[at_v_ + i] -= weight * d.j_vi[at];
            if (i >= nd_) row[at_rho_ + i - nd_] -= weight * d.i_aj[at];
        }
    });
    add_force_derivatives();
    add_constraint_derivatives();
    newton_.solve(Y.data(), Y.data() + static_cast<std::size_t>(nd_) * ld_, n_theta_, ld_);
    if (!mechanism_->balls.empty()) turn_slopes();
    return report;
}

void Continuous::add_force_derivatives() {
    const Mechanism& m = *mechanism_;
    for (const auto& [i, slot] : m.damping)
        if (i < nd_) Y[static_cast<std::size_t>(i) * ld_ + at_v_ + i] -= m.numbers[slot];
    for (const auto& [i, input] : m.joint_forces)
        if (i < nd_) Y[static_cast<std::size_t>(i) * ld_ + at_u_ + input] += 1.0;
    const auto row = [&](int i) { return &Y[static_cast<std::size_t>(i) * ld_]; };
    for_each_entry(m.potentials, bodies_.at, q.data(), local_, [&](int i, int j, double bend) {
        if (i < nd_) row(i)[j] -= bend;
    });
    const auto by_variable = [&](int i, int j, double f_q, double f_v) {
        if (i >= nd_) return;
        row(i)[j] += f_q;
        row(i)[at_v_ + j] += f_v;
    };
    for_each_entry(m.forces, force_point(), force_, by_variable, [&](int i, int input, double f_u) {
        if (i < nd_) row(i)[at_u_ + input] += f_u;
    });
}

// -Dh' lam in the dynamic rows; in their own g_q = D2h a + D3h[v] v + d D2h v + s Dh and g_v = 2 D2h v + d Dh.
void Continuous::add_constraint_derivatives() {
    const bool timed = mechanism_->time_slot >= 0;
    for (int c = 0; c < nc_; ++c) {
        const auto& constraint = *mechanism_->constraints[c];
        const auto& support = constraint.support();
        const std::size_t n = support.size();
        const LocalTaylor<Dual<double>>& local = constraints_along_v_[c];
        double* row = &Y[static_cast<std::size_t>(nd_ + c) * ld_];
        if (timed) constraint.evaluate(*along_motion_, q_along_motion_.data(), Order::gradient, hyper_local_);
        for (std::size_t i = 0; i < n; ++i) {
            const int variable = support[i];
            const Dual<double>* second = &local.hessian[i * n];
            const Dual<double> slope = local.gradient[i];
            double bend = timed ? hyper_local_.gradient[i].d.d : 0.0;
            for (std::size_t j = 0; j < n; ++j) bend += second[j].v * a[support[j]] + second[j].d * v[support[j]];
            row[variable] = -(bend + damping_ * slope.d + stiffness_ * slope.v);
            row[at_v_ + variable] = -(2.0 * slope.d + damping_ * slope.v);
            if (variable >= nd_) {
                row[at_rho_ + variable - nd_] = -slope.v;
                continue;
            }
            double* dynamic = &Y[static_cast<std::size_t>(variable) * ld_];
            for (std::size_t j = 0; j < n; ++j) dynamic[support[j]] += lam[c] * second[j].v;
        }
    }
}

// With mu = -F_y^-T z the Hessian is [Y; I]'W[Y; I], W that of mu.F by (y, th). F is linear in y, and y meets nothing but
// q: W_yy = 0, and W_yth has the columns of q only.
void Continuous::curvature(const double* z_a, const double* z_lam) {
    const std::size_t n = n_theta_;
    H.assign(n * n, 0.0);
    Z_.setZero(nd_ + nc_, nq_);
    // M and the system are symmetric but for the sign of the multipliers: F_y' (x, y) = z with y the negative of what the
    // solver calls l, for the right-hand side (z_a, -z_lam).
    change_accelerations(-1.0);
    std::fill(mu_.begin(), mu_.end(), 0.0);
    for (int i = 0; i < nd_; ++i) mu_[i] = -z_a[i];
    for (int c = 0; c < nc_; ++c) mu_[nq_ + c] = z_lam[c];
    newton_.solve(mu_.data(), mu_.data() + nq_);
    for (int c = 0; c < nc_; ++c) mu_[nq_ + c] = -mu_[nq_ + c];

    bodies_.curvature(mu_.data());
    const NewtonEuler::Second& d = bodies_.second;
    const auto add_acceleration = [&](int i, int j, double value) {
        if (i < nd_)
            Z_(i, j) += value;
        else
            H[(at_rho_ + i - nd_) * n + j] += value;
    };
    each_pair(*mechanism_, bodies_.stride(), [&](int i, int j, std::size_t at, auto weight, bool mirrored) {
        const double qq = weight * d.qq[at], vv = weight * d.vv[at];
        H[i * n + j] += qq;
        H[(at_v_ + i) * n + j] += weight * d.vq[at];
        H[(at_v_ + i) * n + at_v_ + j] += vv;
        add_acceleration(i, j, weight * d.aq[at]);
        if (!mirrored) return;
        H[j * n + i] += qq;
        H[(at_v_ + j) * n + i] += weight * d.qv[at];
        H[(at_v_ + j) * n + at_v_ + i] += vv;
        add_acceleration(j, i, weight * d.qa[at]);
    });
    const Mechanism& m = *mechanism_;
    if (!m.potentials.empty() || !m.forces.empty() || nc_ > 0) {
        for (int i = 0; i < nq_; ++i) q_along_mu_[i] = {q[i], mu_[i]};
        hold_rotations(q_along_mu_);
        place(m.element_joints, q_along_mu_.data(), along_mu_);
    }
    for_each_entry(m.potentials, along_mu_, q_along_mu_.data(), dual_local_,
                   [&](int i, int j, const Dual<double>& bend) { H[i * n + j] += bend.d; });
    if (!m.forces.empty()) force_curvature();
    if (nc_ > 0) constraint_curvature();

    // H + Y'Z on the columns of q, and its mirror image where that lies below the diagonal too: in the block of q.
    Eigen::Map<NewtonMatrix::Matrix> all(H.data(), n, n);
    const AlignedVector& slopes = m.balls.empty() ? Y : kernel_Y_;
    const Eigen::Map<const NewtonMatrix::Matrix> y(slopes.data(), nd_ + nc_, ld_);
    product_.noalias() = y.leftCols(n).transpose() * Z_;
    all.leftCols(nq_) += product_;
    all.topLeftCorner(nq_, nq_) += product_.topRows(nq_).transpose();
    if (!m.balls.empty()) turn_curvature(z_a, z_lam);
    change_accelerations(1.0);
}

void Continuous::force_curvature() {
    const Mechanism& m = *mechanism_;
    const std::size_t width = n_theta_;
    for (int i = 0; i < nq_; ++i) q_along_v_[i] = {q[i], v[i]};
    hold_rotations(q_along_v_);
    along_v_.time = t;  // what a force knows of rates by the time is a part of its expression
    place(m.force_joints, q_along_v_.data(), along_v_);
    const ForceDirections directions{along_v_, along_mu_, q_along_v_.data(), q_along_mu_.data(), mu_.data()};
    for (const auto& force : m.forces) {
        const auto &support = force->support(), &inputs = force->inputs();
        const std::size_t n = support.size(), r = inputs.size(), size = 2 * n + r;
        force->curvature(force_point(), directions, force_);
        const auto place_of = [&](std::size_t k) {
            return k < n ? support[k] : k < 2 * n ? at_v_ + support[k - n] : at_u_ + inputs[k - 2 * n];
        };
        const auto block = [&](std::size_t k) { return k < n ? 0 : k < 2 * n ? 1 : 2; };
        for (std::size_t i = 0; i < size; ++i)
            for (std::size_t j = 0; j < size; ++j)
                if (block(i) >= block(j)) H[place_of(i) * width + place_of(j)] -= force_.second[i * size + j];
    }
}

// Of -lam.Dh mu, along mu; of nu.g with the multipliers nu of the constraint rows, along the motion.
void Continuous::constraint_curvature() {
    const Mechanism& m = *mechanism_;
    const std::size_t width = n_theta_;
    place(m.constraint_joints, q_along_mu_.data(), along_mu_);
    place_motion(true);
    for (int c = 0; c < nc_; ++c) {
        const auto& constraint = *m.constraints[c];
        const auto& support = constraint.support();
        const std::size_t n = support.size();
        const double nu = mu_[nq_ + c];
        constraint.evaluate(along_mu_, q_along_mu_.data(), Order::hessian, dual_local_);
        constraint.evaluate(*along_motion_, q_along_motion_.data(), Order::hessian, hyper_local_);
        for (std::size_t i = 0; i < n; ++i) {
            const int row = support[i];
            Z_(nd_ + c, row) -= dual_local_.gradient[i].d;
            for (std::size_t j = 0; j < n; ++j) {
                const int column = support[j];
                const HyperDual& second = hyper_local_.hessian[i * n + j];
                const double still = second.v.v, along = second.v.d, bend = second.d.d;
                H[row * width + column] +=
                    nu * (bend + damping_ * along + stiffness_ * still) - lam[c] * dual_local_.hessian[i * n + j].d;
                H[(at_v_ + row) * width + column] += nu * (2.0 * along + damping_ * still);
                H[(at_v_ + row) * width + at_v_ + column] += 2.0 * nu * still;
                if (row < nd_)
                    Z_(row, column) += nu * still;
                else
                    H[(at_rho_ + row - nd_) * width + column] += nu * still;
            }
        }
    }
}

}  // namespace leastaction
