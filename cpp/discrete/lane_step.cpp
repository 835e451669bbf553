#include "discrete/lane_step.hpp"

#include <algorithm>
#include <limits>

#include "discrete/root_trust.hpp"

namespace leastaction {

namespace {

constexpr int max_corrections = 8;    // corrections: more of one Newton matrix are no straight way
constexpr double same_point = 1e-12;  // relative move: below this the Newton matrix is that of the solution

}  // namespace

bool LaneStep::suits(const MidpointStep& step) {
    const Mechanism& m = step.mechanism();
    const bool moved = m.time_slot >= 0 && !m.constraints.empty();  // constraints perhaps, by the time
    return step.is_dense() && m.balls.empty() && m.instant_forces.empty() && m.instant_joint_forces.empty() && !moved;
}

LaneStep::LaneStep(const MidpointStep& like)
    : mechanism_(like.mechanism()),
      split_(like.split()),
      tolerance_(like.tolerance()),
      turn_(like.turns()),
      nd_(mechanism_.n_dynamic),
      nq_(mechanism_.n_variables()),
      nc_(mechanism_.n_constraints()),
      lagrangian_(mechanism_),
      newton_(mechanism_),
      at2_(mechanism_) {
    const auto sized = [](std::vector<Lanes>& a, std::size_t n) { a.assign(n, Lanes(0.0)); };
    const std::size_t nd = nd_, nq = nq_, nc = nc_;
    for (auto* a : {&q1, &q2, &q_mid_, &v_, &expected_v_}) sized(*a, nq);
    for (auto* a : {&p1, &p2, &f_, &root_inertia_, &new_root_inertia_, &pivots_, &mobility_}) sized(*a, nd);
    sized(u, mechanism_.n_inputs);
    for (auto* a : {&lam, &h_, &h_scale_}) sized(*a, nc);
    for (auto* a : {&C1_, &C2_}) sized(*a, nc * nq);
    for (auto* a : {&residual_, &correction_}) sized(*a, nd + nc);
}

void LaneStep::constraint_gradients(const Lanes* q, std::vector<Lanes>& C) {
    std::fill(C.begin(), C.end(), Lanes(0.0));
    for (int c = 0; c < nc_; ++c) {
        for_each_entry(*mechanism_.constraints[c], at2_, q, local_,
                       [&](int i, const Lanes& x) { C[c * nq_ + i] += x; });
        h_[c] = local_.value;
        h_scale_[c] = local_.scale;
    }
}

void LaneStep::place_start() {
    place(mechanism_.constraint_joints, q1.data(), at2_);
    constraint_gradients(q1.data(), C1_);
    std::fill(root_inertia_.begin(), root_inertia_.end(), Lanes(0.0));
}

void LaneStep::evaluate(double dt) {
    const Mechanism& m = mechanism_;
    const double rate = 1.0 / dt;
    for (int i = 0; i < nq_; ++i) {
        q_mid_[i] = 0.5 * (q1[i] + q2[i]);
        v_[i] = rate * (q2[i] - q1[i]);
    }
    lagrangian_.at.time = t + 0.5 * dt;
    lagrangian_.gradient(q_mid_.data(), v_.data());
    std::fill(f_.begin(), f_.end(), Lanes(0.0));
    for (const auto& [i, slot] : m.damping) f_[i] -= m.numbers[slot] * v_[i];
    for (const auto& [i, input] : m.joint_forces) f_[i] += u[input];
    Lanes size(0.0);
    if (!m.potentials.empty() || !m.forces.empty()) {
        place(m.massless_joints_seen, q_mid_.data(), lagrangian_.at);
        for_each_entry(m.potentials, lagrangian_.at, q_mid_.data(), local_, [&](int i, const Lanes& slope) {
            lagrangian_.L_q[i] -= slope;
            size = max(size, abs(slope));
        });
        for_each_entry(m.forces, ForcePoint<Lanes>{lagrangian_.at, q_mid_.data(), v_.data(), u.data()}, force_,
                       [&](int i, const Lanes& f) {
                           if (i < nd_) f_[i] += f;
                       });
    }
    place(m.free_constraint_joints, q2.data(), at2_);
    constraint_gradients(q2.data(), C2_);

    const double km = kappa_minus(split_, dt), kp = kappa_plus(split_, dt);
    size = 0.5 * dt * size;
    for (int i = 0; i < nd_; ++i) {
        const Lanes half_slope = 0.5 * dt * lagrangian_.L_q[i], momentum = lagrangian_.L_v[i];
        residual_[i] = p1[i] + half_slope - momentum + km * f_[i];
        p2[i] = half_slope + momentum + kp * f_[i];
        for (const Lanes& term : {p1[i], half_slope, momentum, km * f_[i]}) size = max(size, abs(term));
    }
    for (int c = 0; c < nc_; ++c) {
        const Lanes* row = &C1_[c * nq_];
        for (int i = 0; i < nd_; ++i) {
            const Lanes term = row[i] * lam[c];
            residual_[i] -= term;
            size = max(size, abs(term));
        }
        residual_[nd_ + c] = h_[c];
    }
    Lanes rounding(0.0);
    for (int i = 0; i < nd_; ++i) rounding = max(rounding, root_inertia_[i] * abs(q2[i]));
    rounding *= std::numeric_limits<double>::epsilon() / (tolerance_ * dt);
    largest_ = Lanes(0.0);
    const auto take = [&](const Lanes& residual, const Lanes& scale) {
        const Lanes r = abs(residual), ratio = select(Lanes(0.0) < r, r / scale, Lanes(0.0));
        // What is not a number must not get lost.
        largest_ = select(ratio <= largest_, largest_, ratio);
    };
    for (int i = 0; i < nd_; ++i) take(residual_[i], size + root_inertia_[i] * rounding);
    for (int c = 0; c < nc_; ++c) take(residual_[nd_ + c], h_scale_[c]);
}

Lanes::Mask LaneStep::factor(double dt, const Lanes::Mask& which) {
    const Mechanism& m = mechanism_;
    lagrangian_.composites();
    newton_.assemble(lagrangian_, dt, new_root_inertia_.data());
    for (int i = 0; i < nd_; ++i) {
        const auto kept = which & finite(new_root_inertia_[i]);
        root_inertia_[i] = select(kept, new_root_inertia_[i], root_inertia_[i]);
    }
    const double km = kappa_minus(split_, dt);
    for (const auto& [i, slot] : m.damping) newton_.M(i, i) -= km / dt * m.numbers[slot];
    for_each_entry(m.potentials, lagrangian_.at, q_mid_.data(), local_, [&](int i, int j, const Lanes& bend) {
        if (i < nd_ && j < nd_) newton_.M(i, j) -= 0.25 * dt * bend;
    });
    for_each_entry(
        m.forces, ForcePoint<Lanes>{lagrangian_.at, q_mid_.data(), v_.data(), u.data()}, force_,
        [&](int i, int j, const Lanes& f_q, const Lanes& f_v) {
            if (i < nd_ && j < nd_) newton_.M(i, j) += km * (0.5 * f_q + (1.0 / dt) * f_v);
        },
        [](int, int, const Lanes&) {});
    return which & newton_.factor(C1_.data(), C2_.data(), nq_);
}

void LaneStep::keep_pivots(double dt, const Lanes::Mask& which) {
    for (int i = 0; i < nd_; ++i) {
        pivots_[i] = select(which, dt / newton_.reciprocal_pivots()[i], pivots_[i]);
        const Lanes square = root_inertia_[i] * root_inertia_[i];
        const Lanes mobility = select(Lanes(0.0) < square, 1.0 / square, Lanes(0.0));
        mobility_[i] = select(which, mobility, mobility_[i]);
    }
}

Lanes::Mask LaneStep::guess_limit(double dt) {
    const Mechanism& m = mechanism_;
    const double tau = trust::limit_part * dt;
    expected_v_ = q2;  // the prescribed variables, for later
    std::copy(q1.begin(), q1.begin() + nd_, q2.begin());
    for (int i = nd_; i < nq_; ++i) q2[i] = q1[i] + trust::limit_part * (q2[i] - q1[i]);
    std::fill(lam.begin(), lam.end(), Lanes(0.0));
    place(m.prescribed_constraint_joints, q2.data(), at2_);
    evaluate(tau);
    C2_ = C1_;
    Lanes::Mask good = factor(tau, Lanes(0.0) <= Lanes(0.0));
    for (int i = 0; i < nd_; ++i) correction_[i] = -residual_[i];
    for (int c = 0; c < nc_; ++c) {
        correction_[nd_ + c] = Lanes(0.0);
        for (int i = nd_; i < nq_; ++i) correction_[nd_ + c] -= C1_[c * nq_ + i] * (q2[i] - q1[i]);
    }
    newton_.solve(correction_.data(), correction_.data() + nd_);
    std::copy(expected_v_.begin() + nd_, expected_v_.end(), q2.begin() + nd_);
    std::copy(correction_.begin() + nd_, correction_.end(), lam.begin());
    for (int i = 0; i < nd_; ++i) {
        const Lanes v = (1.0 / tau) * correction_[i];
        good &= finite(v);
        q2[i] = q1[i] + dt * v;
    }
    for (int i = 0; i < nq_; ++i) expected_v_[i] = (1.0 / dt) * (q2[i] - q1[i]);
    keep_pivots(tau, Lanes(0.0) <= Lanes(0.0));
    return good;
}

Lanes::Mask LaneStep::find(double dt, const Lanes::Mask& running) {
    place(mechanism_.prescribed_constraint_joints, q2.data(), at2_);
    evaluate(dt);
    Lanes::Mask found = running & (largest_ <= Lanes(tolerance_)), left = running & ~found, factored = no_lanes;
    if (any(left)) factored = left = factor(dt, left);
    Lanes::Mask contracts = no_lanes;
    for (int corrections = 0; corrections < max_corrections && any(left); ++corrections) {
        for (int i = 0; i < nd_ + nc_; ++i) correction_[i] = -residual_[i];
        newton_.solve(correction_.data(), correction_.data() + nd_);
        for (int i = 0; i < nd_; ++i) q2[i] = select(left, q2[i] + correction_[i], q2[i]);
        for (int c = 0; c < nc_; ++c) lam[c] = select(left, lam[c] + correction_[nd_ + c], lam[c]);
        const Lanes previous = largest_;
        evaluate(dt);
        found |= left & (largest_ <= Lanes(tolerance_));
        left &= ~found;
        // Where it falls no further near rounding, that is reached: behind a fresh matrix, or one that did well before.
        const Lanes floor(trust::rounding_floor);
        const Lanes::Mask near_rounding = (largest_ < floor) | (previous < floor);
        const Lanes::Mask slow = largest_ > trust::slow_contraction * previous;
        const Lanes::Mask falls = largest_ <= trust::no_contraction * previous;
        if (corrections == 0) contracts = left | ~left;
        found |= left & near_rounding & ~falls & contracts;
        left &= ~found & (~slow | (near_rounding & falls));
        contracts = corrections == 0 ? ~slow : contracts | ~slow;
    }
    for (int i = 0; i < nd_; ++i) p2[i] += residual_[i];  // as MidpointStep::solve()
    return found & trusted(dt, factored);
}

Lanes::Mask LaneStep::trusted(double dt, const Lanes::Mask& factored) {
    Lanes turn(0.0), change(0.0);
    for (int i = 0; i < nq_; ++i) {
        const Lanes moved = q2[i] - q1[i];
        turn = max(turn, turn_[i] * abs(moved));
        change = max(change, turn_[i] * abs(moved - dt * expected_v_[i]));
    }
    Lanes::Mask good = (turn <= Lanes(trust::small_turn)) |
                       ((turn <= Lanes(trust::medium_turn)) & (change <= Lanes(trust::turn_change)));
    for (int i = 0; i < nd_; ++i) {
        const Lanes ratio = pivots_[i] * newton_.reciprocal_pivots()[i];
        good &= ~factored | ((ratio * trust::pivot_change >= Lanes(dt)) & (ratio <= Lanes(trust::pivot_change * dt)));
    }
    keep_pivots(dt, factored & good);
    for (int c = 0; c < nc_; ++c) {
        Lanes size(0.0), turned(0.0);
        for (int i = 0; i < nd_; ++i) {
            const Lanes before = C1_[c * nq_ + i], d = C2_[c * nq_ + i] - before;
            size += mobility_[i] * before * before;
            turned += mobility_[i] * d * d;
        }
        good &= turned <= trust::direction_change * trust::direction_change * size;
    }
    return good;
}

Lanes::Mask LaneStep::know(double dt) {
    std::fill(lam.begin(), lam.end(), Lanes(0.0));
    place_start();
    place(mechanism_.prescribed_constraint_joints, q2.data(), at2_);
    evaluate(dt);
    Lanes::Mask good = factor(dt, Lanes(0.0) <= Lanes(0.0));
    for (int i = 0; i < nd_ + nc_; ++i) correction_[i] = -residual_[i];
    newton_.solve(correction_.data(), correction_.data() + nd_);
    for (int i = 0; i < nd_; ++i) good &= abs(correction_[i]) <= same_point * (1.0 + abs(q2[i]));
    std::copy(correction_.begin() + nd_, correction_.end(), lam.begin());
    return good;
}

// As FirstOrder::differentiate() does.
void LaneStep::differentiate(double dt, Lanes* Y, Lanes* P2) {
    const Mechanism& m = mechanism_;
    const int cols = n_theta(), rows = nd_ + nc_, at_u = nq_ + nd_, at_rho2 = at_u + static_cast<int>(u.size());
    const double km = kappa_minus(split_, dt), kp = kappa_plus(split_, dt), rate = 1.0 / dt;
    const ForcePoint<Lanes> middle{lagrangian_.at, q_mid_.data(), v_.data(), u.data()};
    std::fill_n(Y, rows * cols, Lanes(0.0));
    std::fill_n(P2, nd_ * cols, Lanes(0.0));
    G_y_.assign(nd_ * nd_, Lanes(0.0));
    const auto add = [&](int i, int j, const Lanes& d11, const Lanes& d12, const Lanes& d21, const Lanes& d22) {
        Y[j * rows + i] -= d11;
        P2[j * nd_ + i] += d21;
        if (j < nd_) {
            G_y_[i * nd_ + j] += d22;
        } else {
            Y[(at_rho2 + j - nd_) * rows + i] -= d12;
            P2[(at_rho2 + j - nd_) * nd_ + i] += d22;
        }
    };
    newton_.each_entry(lagrangian_, [&](int i, int j, double weight, bool mirrored, const Lanes& vv_, const Lanes& v_q,
                                        const Lanes& q_v, const Lanes& qq_) {
        const Lanes qq = 0.25 * dt * weight * qq_, vv = rate * weight * vv_;
        const Lanes sum = 0.5 * weight * (q_v + v_q), odd = 0.5 * weight * (q_v - v_q);
        if (i < nd_) add(i, j, qq - sum + vv, qq - vv + odd, qq - vv - odd, qq + sum + vv);
        if (j < nd_ && mirrored) add(j, i, qq - sum + vv, qq - vv - odd, qq - vv + odd, qq + sum + vv);
    });
    for (int i = 0; i < nd_; ++i) Y[(nq_ + i) * rows + i] = Lanes(-1.0);
    const auto add_force = [&](int i, int j, const Lanes& by_q, const Lanes& by_v) {
        if (i >= nd_) return;
        const Lanes f_q = 0.5 * by_q, f_v = rate * by_v;
        add(i, j, km * (f_q - f_v), km * (f_q + f_v), kp * (f_q - f_v), kp * (f_q + f_v));
    };
    const auto add_input = [&](int i, int input, const Lanes& f_u) {
        if (i >= nd_) return;
        Y[(at_u + input) * rows + i] -= km * f_u;
        P2[(at_u + input) * nd_ + i] += kp * f_u;
    };
    for (const auto& [i, slot] : m.damping) add_force(i, i, Lanes(0.0), Lanes(-m.numbers[slot]));
    for (const auto& [i, input] : m.joint_forces) add_input(i, input, Lanes(1.0));
    for_each_entry(m.potentials, middle.at, middle.q, local_, [&](int i, int j, const Lanes& bend) {
        const Lanes qq = -0.25 * dt * bend;
        if (i < nd_) add(i, j, qq, qq, qq, qq);
    });
    for_each_entry(m.forces, middle, force_, add_force, add_input);
    if (nc_ > 0) place(m.constraint_joints, q1.data(), at2_);
    for (int c = 0; c < nc_; ++c) {
        for_each_entry(*m.constraints[c], at2_, q1.data(), local_, [&](int i, int j, const Lanes& bend) {
            if (i < nd_) Y[j * rows + i] += lam[c] * bend;
        });
        for (int k = nd_; k < nq_; ++k) Y[(at_rho2 + k - nd_) * rows + nd_ + c] = -C2_[c * nq_ + k];
    }
    // p2 depends on th through q2 as well, by those that a variable is coupled to.
    for (int j = 0; j < cols; ++j) {
        Lanes *y = Y + j * rows, *p2 = P2 + j * nd_;
        newton_.solve(y, y + nd_);
        for (const auto& [i, k] : newton_.pattern()) p2[i] += G_y_[i * nd_ + k] * y[k];
    }
}

void LaneStep::take(int lane, const MidpointStep& found, double dt) {
    for (int i = 0; i < nq_; ++i) {
        q2[i].set(lane, found.q2[i]);
        v_[i].set(lane, (found.q2[i] - q1[i][lane]) / dt);
    }
    for (int i = 0; i < nd_; ++i) {
        p2[i].set(lane, found.p2[i]);
        root_inertia_[i].set(lane, found.root_inertia()[i]);
        pivots_[i].set(lane, found.pivots()[i]);
        mobility_[i].set(lane, found.mobility()[i]);
    }
    for (int c = 0; c < nc_; ++c) lam[c].set(lane, found.lam[c]);
    for (int i = 0; i < nc_ * nq_; ++i) C2_[i].set(lane, found.end_gradients()[i]);
}

void LaneStep::advance() {
    expected_v_ = v_;
    q1.swap(q2);
    p1.swap(p2);
    C1_.swap(C2_);
}

}  // namespace leastaction
