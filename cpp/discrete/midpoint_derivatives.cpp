#include <algorithm>
#include <cmath>

#include "discrete/midpoint.hpp"

namespace leastaction {

namespace {

constexpr int strip = 32;  // rows of the Hessian made at a time

// Where an entry of th stands in the output.
int position(const std::vector<MidpointStep::Run>& runs, int i) {
    for (const auto& run : runs)
        if (i < run.first + run.length) return run.position + i - run.first;
    return -1;
}

using Rows = Eigen::Map<NewtonMatrix::Matrix>;

}  // namespace

void MidpointStep::reserve_derivatives() {
    if (!P2.empty()) return;
    Y.assign(static_cast<std::size_t>(nd_ + nc_) * ld_, 0.0);
    P2.assign(static_cast<std::size_t>(nd_) * ld_, 0.0);
    for (auto* a : {&YZ_, &ZY_}) a->resize(2 * (nd_ + nc_), n_theta_);
    strip_.resize(strip, n_theta_);
}

bool MidpointStep::differentiate(double dt) {
    // One Newton matrix, at the solution itself, serves every derivative.
    if (!factored_at_solution_ && !refresh(dt, false)) return false;
    reserve_derivatives();
    const int ld = ld_, at_p = nq_, at_u = nq_ + nd_, at_rho2 = at_u + nu_, at_h = n_theta_;
    const double km = kappa_minus(dt), kp = kappa_plus(dt);

    // The right-hand side -F_th, solved in place for Y, and the direct part of dp2/dth; G_y = dp2/dq2.
    std::fill(Y.begin(), Y.end(), 0.0);
    std::fill(P2.begin(), P2.end(), 0.0);
    G_y_.setZero(nd_, nd_);
    // Second derivatives of Ld for rows i, dynamic: by q1_i q1_j, q1_i q2_j, q2_i q1_j and q2_i q2_j.
    const auto add = [&](int i, int j, double d11, double d12, double d21, double d22) {
        Y[i * ld + j] -= d11;
        P2[i * ld + j] += d21;
        if (j < nd_) {
            G_y_(i, j) += d22;
        } else {
            Y[i * ld + at_rho2 + j - nd_] -= d12;
            P2[i * ld + at_rho2 + j - nd_] += d22;
        }
    };
    const PairDerivatives& d = lagrangian_.pairs;
    each_pair(*mechanism_, d.stride, [&](int i, int j, std::size_t at, auto weight, bool mirrored) {
        const double qq = weight * (0.25 * dt * d.qq[at]), vv = weight * (d.vv[at] / dt);
        const double sum = weight * (0.5 * (d.q_v[at] + d.v_q[at])), odd = weight * (0.5 * (d.q_v[at] - d.v_q[at]));
        if (i < nd_) add(i, j, qq - sum + vv, qq - vv + odd, qq - vv - odd, qq + sum + vv);
        if (j < nd_ && mirrored) add(j, i, qq - sum + vv, qq - vv - odd, qq - vv + odd, qq + sum + vv);
    });
    for (int i = 0; i < nd_; ++i) Y[i * ld + at_p + i] = -1.0;
    const auto add_force = [&](int i, int j, double f_q, double f_v) {
        f_q *= 0.5;
        f_v /= dt;
        add(i, j, km * (f_q - f_v), km * (f_q + f_v), kp * (f_q - f_v), kp * (f_q + f_v));
    };
    const auto add_input = [&](int i, int input, double f_u) {
        Y[i * ld + at_u + input] -= km * f_u;
        P2[i * ld + at_u + input] += kp * f_u;
    };
    for (const auto& [i, slot] : mechanism_->damping) add_force(i, i, 0.0, -mechanism_->numbers[slot]);
    for (const auto& [i, input] : mechanism_->joint_forces) add_input(i, input, 1.0);
    for (const auto& potential : mechanism_->potentials) {
        const auto& support = potential->support();
        potential->evaluate(lagrangian_.at, q_mid_.data(), Order::hessian, local_);
        for (std::size_t a = 0; a < support.size(); ++a)
            for (std::size_t b = 0; b < support.size() && support[a] < nd_; ++b) {
                const double qq = -0.25 * dt * local_.hessian[a * support.size() + b];
                add(support[a], support[b], qq, qq, qq, qq);
            }
    }
    for (const auto& force : mechanism_->forces) {
        const auto &support = force->support(), &inputs = force->inputs();
        force->evaluate(force_point(), Order::gradient, force_);
        for (std::size_t a = 0; a < support.size(); ++a) {
            if (support[a] >= nd_) continue;
            for (std::size_t b = 0; b < support.size(); ++b)
                add_force(support[a], support[b], force_.f_q[a * support.size() + b],
                          force_.f_v[a * support.size() + b]);
            for (std::size_t b = 0; b < inputs.size(); ++b)
                add_input(support[a], inputs[b], force_.f_u[a * inputs.size() + b]);
        }
    }
    for (int c = 0; c < nc_; ++c) {
        const auto& constraint = *mechanism_->constraints[c];
        const auto& support = constraint.support();
        const std::size_t m = support.size();
        constraint.evaluate(at1_, q1.data(), Order::hessian, local_);
        for (std::size_t a = 0; a < m; ++a) {
            if (support[a] >= nd_) continue;
            double* y = &Y[support[a] * ld];
            for (std::size_t b = 0; b < m; ++b) y[support[b]] += lam[c] * local_.hessian[a * m + b];
        }
        double* y = &Y[(nd_ + c) * ld];
        for (int k = 0; k < nk_; ++k) y[at_rho2 + k] = -C2_[c * nq_ + nd_ + k];
        y[at_h + c] = -1.0;  // a shift of h: F2 = h + s
    }
    newton_.solve(Y.data(), Y.data() + nd_ * ld, n_theta_ + nc_, ld);

    // p2 depends on th through q2 as well.
    Rows p2_rows(P2.data(), nd_, ld), q2_rows(Y.data(), nd_, ld);
    p2_rows.noalias() += G_y_ * q2_rows;
    return true;
}

// Of the potentials -dt V in mu.F + w_p.G, along the dq of the Lagrangian: the same in all three places.
template <class Add11, class Add12, class Add22>
void MidpointStep::potential_curvature(const Add11& add_11, const Add12& add_12, const Add22& add_22) {
    const Mechanism& m = *mechanism_;
    if (m.potentials.empty()) return;
    place(m.massless_joints_seen, dual_q_.data(), dual_.at);
    for (const auto& potential : m.potentials) {
        const auto& support = potential->support();
        potential->evaluate(dual_.at, dual_q_.data(), Order::hessian, dual_local_);
        for (std::size_t a = 0; a < support.size(); ++a)
            for (std::size_t b = 0; b < support.size(); ++b) {
                const double value = -0.25 * dual_local_.hessian[a * support.size() + b].d;
                add_11(support[a], support[b], value);
                add_12(support[a], support[b], value);
                add_22(support[a], support[b], value);
            }
    }
}

// Of the forces: mu.fd- + w_p.fd+ = (kappa- mu + kappa+ w_p).f at the midpoint, with q = (q1 + q2)/2, v = (q2 - q1)/dt.
template <class Add11, class Add12, class Add22>
void MidpointStep::force_curvature(double dt, const Add11& add_11, const Add12& add_12, const Add22& add_22) {
    const Mechanism& m = *mechanism_;
    const double km = kappa_minus(dt), kp = kappa_plus(dt);
    const int at_u = nq_ + nd_;
    for (int i = 0; i < nd_; ++i) mu_force_[i] = km * mu_[i] + kp * w_p[i];
    for (int i = 0; i < nq_; ++i) {
        q_mid_[i] = 0.5 * (q1[i] + q2[i]);
        v_[i] = (q2[i] - q1[i]) / dt;
        q_along_v_[i] = {q_mid_[i], v_[i]};
        q_along_mu_[i] = {q_mid_[i], mu_force_[i]};
    }
    place(m.force_joints, q_mid_.data(), lagrangian_.at);
    place(m.force_joints, q_along_v_.data(), *along_v_);
    place(m.force_joints, q_along_mu_.data(), *along_mu_);
    const ForceDirections directions{*along_v_, *along_mu_, q_along_v_.data(), q_along_mu_.data(), mu_force_.data()};
    for (const auto& force : m.forces) {
        const auto &support = force->support(), &inputs = force->inputs();
        const std::size_t n = support.size(), r = inputs.size(), size = 2 * n + r;
        force->curvature(force_point(), directions, force_);
        const auto second = [&](std::size_t a, std::size_t b) { return force_.second[a * size + b]; };
        for (std::size_t a = 0; a < n; ++a) {
            const int i = support[a];
            for (std::size_t b = 0; b < n; ++b) {
                const double qq = 0.25 * second(a, b), vv = second(n + a, n + b) / (dt * dt);
                const double qv = 0.5 * second(a, n + b) / dt, vq = 0.5 * second(n + a, b) / dt;
                add_11(i, support[b], qq - qv - vq + vv);
                add_12(i, support[b], qq + qv - vq - vv);
                add_22(i, support[b], qq + qv + vq + vv);
            }
            for (std::size_t b = 0; b < r; ++b) {
                const double qu = 0.5 * second(a, 2 * n + b), vu = second(n + a, 2 * n + b) / dt;
                const int input = at_u + inputs[b];
                W_thth_(i, input) += qu - vu;
                if (i < nd_)
                    W_yth_(i, input) += qu + vu;
                else
                    W_thth_(input, at_u + nu_ + i - nd_) += qu + vu;
            }
        }
        for (std::size_t a = 0; a < r; ++a)
            for (std::size_t b = 0; b < r; ++b)
                if (inputs[a] <= inputs[b]) W_thth_(at_u + inputs[a], at_u + inputs[b]) += second(2 * n + a, 2 * n + b);
    }
}

// With the multipliers mu of the step's equations, mu = -F_y^-T (w_y + G_y' w_p), which are the derivatives of the
// weighted sum by p1 and by a shift of h, the Hessian is [Y; I]' W [Y; I], W the Hessian of mu.F + w_p.G by (y, th).
// The Lagrangian's part of mu.F + w_p.G is the derivative of L along dq = dt/2 (mu + w_p), dv = w_p - mu, so W
// comes from one dual sweep; of the constraints, -mu.Dh(q1)'lam is a derivative of h along mu.
void MidpointStep::curvature(double dt, const std::vector<Run>& runs, double* out, int ld_out) {
    const int ld = ld_, ny = nd_ + nc_, at_p = nq_, at_rho2 = nq_ + nd_ + nu_, at_h = n_theta_;
    std::fill(mu_.begin(), mu_.end(), 0.0);
    const auto add_row = [&](double weight, const double* row) {
        if (weight == 0.0) return;
        for (int i = 0; i < nd_; ++i) mu_[i] += weight * row[at_p + i];
        for (int c = 0; c < nc_; ++c) mu_[nd_ + c] += weight * row[at_h + c];
    };
    for (int i = 0; i < nd_; ++i) {
        add_row(w_q[i], &Y[i * ld]);
        add_row(w_p[i], &P2[i * ld]);
    }
    for (int c = 0; c < nc_; ++c) add_row(w_lam[c], &Y[(nd_ + c) * ld]);

    for (int i = 0; i < nq_; ++i) {
        const double mu = i < nd_ ? mu_[i] : 0.0, w = i < nd_ ? w_p[i] : 0.0;
        dual_q_[i] = {0.5 * (q1[i] + q2[i]), 0.5 * dt * (mu + w)};
        dual_v_[i] = {(q2[i] - q1[i]) / dt, w - mu};
        dual_q1_[i] = {q1[i], mu};
    }
    dual_.gradient(dual_q_.data(), dual_v_.data());
    dual_.hessian();

    W_yy_.setZero(ny, ny);
    W_yth_.setZero(ny, n_theta_);
    W_thth_.setZero(n_theta_, n_theta_);
    // Second derivatives by (q1, q2), each put where the variable lives: q2 is y (dynamic) or rho2 (kinematic).
    const auto add_12 = [&](int i1, int j2, double value) {
        if (j2 < nd_)
            W_yth_(j2, i1) += value;
        else
            W_thth_(i1, at_rho2 + j2 - nd_) += value;  // upper triangle
    };
    const auto add_22 = [&](int i, int j, double value) {  // called for both (i, j) and (j, i)
        if (i < nd_ && j < nd_)
            W_yy_(i, j) += value;
        else if (i < nd_)
            W_yth_(i, at_rho2 + j - nd_) += value;
        else if (j >= nd_ && i <= j)
            W_thth_(at_rho2 + i - nd_, at_rho2 + j - nd_) += value;
    };
    const auto add_11 = [&](int i, int j, double value) {  // called for both (i, j) and (j, i)
        if (i <= j) W_thth_(i, j) += value;
    };
    const PairDerivatives& d = dual_.pairs;
    each_pair(*mechanism_, d.stride, [&](int i, int j, std::size_t at, auto weight, bool mirrored) {
        const double qq = weight * (0.25 * d.qq[at]), vv = weight * (d.vv[at] / (dt * dt));
        const double sum = weight * (0.5 * (d.q_v[at] + d.v_q[at]) / dt);
        const double odd = weight * (0.5 * (d.q_v[at] - d.v_q[at]) / dt);
        add_11(i, j, qq - sum + vv);
        add_22(i, j, qq + sum + vv);
        add_12(i, j, qq - vv + odd);
        if (mirrored) {
            add_11(j, i, qq - sum + vv);
            add_22(j, i, qq + sum + vv);
            add_12(j, i, qq - vv - odd);
        }
    });
    potential_curvature(add_11, add_12, add_22);
    if (!mechanism_->forces.empty()) force_curvature(dt, add_11, add_12, add_22);
    place(mechanism_->constraint_joints, dual_q1_.data(), dual_at1_);
    place(mechanism_->constraint_joints, q2.data(), at2_);
    for (int c = 0; c < nc_; ++c) {
        const auto& constraint = *mechanism_->constraints[c];
        const auto& support = constraint.support();
        const int m = static_cast<int>(support.size());
        constraint.evaluate(dual_at1_, dual_q1_.data(), Order::hessian, dual_local_);
        for (int a = 0; a < m; ++a) {
            W_yth_(nd_ + c, support[a]) -= dual_local_.gradient[a].d;  // d(Dh mu)/dq1
            for (int b = 0; b < m; ++b)
                if (support[a] <= support[b])
                    W_thth_(support[a], support[b]) -= lam[c] * dual_local_.hessian[a * m + b].d;
        }
        constraint.evaluate(at2_, q2.data(), Order::hessian, local_);
        for (int a = 0; a < m; ++a)
            for (int b = 0; b < m; ++b) add_22(support[a], support[b], mu_[nd_ + c] * local_.hessian[a * m + b]);
    }

    // H = W_thth + Y'Z + Z'Y with Z = W_yy Y / 2 + W_yth, as one product [Y; Z]'[Z; Y]: strips of rows, the upper triangle
    // only, each written out together with its mirror image while it is in the cache.
    Rows y_rows(Y.data(), ny, ld);
    YZ_.topRows(ny) = y_rows.leftCols(n_theta_);
    auto z = YZ_.bottomRows(ny);
    z = W_yth_;
    z.noalias() += (0.5 * W_yy_) * YZ_.topRows(ny);
    ZY_.topRows(ny) = z;
    ZY_.bottomRows(ny) = YZ_.topRows(ny);
    for (int first = 0; first < n_theta_; first += strip) {
        const int rows = std::min(strip, n_theta_ - first), rest = n_theta_ - first;
        auto block = strip_.topLeftCorner(rows, rest);
        block = W_thth_.block(first, first, rows, rest);
        block.noalias() += YZ_.middleCols(first, rows).transpose() * ZY_.rightCols(rest);
        for (int i = 0; i < rows; ++i)
            for (int j = 0; j < i; ++j) block(i, j) = block(j, i);
        int at[strip];
        for (int i = 0; i < rows; ++i) at[i] = position(runs, first + i);
        for (const Run& to : runs) {
            const int begin = std::max(to.first, first) - first, end = to.first + to.length - first;
            for (int i = 0; i < rows && begin < end; ++i)
                std::copy(&block(i, 0) + begin, &block(i, 0) + end,
                          out + static_cast<std::size_t>(at[i]) * ld_out + to.position + first + begin - to.first);
        }
        for (int j = rows; j < rest; ++j) {
            double* row = out + static_cast<std::size_t>(position(runs, first + j)) * ld_out;
            for (int i = 0; i < rows; ++i) row[at[i]] = block(i, j);
        }
    }
}

// By a parameter th of the numbers: F1_th = dt/2 L_qth - L_vth + kappa- f_th - (Dh(q1)'lam)_th and F2_th = h_th(q2), solved for
// the unknowns like the columns of differentiate(); numbers of elements by dual evaluations, inertias by their linearity.
void MidpointStep::differentiate_by(double dt, const std::vector<Parameter>& parameters) {
    const Mechanism& m = *mechanism_;
    const int count = static_cast<int>(parameters.size()), ny = nd_ + nc_;
    const double km = kappa_minus(dt), kp = kappa_plus(dt);
    ld_parameters_ = (count + NewtonMatrix::lanes - 1) / NewtonMatrix::lanes * NewtonMatrix::lanes;
    Y_parameters.assign(static_cast<std::size_t>(ny) * ld_parameters_, 0.0);
    P2_parameters.assign(static_cast<std::size_t>(nd_) * ld_parameters_, 0.0);
    Placement<Dual<double>> start(m), end(m), middle(m);
    const auto still = [](const std::vector<double>& q) { return std::vector<Dual<double>>(q.begin(), q.end()); };
    const auto Q1 = still(q1), Q2 = still(q2), Q = still(q_mid_), V = still(v_), U = still(u);
    place(m.constraint_joints, Q1.data(), start);
    place(m.constraint_joints, Q2.data(), end);
    place(m.element_joints, Q.data(), middle);
    LocalForce<Dual<double>> force_taylor;
    std::vector<double> L_q(nq_), L_v(nq_), f(nq_);
    for (int k = 0; k < count; ++k) {
        const Parameter& parameter = parameters[k];
        for (auto* a : {&L_q, &L_v, &f}) std::fill(a->begin(), a->end(), 0.0);
        const auto y = [&](int row) -> double& { return Y_parameters[row * ld_parameters_ + k]; };
        for (const auto& [joint, inertia] : parameter.inertias) lagrangian_.add_inertia_slope(joint, inertia, L_q, L_v);
        if (!parameter.numbers.empty()) {
            start.number_slopes = end.number_slopes = middle.number_slopes = parameter.numbers.data();
            for (const auto& [i, slot] : m.damping) f[i] -= parameter.numbers[slot] * v_[i];
            for (const auto& potential : m.potentials) {
                potential->evaluate(middle, Q.data(), Order::gradient, dual_local_);
                for (std::size_t i = 0; i < potential->support().size(); ++i)
                    L_q[potential->support()[i]] -= dual_local_.gradient[i].d;
            }
            for (const auto& force : m.forces) {
                force->evaluate({middle, Q.data(), V.data(), U.data()}, force_taylor);
                for (std::size_t i = 0; i < force->support().size(); ++i) f[force->support()[i]] += force_taylor.f[i].d;
            }
            for (int c = 0; c < nc_; ++c) {
                const auto& constraint = *m.constraints[c];
                constraint.evaluate(start, Q1.data(), Order::gradient, dual_local_);
                for (std::size_t i = 0; i < constraint.support().size(); ++i)
                    if (constraint.support()[i] < nd_) y(constraint.support()[i]) += lam[c] * dual_local_.gradient[i].d;
                constraint.evaluate(end, Q2.data(), Order::value, dual_local_);
                y(nd_ + c) = -dual_local_.value.d;
            }
        }
        for (int i = 0; i < nd_; ++i) {
            y(i) -= 0.5 * dt * L_q[i] - L_v[i] + km * f[i];
            P2_parameters[i * ld_parameters_ + k] = 0.5 * dt * L_q[i] + L_v[i] + kp * f[i];
        }
    }
    newton_.solve(Y_parameters.data(), Y_parameters.data() + nd_ * ld_parameters_, count, ld_parameters_);
    Eigen::Map<NewtonMatrix::Matrix> p2(P2_parameters.data(), nd_, ld_parameters_);
    p2.noalias() += G_y_ * Eigen::Map<NewtonMatrix::Matrix>(Y_parameters.data(), nd_, ld_parameters_);
}

}  // namespace leastaction
