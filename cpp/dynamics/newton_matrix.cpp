#include "dynamics/newton_matrix.hpp"

#include <algorithm>
#include <cmath>

namespace leastaction {

namespace {

// Pivots of the Schur complement below this part of the largest one mean redundant constraints.
constexpr double rank_tolerance = 1e-11;

using Wide = Eigen::Array<double, NewtonMatrix::lanes, 1>;

// a -= factor b over whole lanes: n is rounded up to a multiple of eight, rows are padded for it.
inline void subtract_multiple(double* a, double factor, const double* b, int n) {
    for (int i = 0; i < n; i += NewtonMatrix::lanes) Eigen::Map<Wide>(a + i) -= factor * Eigen::Map<const Wide>(b + i);
}

// x -= tau v (v.x) with v = [1; tail]: a reflection of Householder's.
template <class Part, class Tail>
void reflect(Part&& x, double tau, const Tail& tail) {
    auto rest = x.tail(tail.size());
    const double along = tau * (x[0] + tail.dot(rest));
    x[0] -= along;
    rest -= along * tail;
}

}  // namespace

void LeastNorm::solve(const double* b, double* x) {
    using Eigen::Index, Eigen::VectorXd;
    const auto& QTZ = decomposition_.matrixQTZ();
    const Index rows = QTZ.rows(), cols = QTZ.cols(), rank = decomposition_.rank();
    b_ = Eigen::Map<const VectorXd>(b, rows);
    y_.setZero(cols);
    for (Index k = 0; k < rank; ++k)
        reflect(b_.tail(rows - k), decomposition_.hCoeffs()[k], QTZ.col(k).tail(rows - k - 1));
    y_.head(rank) = b_.head(rank);
    QTZ.topLeftCorner(rank, rank).triangularView<Eigen::Upper>().solveInPlace(y_.head(rank));
    for (Index k = 0; k < rank && rank < cols; ++k) {
        std::swap(y_[k], y_[rank - 1]);
        reflect(y_.tail(cols - rank + 1), decomposition_.zCoeffs()[k], QTZ.row(k).tail(cols - rank).transpose());
        std::swap(y_[k], y_[rank - 1]);
    }
    for (Index i = 0; i < cols; ++i) x[decomposition_.colsPermutation().indices()[i]] = y_[i];
}

NewtonMatrix::NewtonMatrix(const Mechanism& mechanism)
    : stride(whole_lanes(mechanism.n_dynamic) + lanes),
      coupled_(mechanism.coupled),
      n_(mechanism.n_dynamic),
      nc_(mechanism.n_constraints()),
      nc_padded_(whole_lanes(nc_)),
      reciprocal_(n_),
      pivots_(nc_),
      padded_(n_ + lanes),
      column_(nc_) {
    independent_.reserve(nc_);
}

void NewtonMatrix::clear() {
    L_t_.resize(static_cast<std::size_t>(n_) * stride);
    M.assign(L_t_.size(), 0.0);
}

bool NewtonMatrix::factor(const double* C1, const double* C2, int ld) {
    tree_ = nullptr;
    loops_ = nullptr;
    return eliminate() && factor_schur(C1, C2, ld);
}

bool NewtonMatrix::factor(TreeNewton& tree, const double* C1, const double* C2, int ld) {
    tree_ = &tree;
    loops_ = nullptr;
    tree.copy_reciprocals(reciprocal_.data());
    return factor_schur(C1, C2, ld);
}

void NewtonMatrix::take(const TreeNewton& tree, LoopNewton& loops) {
    loops_ = &loops;
    tree.copy_reciprocals(reciprocal_.data());
    rank_deficient_ = false;
    // S of C1 = C2 and a definite -M is negative definite.
    const auto positive = std::ranges::count_if(reciprocal_, [](double x) { return x > 0; });
    const int sign_of_M = (n_ - positive) % 2 == 0 ? 1 : -1;
    schur_keeps_sign_ = loops.sign() * sign_of_M == (nc_ % 2 == 0 ? 1 : -1);
}

bool NewtonMatrix::eliminate() {
    for (int k = n_ - 1; k >= 0; --k) {
        double* row = &M[static_cast<std::size_t>(k) * stride];
        const double pivot = row[k];
        if (!(std::abs(pivot) > 0.0) || !std::isfinite(pivot)) return false;
        reciprocal_[k] = 1.0 / pivot;
        const auto coupled = coupled_[k];
        if (coupled.empty()) continue;
        // Zero entries between the coupled ones cost less than jumping over them.
        const int first = coupled.front(), width = coupled.back() + 1 - first;
        for (const int i : coupled) {
            double* target = &M[static_cast<std::size_t>(i) * stride];
            const double l = target[k] * reciprocal_[k];
            L_t_[static_cast<std::size_t>(k) * stride + i] = l;
            subtract_multiple(target + first, l, row + first, width);
        }
    }
    return true;
}

bool NewtonMatrix::factor_schur(const double* C1, const double* C2, int ld) {
    rank_deficient_ = false;
    if (nc_ == 0) return true;

    if (schur_.rows() == 0) {
        M_inv_C1t_ = Matrix::Zero(n_, nc_padded_);
        C2_.resize(nc_, n_);
        schur_.resize(nc_, nc_padded_ + lanes);
        unfactored_.resize(nc_, nc_);
        reduced_.resize(nc_, nc_);
    }
    for (int c = 0; c < nc_; ++c)
        for (int i = 0; i < n_; ++i) {
            M_inv_C1t_(i, c) = C1[c * ld + i];
            C2_(c, i) = C2[c * ld + i];
        }
    solve_M(M_inv_C1t_.data(), nc_, nc_padded_);
    schur_.leftCols(nc_).noalias() = C2_.lazyProduct(M_inv_C1t_.leftCols(nc_));
    unfactored_ = schur_.leftCols(nc_);
    double largest = 0, smallest = INFINITY;
    schur_keeps_sign_ = true;  // of no constraints
    for (int k = 0; k < nc_; ++k) {
        int best = k;
        for (int i = k + 1; i < nc_; ++i)
            if (std::abs(schur_(i, k)) > std::abs(schur_(best, k))) best = i;
        pivots_[k] = best;
        if (best != k) schur_.row(k).swap(schur_.row(best));
        if ((best != k) != (schur_(k, k) > 0)) schur_keeps_sign_ = !schur_keeps_sign_;
        const double pivot = std::abs(schur_(k, k));
        if (!std::isfinite(pivot)) return false;
        largest = std::max(largest, pivot);
        smallest = std::min(smallest, pivot);
        if (pivot == 0) break;
        for (int i = k + 1; i < nc_; ++i) {
            schur_(i, k) /= schur_(k, k);
            subtract_multiple(&schur_(i, k) + 1, schur_(i, k), &schur_(k, k) + 1, nc_ - k - 1);
        }
    }
    if (smallest <= rank_tolerance * largest) {
        rank_deficient_ = true;
        schur_least_norm_.compute(unfactored_, rank_tolerance);
    }
    return true;
}

void NewtonMatrix::choose_independent() {
    // C1 = C2: the Schur complement is symmetric and definite but for redundancy, and pivots stand on its diagonal.
    independent_.clear();
    if (loops_) {
        for (int c = 0; c < nc_; ++c) independent_.push_back(c);
        return;
    }
    reduced_ = unfactored_;
    double largest = 0;
    for (int k = 0; k < nc_; ++k) {
        int best = -1;
        for (int i = 0; i < nc_; ++i) {
            const bool taken = std::find(independent_.begin(), independent_.end(), i) != independent_.end();
            if (!taken && (best < 0 || std::abs(reduced_(i, i)) > std::abs(reduced_(best, best)))) best = i;
        }
        const double pivot = reduced_(best, best);
        largest = std::max(largest, std::abs(pivot));
        if (!(std::abs(pivot) > 10.0 * rank_tolerance * largest)) break;
        independent_.push_back(best);
        for (int i = 0; i < nc_; ++i) {
            if (std::find(independent_.begin(), independent_.end(), i) != independent_.end()) continue;
            const double l = reduced_(i, best) / pivot;
            for (int j = 0; j < nc_; ++j) reduced_(i, j) -= l * reduced_(best, j);
        }
    }
}

NewtonMatrix::Determinant NewtonMatrix::determinant() {
    Determinant out;
    const auto take = [&out](double factor) {
        out.log2 += std::log2(std::abs(factor));
        if (factor < 0) out.sign = -out.sign;
    };
    for (const double reciprocal : reciprocal_) take(1.0 / reciprocal);
    out.sign_of_M = out.sign;
    if (loops_) return {loops_->log2_determinant(), loops_->sign(), out.sign_of_M};
    const int n = static_cast<int>(independent_.size());
    for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j) reduced_(i, j) = unfactored_(independent_[i], independent_[j]);
    for (int k = 0; k < n; ++k) {
        int best = k;
        for (int i = k + 1; i < n; ++i)
            if (std::abs(reduced_(i, k)) > std::abs(reduced_(best, k))) best = i;
        if (best != k) {
            reduced_.row(k).swap(reduced_.row(best));
            out.sign = -out.sign;
        }
        const double pivot = reduced_(k, k);
        take(pivot);
        if (pivot == 0) return out;
        for (int i = k + 1; i < n; ++i) {
            const double l = reduced_(i, k) / pivot;
            for (int j = k + 1; j < n; ++j) reduced_(i, j) -= l * reduced_(k, j);
        }
    }
    return out;
}

