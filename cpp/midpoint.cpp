#include "midpoint.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace leastaction {

namespace {

constexpr double slow_contraction = 0.05;  // an iteration that gains less asks for a fresh Newton matrix
constexpr double rounding_floor = 1e-9;    // where the residual stops falling below this, rounding is reached
constexpr int max_halvings = 8;
constexpr int strip = 32;             // rows of the Hessian made at a time
constexpr double fresh_price = 0.5;   // of a new Newton matrix, in iterations
constexpr double same_point = 1e-14;  // relative moves below this leave the Newton matrix exact

// Where an entry of th stands in the output.
int position(const std::vector<MidpointStep::Run>& runs, int i) {
    for (const auto& run : runs)
        if (i < run.first + run.length) return run.position + i - run.first;
    return -1;
}

using Rows = Eigen::Map<NewtonMatrix::Matrix>;

}  // namespace

MidpointStep::MidpointStep(std::shared_ptr<const Mechanism> mechanism, const MidpointSettings& settings)
    : mechanism_(std::move(mechanism)),
      settings_(settings),
      nd_(mechanism_->n_dynamic),
      nq_(mechanism_->n_variables()),
      nu_(mechanism_->n_inputs),
      nk_(mechanism_->n_kinematic),
      nc_(mechanism_->n_constraints()),
      n_theta_(nq_ + nd_ + nu_ + nk_),
      ld_((n_theta_ + nc_ + 7) / 8 * 8),
      lagrangian_(*mechanism_),
      dual_(*mechanism_),
      newton_(*mechanism_),
      at1_(mechanism_->joints.size()),
      at2_(mechanism_->joints.size()),
      dual_at1_(mechanism_->joints.size()) {
    const auto sized = [](std::vector<double>& a, std::size_t n) { a.assign(n, 0.0); };
    const std::size_t nd = nd_, nq = nq_, ny = nd_ + nc_;
    for (auto* a : {&q1, &q2, &q_mid_, &v_}) sized(*a, nq);
    for (auto* a : {&p1, &p2, &f_, &q2_kept_, &root_inertia_, &diagonal_, &diagonal_q_, &diagonal_v_}) sized(*a, nd);
    sized(u, nu_);
    for (auto* a : {&lam, &h_, &h_scale_, &lam_kept_}) sized(*a, nc_);
    for (auto* a : {&residual, &residual_scale, &first_scale_, &correction_, &mu_}) sized(*a, ny);
    for (auto* a : {&C1_, &C2_}) sized(*a, nc_ * nq);
    for (auto* a : {&dual_q_, &dual_v_, &dual_q1_}) a->resize(nq);

    for (const auto& force : mechanism_->forces) forces_couple_ = forces_couple_ || !force->couplings().empty();
    const bool fits = !forces_couple_ && mechanism_->potentials.empty();
    if (fits && (settings.solver == Solver::tree ||
                 (settings.solver == Solver::automatic && TreeNewton::is_faster(*mechanism_))))
        tree_ = std::make_unique<TreeNewton>(*mechanism_);
}

void MidpointStep::reserve_derivatives() {
    if (!P2.empty()) return;
    Y.assign(static_cast<std::size_t>(nd_ + nc_) * ld_, 0.0);
    P2.assign(static_cast<std::size_t>(nd_) * ld_, 0.0);
    for (auto* a : {&YZ_, &ZY_}) a->resize(2 * (nd_ + nc_), n_theta_);
    strip_.resize(strip, n_theta_);
}

void MidpointStep::constraint_gradients(const Placement<double>& at, const double* q, double* C) {
    std::fill(C, C + nc_ * nq_, 0.0);
    for (int c = 0; c < nc_; ++c) {
        const auto& constraint = *mechanism_->constraints[c];
        constraint.evaluate(at, q, Order::gradient, local_);
        h_[c] = local_.value;
        h_scale_[c] = local_.scale;
        for (std::size_t i = 0; i < constraint.support().size(); ++i)
            C[c * nq_ + constraint.support()[i]] += local_.gradient[i];
    }
}

void MidpointStep::place_start() {
    place(mechanism_->joints, mechanism_->constraint_joints, q1.data(), at1_);
    constraint_gradients(at1_, q1.data(), C1_.data());
    have_factors_ = false;
}

void MidpointStep::momenta(double dt, std::vector<double>& start) {
    std::fill(p1.begin(), p1.end(), 0.0);
    std::fill(lam.begin(), lam.end(), 0.0);
    place(mechanism_->joints, mechanism_->prescribed_constraint_joints, q2.data(), at2_);
    evaluate(dt);
    for (int i = 0; i < nd_; ++i) start[i] = -residual[i];
}

void MidpointStep::advance() {
    q1.swap(q2);
    p1.swap(p2);
    std::swap(at1_, at2_);
    C1_.swap(C2_);
}

