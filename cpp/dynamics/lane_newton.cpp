#include "dynamics/lane_newton.hpp"

#include <algorithm>

namespace leastaction {

namespace {

// Pivots of the Schur complement: below this part of the largest on its diagonal a lane is left to who may pivot.
constexpr double small_pivot = 1e-8;

}  // namespace

LaneNewton::LaneNewton(const Mechanism& mechanism)
    : mechanism_(mechanism), n_(mechanism.n_dynamic), nc_(mechanism.n_constraints()) {
    const std::size_t n = n_, nc = nc_;
    for (auto* a : {&M_, &L_}) a->assign(n * n, Lanes{});
    for (auto* a : {&M_inv_C1t_, &C2_}) a->assign(n * nc, Lanes{});
    for (auto* a : {&reciprocal_, &inertia_}) a->assign(n, Lanes{});
    schur_.assign(nc * nc, Lanes{});
    schur_reciprocal_.assign(nc, Lanes{});
    // Pairs by number: the row of a joint, and how far its ancestor is down that row.
    const std::size_t stride = mechanism.n_massive;
    std::vector<int> number(stride * stride, -1);
    each_pair(mechanism, stride, [&](int i, int j, std::size_t at, auto weight, bool mirrored) {
        if (at >= stride * stride) {
            const double inertia = weight * mechanism.numbers[mechanism.rotors[at - stride * stride].inertia];
            rotors_.push_back({i, j, mirrored, inertia});
            return;
        }
        if (number[at] < 0) {
            number[at] = static_cast<int>(pairs_.size());
            pairs_.push_back({static_cast<int>(at / stride), static_cast<int>(at % stride), {}});
        }
        pairs_[number[at]].entries.push_back({i, j, weight * 1.0, mirrored});
    });
    for (int k = 0; k < n_; ++k) {
        pattern_.emplace_back(k, k);
        for (const int i : mechanism.coupled[k]) {
            pattern_.emplace_back(k, i);
            pattern_.emplace_back(i, k);
        }
    }
}

void LaneNewton::assemble(const Lagrangian<Lanes>& lagrangian, double dt, Lanes* root_inertia) {
    for (const auto& [i, j] : pattern_) M(i, j) = Lanes(0.0);
    std::fill(inertia_.begin(), inertia_.end(), Lanes(0.0));
    const double quarter = 0.25 * dt, rate = 1.0 / dt;
    each_entry(lagrangian, [&](int i, int j, double weight, bool mirrored, const Lanes& vv, const Lanes& v_q,
                               const Lanes& q_v, const Lanes& qq) {
        if (i >= n_ || j >= n_) return;
        const Lanes even = weight * (quarter * qq - rate * vv), odd = 0.5 * weight * (q_v - v_q);
        if (mirrored) {
            M(i, j) += even + odd;
            M(j, i) += even - odd;
        } else {
            M(i, j) += even;
            if (i == j) inertia_[i] += weight * vv;
        }
    });
    for (int i = 0; i < n_; ++i) {
        const Lanes root = sqrt(abs(inertia_[i]));
        root_inertia[i] = select(finite(root), root, root_inertia[i]);
    }
}

Lanes::Mask LaneNewton::factor(const Lanes* C1, const Lanes* C2, int ld) {
    Lanes::Mask good = Lanes(0.0) <= Lanes(0.0);
    for (int k = n_ - 1; k >= 0; --k) {
        const Lanes* row = &M_[k * n_];
        good &= finite(row[k]) & (Lanes(0.0) < abs(row[k]));
        const Lanes reciprocal = reciprocal_[k] = 1.0 / row[k];
        const auto coupled = mechanism_.coupled[k];
        for (const int i : coupled) {
            Lanes* target = &M_[i * n_];
            const Lanes l = L_[k * n_ + i] = target[k] * reciprocal;
            for (const int j : coupled) target[j] -= l * row[j];
        }
    }
    for (int c = 0; c < nc_; ++c)
        for (int i = 0; i < n_; ++i) {
            M_inv_C1t_[i * nc_ + c] = C1[c * ld + i];
            C2_[c * n_ + i] = C2[c * ld + i];
        }
    for (int c = 0; c < nc_; ++c) solve_M(&M_inv_C1t_[c], nc_);
    for (int c = 0; c < nc_; ++c)
        for (int d = 0; d < nc_; ++d) {
            Lanes sum(0.0);
            for (int i = 0; i < n_; ++i) sum += C2_[c * n_ + i] * M_inv_C1t_[i * nc_ + d];
            schur_[c * nc_ + d] = sum;
        }
    Lanes largest(0.0);
    for (int c = 0; c < nc_; ++c) largest = max(largest, abs(schur_[c * nc_ + c]));
    for (int k = 0; k < nc_; ++k) {
        Lanes* row = &schur_[k * nc_];
        good &= finite(row[k]) & (row[k] < -small_pivot * largest);  // that of a definite -M is negative
        const Lanes reciprocal = schur_reciprocal_[k] = 1.0 / row[k];
        for (int i = k + 1; i < nc_; ++i) {
            const Lanes l = schur_[i * nc_ + k] *= reciprocal;
            for (int j = k + 1; j < nc_; ++j) schur_[i * nc_ + j] -= l * row[j];
        }
    }
    return good;
}

void LaneNewton::solve_M(Lanes* b, int stride) const {
    for (int k = n_ - 1; k >= 0; --k)
        for (const int i : mechanism_.coupled[k]) b[i * stride] -= L_[k * n_ + i] * b[k * stride];
    for (int k = 0; k < n_; ++k) {
        Lanes sum = b[k * stride];
        for (const int j : mechanism_.coupled[k]) sum -= M_[k * n_ + j] * b[j * stride];
        b[k * stride] = sum * reciprocal_[k];
    }
}

void LaneNewton::solve(Lanes* f, Lanes* g) const {
    solve_M(f, 1);
    for (int c = 0; c < nc_; ++c)
        for (int i = 0; i < n_; ++i) g[c] -= C2_[c * n_ + i] * f[i];
    for (int k = 0; k < nc_; ++k)
        for (int i = k + 1; i < nc_; ++i) g[i] -= schur_[i * nc_ + k] * g[k];
    for (int k = nc_ - 1; k >= 0; --k) {
        for (int i = k + 1; i < nc_; ++i) g[k] -= schur_[k * nc_ + i] * g[i];
        g[k] *= schur_reciprocal_[k];
    }
    for (int i = 0; i < n_; ++i)
        for (int c = 0; c < nc_; ++c) f[i] += M_inv_C1t_[i * nc_ + c] * g[c];
}

}  // namespace leastaction