void NewtonMatrix::take_least_norm(const double* C1, int ld, double* lam) {
    Eigen::Map<const Matrix, 0, Eigen::OuterStride<>> rows(C1, nc_, n_, Eigen::OuterStride<>(ld));
    // The Schur complement is quadratic in the constraints, so its threshold is too.
    C1t_least_norm_.compute(rows.transpose(), std::sqrt(rank_tolerance));
    C1t_lam_.noalias() = rows.transpose() * Eigen::Map<const Eigen::VectorXd>(lam, nc_);
    C1t_least_norm_.solve(C1t_lam_.data(), lam);
}

template <int wides>
void NewtonMatrix::solve_panel(double* b, int ld) const {
    const auto part = [&](int row, int w) { return Eigen::Map<Wide>(b + row * ld + w * lanes); };
    for (int k = n_ - 1; k >= 0; --k) {
        Wide row[wides];
        for (int w = 0; w < wides; ++w) row[w] = part(k, w);
        const double* l = &L_t_[static_cast<std::size_t>(k) * stride];
        for (const int i : coupled_[k])
            for (int w = 0; w < wides; ++w) part(i, w) -= l[i] * row[w];
    }
    for (int k = 0; k < n_; ++k) {
        WideRow<wides> row(b + k * ld);
        const double* u = &M[static_cast<std::size_t>(k) * stride];
        for (const int j : coupled_[k]) row.subtract_multiple(u[j], b + j * ld);
        row.scale(reciprocal_[k]);
        row.put(b + k * ld);
    }
}

