#include "discrete/curvature.hpp"

#include <algorithm>

#include "numerics/small_products.hpp"

namespace leastaction {

SecondOrder::SecondOrder(const Mechanism& mechanism, Split split)
    : mechanism_(mechanism),
      split_(split),
      nd_(mechanism.n_dynamic),
      nq_(mechanism.n_variables()),
      nu_(mechanism.n_inputs),
      nc_(mechanism.n_constraints()),
      n_theta_(nq_ + nd_ + mechanism.n_controls()),
      at_rho2_(nq_ + nd_ + nu_),
      dual_(mechanism, true),
      at_middle_(mechanism),
      at2_(mechanism),
      dual_at1_(mechanism),
      mu_(nd_ + nc_),
      turned_middle_(mechanism) {
    for (auto* a : {&q1, &q2, &q_mid_}) a->resize(mechanism.n_coordinates());
    for (auto* a : {&mu_force_, &v_, &mu_z_, &w_z_}) a->resize(nq_);
    for (auto* a : {&w_q, &w_p}) a->resize(nd_);
    w_rho.resize(nq_ - nd_);
    for (auto* a : {&lam, &w_lam}) a->resize(nc_);
    u.resize(nu_);
    for (auto* a : {&dual_q_, &dual_v_, &dual_q1_, &q_along_v_, &q_along_mu_}) a->resize(mechanism.n_coordinates());
    Z_ = NewtonMatrix::Matrix::Zero(nd_ + nc_, padded(n_theta_));
    begin_balls();
    if (mechanism_.forces.empty() && mechanism_.instant_forces.empty()) return;
    along_v_ = std::make_unique<Placement<Dual<double>>>(mechanism_);
    along_mu_ = std::make_unique<Placement<Dual<double>>>(mechanism_);
}

void SecondOrder::hessian(double dt, const FirstOrder& first) {
    set_multipliers(first);
    dual_at1_.time = t;
    at2_.time = t + dt;
    const int ny = nd_ + nc_;
    W_yy_.setZero(ny, ny);
    W_yth_.setZero(ny, n_theta_);
    W_thth_.setZero(padded(n_theta_), n_theta_);
    if (turned_)
        begin_turned(dt);
    else
        turned_middle_.set({}, dt);
    begin_middle(dt);
    evaluate_along(dt);
    if (!turned_) add_lagrangian(dt);
    add_potentials(dt);
    add_forces(dt);
    if (turned_) {  // of whose own second derivatives some are of what elements do
        add_bends(dt);
        add_lagrangian(dt);
    }
    add_instant_forces();  // of which balls have the turns of the start alone
    const bool at_ends = turned_ && (nc_ > 0 || prescribed_turns_ || !mechanism_.instant_forces.empty());
    if (at_ends) begin_turned_ends();
    add_constraints();
    if (at_ends) turn_ends();
    add_products(first);
}

void SecondOrder::set_multipliers(const FirstOrder& first) {
    const int ld = first.ld, at_p = nq_, at_h = n_theta_;
    std::fill(mu_.begin(), mu_.end(), 0.0);
    const auto add_row = [&](double weight, const double* row) {
        if (weight == 0.0) return;
        for (int i = 0; i < nd_; ++i) mu_[i] += weight * row[at_p + i];
        for (int c = 0; c < nc_; ++c) mu_[nd_ + c] += weight * row[at_h + c];
    };
    for (int i = 0; i < nd_; ++i) {
        add_row(w_q[i], &first.Y[i * ld]);
        add_row(w_p[i], &first.P2[i * ld]);
    }
    for (int c = 0; c < nc_; ++c) add_row(w_lam[c], &first.Y[(nd_ + c) * ld]);
}

void SecondOrder::evaluate_along(double dt) {
    const auto [mu_z, w_z, n_z] = directions();
    for (int i = 0; i < nq_; ++i) {
        const double mu = i < n_z ? mu_z[i] : 0.0, w = i < n_z ? w_z[i] : 0.0;
        dual_q_[i] = {q_mid_[i], 0.5 * dt * (mu + w)};
        dual_v_[i] = {v_[i], w - mu};
        dual_q1_[i] = {q1[i], i < nd_ ? mu_[i] : 0.0};
    }
    if (turned_) place_dual_balls();
    dual_.at.time = t + 0.5 * dt;
    dual_.gradient(dual_q_.data(), dual_v_.data());
}

void SecondOrder::add_lagrangian(double dt) {
    dual_.hessian(turned_middle_.joints());
    const PairDerivatives& d = dual_.pairs;
    each_pair(mechanism_, d.stride, [&](int i, int j, std::size_t at, auto weight, bool mirrored) {
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
}

// Of the potentials -dt V in mu.F + w_p.G, along the dq of the Lagrangian: the same in all three places.
void SecondOrder::add_potentials(double dt) {
    const Mechanism& m = mechanism_;
    if (m.potentials.empty()) return;
    Placement<Dual<double>>& at = turned_ ? *chart_middle_ : dual_.at;
    at.time = dual_.at.time;
    place(turned_ ? m.element_joints : m.massless_joints_seen, dual_q_.data(), at);
    turned_middle_.visit([&](const auto& turned) {
        const auto add = [&](int i, int j, const Dual<double>& bend) {
            turned.each_end(i, [&](int k, const ByEnds& of_i) {
                turned.each_end(j, [&](int l, const ByEnds& of_j) {
                    add_11(k, l, -bend.d * of_i.q_start * of_j.q_start);
                    add_12(k, l, -bend.d * of_i.q_start * of_j.q_end);
                    add_22(k, l, -bend.d * of_i.q_end * of_j.q_end);
                });
            });
        };
        for (const auto& potential : m.potentials) {
            for_each_entry(*potential, at, dual_q_.data(), dual_local_, add);
            if (turned_) add_turned_potential(*potential, dt);
        }
    });
}

void SecondOrder::begin_middle(double dt) {
    const double km = kappa_minus(split_, dt), kp = kappa_plus(split_, dt);
    const auto [mu_z, w_z, n_z] = directions();
    for (int i = 0; i < nd_; ++i) mu_force_[i] = km * mu_z[i] + kp * w_z[i];
    for (int i = 0; i < nq_; ++i) {
        q_mid_[i] = 0.5 * (q1[i] + q2[i]);
        v_[i] = (q2[i] - q1[i]) / dt;
    }
    if (turned_) place_balls();
}

// Of the forces: mu.fd- + w_p.fd+ = (kappa- mu + kappa+ w_p).f at the midpoint, with q = (q1 + q2)/2, v = (q2 - q1)/dt.
void SecondOrder::add_forces(double dt) {
    const Mechanism& m = mechanism_;
    if (m.forces.empty() && !(turned_ && m.has_elements_at_middle())) return;
    const int at_u = nq_ + nd_;
    const double time = t + 0.5 * dt;
    turned_middle_.visit([&](const auto& turned) {
        each_force_curvature(m.forces, m.force_joints, time, [&](const auto& force, std::size_t size, const auto& P) {
            const auto &support = force.support(), &inputs = force.inputs();
            const std::size_t n = support.size(), r = inputs.size();
            const auto second = [&](std::size_t a, std::size_t b) { return P[a * size + b]; };
            for (std::size_t a = 0; a < n; ++a)
                turned.each_end(support[a], [&](int k, const ByEnds& of_a) {
                    for (std::size_t b = 0; b < n; ++b) {
                        const double qq = second(a, b), qv = second(a, n + b), vq = second(n + a, b),
                                     vv = second(n + a, n + b);
                        const double start_q = of_a.q_start * qq + of_a.v_start * vq,
                                     start_v = of_a.q_start * qv + of_a.v_start * vv;
                        const double end_q = of_a.q_end * qq + of_a.v_end * vq,
                                     end_v = of_a.q_end * qv + of_a.v_end * vv;
                        turned.each_end(support[b], [&](int l, const ByEnds& of_b) {
                            add_11(k, l, start_q * of_b.q_start + start_v * of_b.v_start);
                            add_12(k, l, start_q * of_b.q_end + start_v * of_b.v_end);
                            add_22(k, l, end_q * of_b.q_end + end_v * of_b.v_end);
                        });
                    }
                    for (std::size_t b = 0; b < r; ++b) {
                        const double qu = second(a, 2 * n + b), vu = second(n + a, 2 * n + b);
                        add_input(k, inputs[b], of_a.q_start * qu + of_a.v_start * vu,
                                  of_a.q_end * qu + of_a.v_end * vu);
                    }
                });
            for (std::size_t a = 0; a < r; ++a)
                for (std::size_t b = 0; b < r; ++b)
                    if (inputs[a] <= inputs[b])
                        W_thth_(at_u + inputs[a], at_u + inputs[b]) += second(2 * n + a, 2 * n + b);
        });
    });
    if (turned_) add_turned_forces(dt);
}

void SecondOrder::add_input(int i, int input, double start, double end) {
    const int at = nq_ + nd_ + input;
    W_thth_(i, at) += start;
    if (i < nd_)
        W_yth_(i, at) += end;
    else
        W_thth_(at, at_rho2_ + i - nd_) += end;
}

// Of share f(q1, 0, u), which stands beside p1.
void SecondOrder::add_instant_forces() {
    const Mechanism& m = mechanism_;
    if (m.instant_forces.empty()) return;
    const int at_u = nq_ + nd_;
    for (int i = 0; i < nd_; ++i) mu_force_[i] = share * mu_[i];
    q_mid_ = q1;
    std::fill(v_.begin(), v_.end(), 0.0);
    each_force_curvature(
        m.instant_forces, m.instant_joints, t, [&](const auto& force, std::size_t size, const auto& P) {
            const auto &support = force.support(), &inputs = force.inputs();
            const std::size_t n = support.size(), r = inputs.size();
            for (std::size_t a = 0; a < n; ++a) {
                for (std::size_t b = 0; b < n; ++b) add_11(support[a], support[b], P[a * size + b]);
                for (std::size_t b = 0; b < r; ++b) W_thth_(support[a], at_u + inputs[b]) += P[a * size + 2 * n + b];
            }
            for (std::size_t a = 0; a < r; ++a)
                for (std::size_t b = 0; b < r; ++b)
                    if (inputs[a] <= inputs[b])
                        W_thth_(at_u + inputs[a], at_u + inputs[b]) += P[(2 * n + a) * size + 2 * n + b];
        });
}

template <class Sink>
void SecondOrder::each_force_curvature(const std::vector<std::shared_ptr<const GeneralizedForce>>& forces,
                                       const std::vector<int>& joints, double time, const Sink& sink) {
    if (forces.empty()) return;
    for (int i = 0; i < nq_; ++i) {
        q_along_v_[i] = {q_mid_[i], v_[i]};
        q_along_mu_[i] = {q_mid_[i], mu_force_[i]};
    }
    for (std::size_t i = nq_; i < q_mid_.size(); ++i) q_along_v_[i] = q_along_mu_[i] = q_mid_[i];
    at_middle_.time = time;
    along_v_->time = along_mu_->time = time;
    place(joints, q_mid_.data(), at_middle_);
    place(joints, q_along_v_.data(), *along_v_);
    place(joints, q_along_mu_.data(), *along_mu_);
    const ForceDirections directions{*along_v_, *along_mu_, q_along_v_.data(), q_along_mu_.data(), mu_force_.data()};
    for (const auto& force : forces) {
        force->curvature({at_middle_, q_mid_.data(), v_.data(), u.data()}, directions, force_);
        sink(*force, 2 * force->support().size() + force->inputs().size(), force_.second);
    }
}

void SecondOrder::add_constraints() {
    place(mechanism_.constraint_joints, dual_q1_.data(), dual_at1_);
    place(mechanism_.constraint_joints, end(), at2_);
    for (int c = 0; c < nc_; ++c) {
        const auto& constraint = *mechanism_.constraints[c];
        for_each_entry(constraint, dual_at1_, dual_q1_.data(), dual_local_,
                       [&](int i, int j, const Dual<double>& bend) {
                           if (i <= j) W_thth_(i, j) -= lam[c] * bend.d;
                           if (turned_) note_bend_at_start(i, j, -lam[c] * bend.v);
                       });
        if (turned_) note_constraint_at_start(c);
        for (std::size_t i = 0; i < constraint.support().size(); ++i)
            W_yth_(nd_ + c, constraint.support()[i]) -= dual_local_.gradient[i].d;  // d(Dh mu)/dq1
        if (prescribed_turns_) continue;
        for_each_entry(constraint, at2_, end(), local_,
                       [&](int i, int j, double bend) { add_22(i, j, mu_[nd_ + c] * bend); });
        if (turned_) note_constraint_at_end(c);
    }
}

double SecondOrder::by_time_step(double dt, const FirstOrder& first, MidpointStep& step, const ParameterSlopes& slopes,
                                 double* out) {
    using Vector = Eigen::VectorXd;
    const Mechanism& m = mechanism_;
    const int ny = nd_ + nc_;
    by_instants_.begin(nq_, nu_);
    auto& [e, c, by_q1, by_q2, by_u] = by_instants_;
    Vector &v = at_v_, &g = g_, &by_q = by_q_, &T_vv_v = T_vv_v_, &L_vv_g = L_vv_g_;
    for (Vector* a : {&v, &g, &by_q, &T_vv_v, &L_vv_g}) a->setZero(nq_);
    const double km = kappa_minus(split_, dt), kp = kappa_plus(split_, dt);
    const auto [mu, w, n_z] = directions();
    for (int i = 0; i < nq_; ++i) v[i] = (q2[i] - q1[i]) / dt;
    for (int i = 0; i < n_z; ++i) {
        e[i] = 0.5 * (mu[i] + w[i]);
        g[i] = w[i] - mu[i];
        c[i] = (km * mu[i] + kp * w[i]) / dt;
    }
    if (turned_) dual_.hessian();  // by turns of the middle and rates, along a field that is held
    const PairDerivatives &T = dual_.pairs, &L = step.kernel_pairs();
    each_pair(m, T.stride, [&](int i, int j, std::size_t at, auto weight, bool mirrored) {
        by_q[i] -= weight * T.q_v[at] * v[j] / dt;
        T_vv_v[i] += weight * T.vv[at] * v[j];
        if (!mirrored) return;
        by_q[j] -= weight * T.v_q[at] * v[i] / dt;
        T_vv_v[j] += weight * T.vv[at] * v[i];
    });
    if (turned_) L_qv_v_.setZero(nq_);
    each_pair(m, L.stride, [&](int i, int j, std::size_t at, auto weight, bool mirrored) {
        if (turned_) {
            L_qv_v_[i] += weight * L.q_v[at] * v[j];
            if (mirrored) L_qv_v_[j] += weight * L.v_q[at] * v[i];
        }
        by_q[i] += weight * L.qq[at] * e[j];
        L_vv_g[i] += weight * L.vv[at] * g[j];
        if (!mirrored) return;
        by_q[j] += weight * L.qq[at] * e[i];
        L_vv_g[j] += weight * L.vv[at] * g[i];
    });
    const ForcePoint<double> middle = step.middle();
    for_each_entry(m.potentials, middle.at, middle.q, local_,
                   [&](int i, int j, double bend) { by_q[i] -= bend * e[j]; });
    by_v_ = -(T_vv_v + L_vv_g) / dt;
    double twice = (v.dot(T_vv_v) + 2.0 * v.dot(L_vv_g)) / (dt * dt);

    for (const auto& [i, input] : m.joint_forces) by_u[input] += c[i];
    for_each_entry(
        m.forces, middle, force_, [&](int i, int j, double f_q, double) { by_q[j] += c[i] * f_q; },
        [&](int i, int input, double f_u) { by_u[input] += c[i] * f_u; });
    begin_middle(dt);
    each_force_curvature(m.forces, m.force_joints, t + 0.5 * dt,
                         [&](const auto& force, std::size_t size, const auto& second) {
                             const auto &support = force.support(), &inputs = force.inputs();
                             const std::size_t n = support.size();
                             for (std::size_t b = 0; b < n; ++b) {
                                 const double rate = v[support[b]] / dt;  // second derivatives are those of dt c.f
                                 const double* row = &second[(n + b) * size];
                                 for (std::size_t a = 0; a < n; ++a) {
                                     by_q[support[a]] -= row[a] * rate;
                                     by_v_[support[a]] -= row[n + a] * rate;
                                     twice += row[n + a] * rate * v[support[a]] / dt;
                                 }
                                 for (std::size_t a = 0; a < inputs.size(); ++a)
                                     by_u[inputs[a]] -= row[2 * n + a] * rate;
                             }
                         });
    const double grows = share / dt;
    for (const auto& [i, input] : m.instant_joint_forces) by_u[input] += grows * mu_[i];
    for_each_entry(
        m.instant_forces, step.instant(), force_,
        [&](int i, int j, double f_q, double) {
            if (i < nd_) by_q1[j] += grows * mu_[i] * f_q;
        },
        [&](int i, int input, double f_u) {
            if (i < nd_) by_u[input] += grows * mu_[i] * f_u;
        });
    if (turned_) {
        changes_.setZero(nq_, 5);
        for (int i = 0; i < nd_; ++i) {
            changes_(i, 0) = dt * slopes.L_q[i] + (km + kp) * slopes.f[i];
            changes_(i, 1) = slopes.L_v[i] + 0.5 * (kp - km) * slopes.f[i];
        }
        for_each_entry(m.instant_forces, step.instant(), force_, [&](int i, double f) { changes_(i, 2) += grows * f; });
        for (int i = 0; i < nq_; ++i)
            changes_(i, 3) = step.lagrangian().L_q[i] - dual_.L_q[i].v + (km + kp) * slopes.f[i];
        changes_.col(4) = by_v_ + (T_vv_v + L_vv_g) / dt;
        for (const Ball& ball : m.balls) {  // of the bodies, what is by the axes of the middle
            const auto at = [&](const Vector& of) {
                return Vec3<double>{of[ball.variable], of[ball.variable + 1], of[ball.variable + 2]};
            };
            const Dual<double>* slope = &dual_.L_q[ball.variable];
            const Vec3<double> more =
                cross(at(e), Vec3<double>{0.5 * slope[0].v, 0.5 * slope[1].v, 0.5 * slope[2].v} - at(L_qv_v_));
            by_q.segment<3>(ball.variable) += Eigen::Vector3d(more.x, more.y, more.z);
        }
    }
    by_y_.setZero(ny, 1);
    const Vector own = Eigen::Map<const NewtonMatrix::Matrix>(slopes.Y.data(), ny, slopes.ld).col(0);
    bent_.noalias() = W_yy_ * own;
    by_theta(dt, first, 0, own, out);
    return twice + own.dot(2.0 * by_y_.col(0) + bent_.col(0));
}

void SecondOrder::by_theta(double dt, const FirstOrder& first, int column, const Eigen::VectorXd& own, double* out) {
    if (turned_) turn_changes(dt);
    auto& [e, c, by_q1, by_q2, by_u] = by_instants_;
    by_q1 += 0.5 * by_q_ - by_v_ / dt;
    by_q2 += 0.5 * by_q_ + by_v_ / dt;
    by_y_.col(column).head(nd_) = by_q2.head(nd_);
    Eigen::Map<Eigen::VectorXd> row(out, n_theta_);
    row.setZero();
    row.head(nq_) = by_q1;
    row.segment(nq_ + nd_, nu_) = by_u;
    row.tail(nq_ - nd_) = by_q2.tail(nq_ - nd_);
    for (int i = 0; i < nd_ + nc_; ++i) {
        const double whole = by_y_(i, column) + bent_(i, column), *Y = &first.Y[i * first.ld];
        for (int j = 0; j < n_theta_; ++j) row[j] += whole * Y[j] + own[i] * W_yth_(i, j);
    }
}

void SecondOrder::add_products(const FirstOrder& first) {
    // Rows of Y and Z are the columns of the first factors.
    const int ny = nd_ + nc_;
    const Eigen::Index stride = Z_.outerStride();
    const Columns Y{first.Y.data(), first.ld}, Z{Z_.data(), stride};
    const auto entries = [](const Columns& of) { return Entries{of.data, of.stride, 1}; };
    half_W_yy_ = 0.5 * W_yy_;
    Z_.leftCols(n_theta_) = W_yth_;
    product(Into::add, n_theta_, ny, ny, Y, {half_W_yy_.data(), ny, 1}, {Z_.data(), stride});
    upper_product(Into::add, n_theta_, Sum{Factors{ny, Y, entries(Z)}, Factors{ny, Z, entries(Y)}},
                  {W_thth_.data(), W_thth_.outerStride()});
}

void SecondOrder::write(const std::vector<Run>& runs, double* out, int ld_out) {
    mirror_upper(W_thth_, n_theta_);
    for (const Run& of : runs) {
        for (int j = 0; j < of.length; ++j) {
            const double* column = &W_thth_(0, of.first + j);
            double* row = out + static_cast<std::size_t>(of.position + j) * ld_out;
            for (const Run& to : runs) std::copy_n(column + to.first, to.length, row + to.position);
        }
    }
}

void SecondOrder::write_packed(const std::vector<int>& order, double* out) const {
    for (int j = 0; j < n_theta_; ++j) {
        if (mechanism_.same_order) {
            out = std::copy_n(&W_thth_(0, j), j + 1, out);
            continue;
        }
        for (int i = 0; i <= j; ++i) {
            const auto [low, high] = std::minmax(order[i], order[j]);
            *out++ = W_thth_(low, high);
        }
    }
}

}  // namespace leastaction