void MidpointStep::evaluate(double dt) {
    for (int i = 0; i < nq_; ++i) {
        q_mid_[i] = 0.5 * (q1[i] + q2[i]);
        v_[i] = (q2[i] - q1[i]) / dt;
    }
    lagrangian_.gradient(q_mid_.data(), v_.data());
    std::fill(f_.begin(), f_.end(), 0.0);
    for (const auto& force : mechanism_->forces) force->add_force(q_mid_.data(), v_.data(), u.data(), f_.data());
    place(mechanism_->joints, mechanism_->free_constraint_joints, q2.data(), at2_);
    constraint_gradients(at2_, q2.data(), C2_.data());

    const double km = kappa_minus(dt), kp = kappa_plus(dt);
    double size = 0;
    for (int i = 0; i < nd_; ++i) {
        const double half_slope = 0.5 * dt * lagrangian_.L_q[i], momentum = lagrangian_.L_v[i];
        residual[i] = p1[i] + half_slope - momentum + km * f_[i];
        p2[i] = half_slope + momentum + kp * f_[i];
        size = std::max({size, std::abs(p1[i]), std::abs(half_slope), std::abs(momentum), std::abs(km * f_[i])});
    }
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

bool MidpointStep::refresh(double dt, bool in_tree) {
    if (!forces_couple_ && !mechanism_->forces.empty()) {
        std::fill(diagonal_q_.begin(), diagonal_q_.end(), 0.0);
        std::fill(diagonal_v_.begin(), diagonal_v_.end(), 0.0);
        for (const auto& force : mechanism_->forces)
            force->add_diagonals(q_mid_.data(), v_.data(), u.data(), diagonal_q_.data(), diagonal_v_.data());
        const double km = kappa_minus(dt);
        for (int i = 0; i < nd_; ++i) diagonal_[i] = km * (0.5 * diagonal_q_[i] + diagonal_v_[i] / dt);
    }
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
    for (int joint = 0; joint < mechanism_->n_massive; ++joint) {
        const int i = mechanism_->joints[joint].variable;
        if (i >= nd_) continue;
        const JointVectors at = lagrangian_.vectors(joint);
        note_inertia(i, std::inner_product(at.S, at.S + 6, at.AB, 0.0));
    }
    return tree_->factor(lagrangian_, dt, diagonal_.data()) && newton_.factor(*tree_, C1_.data(), C2_.data(), nq_);
}

bool MidpointStep::factor_dense(double dt) {
    lagrangian_.hessian();
    newton_.clear();
    const PairDerivatives& d = lagrangian_.pairs;
    for (int joint = 0; joint < mechanism_->n_massive; ++joint) {
        const int i = mechanism_->joints[joint].variable;
        if (i >= nd_) continue;
        for (const int ancestor : mechanism_->path[joint]) {
            const int j = mechanism_->joints[ancestor].variable;
            if (j >= nd_) continue;
            const std::size_t at = joint * d.stride + ancestor;
            const double even = 0.25 * dt * d.qq[at] - d.vv[at] / dt, odd = 0.5 * (d.q_v[at] - d.v_q[at]);
            newton_.M[i * newton_.stride + j] = even + odd;
            if (i == j) note_inertia(i, d.vv[at]);
            if (i != j) newton_.M[j * newton_.stride + i] = even - odd;
        }
    }
    if (forces_couple_) {
        force_jacobians();
        const double km = kappa_minus(dt);
        for (int i = 0; i < nd_; ++i)
            for (int j = 0; j < nd_; ++j)
                newton_.M[i * newton_.stride + j] += km * (0.5 * f_q_[i * nq_ + j] + f_v_[i * nq_ + j] / dt);
    } else {
        for (int i = 0; i < nd_; ++i) newton_.M[i * newton_.stride + i] += diagonal_[i];
    }
    return newton_.factor(C1_.data(), C2_.data(), nq_);
}

void MidpointStep::force_jacobians() {
    f_q_.assign(static_cast<std::size_t>(nd_) * nq_, 0.0);
    f_v_.assign(static_cast<std::size_t>(nd_) * nq_, 0.0);
    f_u_.assign(static_cast<std::size_t>(nd_) * nu_, 0.0);
    for (const auto& force : mechanism_->forces)
        force->add_jacobians(q_mid_.data(), v_.data(), u.data(), f_q_.data(), f_v_.data(), f_u_.data());
}

// Whether a new Newton matrix is cheaper than going on with the old one. Within a step the contraction decides. At its
// start: an old matrix gains a factor `old_rate_` an iteration, a new one is done in two, at the price of `fresh_price`
// iterations. Each refresh makes the estimate a little more hopeful, so that the old matrix is tried again.
bool MidpointStep::wants_refresh(const StepReport& report, double merit, double previous) {
    if (report.iterations == 1 && report.factorizations == 0) old_rate_ = std::min(merit / previous, 0.5);
    if (report.factorizations > 0) return merit > slow_contraction * previous;
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
    place(mechanism_->joints, mechanism_->prescribed_constraint_joints, q2.data(), at2_);
    for (;; ++report.iterations) {
        evaluate(dt);
        report.residual = largest_residual(residual_scale);
        if (report.residual <= settings_.tolerance) break;
        if (report.iterations == 0) first_scale_ = residual_scale;
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
            continue;
        }
        fresh = !have_factors_ || wants_refresh(report, merit, previous);
        if (fresh) {
            ++report.factorizations;
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
        double moved = 0;
        for (int i = 0; i < nd_; ++i) {
            q2[i] += correction_[i];
            moved = std::max(moved, std::abs(correction_[i]) / (1.0 + std::abs(q2[i])));
        }
        factored_at_solution_ = fresh && !in_tree_ && moved < same_point;
        for (int c = 0; c < nc_; ++c) lam[c] += correction_[nd_ + c];
        if (known && factored_at_solution_) break;
    }
    report.rank_deficient = newton_.rank_deficient();
    return report;
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
    for (int joint = 0; joint < mechanism_->n_massive; ++joint) {
        const int i = mechanism_->joints[joint].variable;
        for (const int ancestor : mechanism_->path[joint]) {
            const int j = mechanism_->joints[ancestor].variable;
            const std::size_t at = joint * d.stride + ancestor;
            const double qq = 0.25 * dt * d.qq[at], vv = d.vv[at] / dt;
            const double sum = 0.5 * (d.q_v[at] + d.v_q[at]), odd = 0.5 * (d.q_v[at] - d.v_q[at]);
            if (i < nd_) add(i, j, qq - sum + vv, qq - vv + odd, qq - vv - odd, qq + sum + vv);
            if (j < nd_ && i != j) add(j, i, qq - sum + vv, qq - vv - odd, qq - vv + odd, qq + sum + vv);
        }
    }
    for (int i = 0; i < nd_; ++i) Y[i * ld + at_p + i] = -1.0;
    if (!mechanism_->forces.empty()) {
        force_jacobians();
        for (int i = 0; i < nd_; ++i) {
            for (int j = 0; j < nq_; ++j) {
                const double f_q = 0.5 * f_q_[i * nq_ + j], f_v = f_v_[i * nq_ + j] / dt;
                add(i, j, km * (f_q - f_v), km * (f_q + f_v), kp * (f_q - f_v), kp * (f_q + f_v));
            }
            for (int a = 0; a < nu_; ++a) {
                Y[i * ld + at_u + a] = -km * f_u_[i * nu_ + a];
                P2[i * ld + at_u + a] = kp * f_u_[i * nu_ + a];
            }
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

// With the multipliers mu of the step's equations, mu = -F_y^-T (w_y + G_y' w_p), which are the derivatives of the
// weighted sum by p1 and by a shift of h, the Hessian is [Y; I]' W [Y; I], W the Hessian of mu.F + w_p.G by (y, th).
// The Lagrangian's part of mu.F + w_p.G is the derivative of L along dq = dt/2 (mu + w_p), dv = w_p - mu, so W
// comes from one dual sweep; of the constraints, -mu.Dh(q1)'lam is a derivative of h along mu.
void MidpointStep::curvature(double dt, const double* w_q, const double* w_p, const double* w_lam,
                             const std::vector<Run>& runs, double* out, int ld_out) {
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
    const PairDerivatives& d = dual_.pairs;
    for (int joint = 0; joint < mechanism_->n_massive; ++joint) {
        const int i = mechanism_->joints[joint].variable;
        for (const int ancestor : mechanism_->path[joint]) {
            const int j = mechanism_->joints[ancestor].variable;
            const std::size_t at = joint * d.stride + ancestor;
            const double qq = 0.25 * d.qq[at], vv = d.vv[at] / (dt * dt);
            const double sum = 0.5 * (d.q_v[at] + d.v_q[at]) / dt, odd = 0.5 * (d.q_v[at] - d.v_q[at]) / dt;
            W_thth_(std::min(i, j), std::max(i, j)) += qq - sum + vv;
            add_22(i, j, qq + sum + vv);
            add_12(i, j, qq - vv + odd);
            if (i != j) {
                add_22(j, i, qq + sum + vv);
                add_12(j, i, qq - vv - odd);
            }
        }
    }
    place(mechanism_->joints, mechanism_->constraint_joints, dual_q1_.data(), dual_at1_);
    place(mechanism_->joints, mechanism_->constraint_joints, q2.data(), at2_);
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

}  // namespace leastaction