void NewtonMatrix::solve_M(double* b, int cols, int ld) const {
    if (tree_) return tree_->solve(b, cols, ld);
    each_panel(cols, [&](auto wides, int first) { solve_panel<wides()>(b + first, ld); });
}

void NewtonMatrix::solve_M(double* b) const {
    if (tree_) return tree_->solve(b);
    for (int k = n_ - 1; k >= 0; --k) {
        if (coupled_[k].empty()) continue;
        const int first = coupled_[k].front(), width = coupled_[k].back() + 1 - first;
        subtract_multiple(b + first, b[k], &L_t_[static_cast<std::size_t>(k) * stride + first], width);
    }
    for (int k = 0; k < n_; ++k) {
        if (!coupled_[k].empty()) {
            const int first = coupled_[k].front(), width = coupled_[k].back() + 1 - first;
            b[k] -= Eigen::Map<const Eigen::VectorXd>(&M[static_cast<std::size_t>(k) * stride + first], width)
                        .dot(Eigen::Map<const Eigen::VectorXd>(b + first, width));
        }
        b[k] *= reciprocal_[k];
    }
}

void NewtonMatrix::solve(double* f, double* g) {
    if (loops_) return loops_->solve(f, g);
    // Whole lanes run past the end of a column: never in the caller's memory.
    std::copy(f, f + n_, padded_.begin());
    solve_M(padded_.data());
    std::copy(padded_.begin(), padded_.begin() + n_, f);
    if (nc_ == 0) return;
    const Eigen::Map<const Eigen::VectorXd> y(f, n_), l(g, nc_);
    for (int c = 0; c < nc_; ++c) g[c] -= C2_.row(c).dot(y);
    solve_schur(g);
    for (int i = 0; i < n_; ++i) f[i] += M_inv_C1t_.row(i).head(nc_).dot(l);
}

void NewtonMatrix::solve(double* f, double* g, int cols, int ld) {
    solve_M(f, cols, ld);
    if (nc_ == 0) return;
    // l = S^-1 (g - C2 M^-1 f),  y = M^-1 f + (M^-1 C1') l
    multiply_rows<Into::subtract>(C2_, n_, f, g, cols, ld);
    solve_schur(g, cols, ld);
    multiply_rows<Into::add>(M_inv_C1t_, nc_, g, f, cols, ld);
}

void NewtonMatrix::solve_schur(double* g) {
    if (rank_deficient_) {
        schur_least_norm_.solve(g, g);
        return;
    }
    for (int k = 0; k < nc_; ++k) std::swap(g[k], g[pivots_[k]]);
    for (int k = 0; k < nc_; ++k)
        for (int i = k + 1; i < nc_; ++i) g[i] -= schur_(i, k) * g[k];
    for (int k = nc_ - 1; k >= 0; --k) {
        for (int i = k + 1; i < nc_; ++i) g[k] -= schur_(k, i) * g[i];
        g[k] /= schur_(k, k);
    }
}

void NewtonMatrix::solve_schur(double* g, int cols, int ld) {
    if (rank_deficient_) {
        for (int col = 0; col < cols; ++col) {
            for (int c = 0; c < nc_; ++c) column_(c) = g[c * ld + col];
            schur_least_norm_.solve(column_.data(), column_.data());
            for (int c = 0; c < nc_; ++c) g[c * ld + col] = column_(c);
        }
    } else {
        for (int k = 0; k < nc_; ++k)
            if (pivots_[k] != k)
                for (int col = 0; col < cols; ++col) std::swap(g[k * ld + col], g[pivots_[k] * ld + col]);
        for (int k = 0; k < nc_; ++k)
            for (int i = k + 1; i < nc_; ++i) subtract_multiple(g + i * ld, schur_(i, k), g + k * ld, cols);
        for (int k = nc_ - 1; k >= 0; --k) {
            for (int i = k + 1; i < nc_; ++i) subtract_multiple(g + k * ld, schur_(k, i), g + i * ld, cols);
            const double r = 1.0 / schur_(k, k);
            for (int col = 0; col < cols; ++col) g[k * ld + col] *= r;
        }
    }
}

}  // namespace leastaction
