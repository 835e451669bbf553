// The recursion of small linear-quadratic problems (linear_quadratic.hpp), whose rows fit into a few registers.
//
// Looking for sparse rows would take longer than to multiply by zeros, so this is the formula as it stands. Each row
// of [dx; du] stands in an array of a fixed width, with zeros behind:
//
//   row i of P G    = P_i1 G_1 + P_i2 G_2 + ...        row r of H = its cost + G_1r (PG)_1 + G_2r (PG)_2 + ...
//   V_u             = (H_u - V_1u V_1 - ...) / L_uu    row r of P = H_r - V_1r V_1 - V_2r V_2 - ...
//
// where V are the rows of L^-1 [H_ux H_uu], so that column u of them is L. Of H and P the lower triangle is read, which
// makes P symmetric to the last bit; only rows H_u are whole.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <vector>

#include "optimal/linear_quadratic.hpp"
#include "optimal/small_dynamics.hpp"

namespace leastaction {

template <int width>
class SmallRecursion {
public:
    using Index = Eigen::Index;

    // `pivot_tolerance`: of the square of a pivot of H_uu, relative to its diagonal entry.
    SmallRecursion(const LinearQuadraticProblem& problem, const LinearQuadraticOutput& output, double pivot_tolerance)
        : problem_(problem),
          output_(output),
          nx_(problem.nx),
          nu_(problem.nu),
          n_(nx_ + nu_),
          pivot_tolerance_(pivot_tolerance),
          dynamics_(problem) {
        for (auto* rows : {&PG_, &H_, &P_, &V_, &K_}) rows->fill(Row::Zero());
        list_used();
    }

    // Returns the report; `H_uu` (nu x nu, lower triangle) is set to that of an indefinite stage.
    LinearQuadraticReport run(Eigen::MatrixXd& H_uu) {
        using Status = LinearQuadraticReport::Status;
        LinearQuadraticReport report;
        const auto ended = [&](Status status, Index k) {
            report.status = status;
            report.stage = k;
            return report;
        };
        start();
        for (Index k = problem_.horizon - 1; k >= 0; --k) {
            add_cost(k);
            propagate(k, dynamics_.read(k));
            if (!factorize()) {
                H_uu.resize(nu_, nu_);
                for (Index u = 0; u < nu_; ++u) H_uu.row(u) = H_[nx_ + u].segment(nx_, nu_).transpose();
                const bool finite = H_uu.triangularView<Eigen::Lower>().toDenseMatrix().allFinite();
                return ended(finite ? Status::indefinite : Status::not_finite, k);
            }
            eliminate_input();
            if (!std::isfinite(sum())) return ended(Status::not_finite, k);
            store(k);
        }
        store_P(output_.P0);
        report.constant = constant_;
        return report;
    }

private:
    using Row = typename SmallDynamics<width>::Row;
    using Rows = typename SmallDynamics<width>::Rows;

    // The inputs and those states that the pattern has entries of: no others are read of H.
    void list_used() {
        for (Index j = 0; j < n_; ++j) {
            bool used = j >= nx_ || problem_.pattern == nullptr;
            for (Index i = 0; i < nx_ && !used; ++i) used = problem_.pattern[i * n_ + j];
            if (used) used_.push_back(j);
        }
    }

    void start() {
        b_.setZero();
        if (problem_.q_final != nullptr) std::copy_n(problem_.q_final, nx_, b_.data());
        if (const double* Q = problem_.Q_final.data) {
            for (Index i = 0; i < nx_; ++i) {
                if (problem_.Q_final.diagonal) {
                    P_[i][i] = Q[i];
                } else {
                    for (Index j = 0; j <= i; ++j) P_[i][j] = Q[j * nx_ + i];
                }
            }
        }
        store_value(problem_.horizon);
    }

    // The stage's own cost, as H and h.
    void add_cost(Index k) {
        for (Index r = 0; r < n_; ++r) H_[r].setZero();
        if (problem_.H != nullptr) add_hessian(k);
        add_block(problem_.Q, k, 0, nx_);
        add_block(problem_.R, k, nx_, nu_);
        if (const double* S = problem_.S.at(k)) {
            for (Index i = 0; i < nx_; ++i) {
                for (Index u = 0; u < nu_; ++u) H_[nx_ + u][i] += S[i * nu_ + u];
            }
        }
        const HessianPart& part = problem_.part;
        const double* row = part.data + k * part.size * part.size;
        for (Index j = 0; j < part.size; ++j, row += part.size) {
            for (Index i = 0; i <= j; ++i) H_[part.columns[j]][part.columns[i]] += row[i];
        }
        h_.setZero();
        if (problem_.q != nullptr) std::copy_n(problem_.q + k * nx_, nx_, h_.data());
        if (problem_.r != nullptr) std::copy_n(problem_.r + k * nu_, nu_, h_.data() + nx_);
    }

    void add_hessian(Index k) {
        const auto m = static_cast<Index>(used_.size());
        const double* H = problem_.H + k * (problem_.packed ? m * (m + 1) / 2 : n_ * n_);
        for (Index a = 0; a < m; ++a) {
            Row& row = H_[used_[a]];
            const double* from = problem_.packed ? H + a * (a + 1) / 2 : H + used_[a] * n_;
            for (Index b = 0; b <= a; ++b) row[used_[b]] = problem_.H_scale * from[problem_.packed ? b : used_[b]];
        }
    }

    // Of a matrix the upper triangle is read.
    void add_block(const HessianBlock& block, Index k, Index first, Index size) {
        const double* data = block.at(k);
        if (data == nullptr) return;
        for (Index i = 0; i < size; ++i) {
            Row& row = H_[first + i];
            if (block.diagonal) {
                row[first + i] += data[i];
            } else {
                for (Index j = 0; j <= i; ++j) row[first + j] += data[j * size + i];
            }
        }
    }

    double P(Index i, Index j) const { return i < j ? P_[j][i] : P_[i][j]; }

    // H and h from those of the stage, and P, b of the next one.
    void propagate(Index k, const Rows& G) {
        for (Index i = 0; i < nx_; ++i) {
            Row sum = P(i, 0) * G[0];
            for (Index j = 1; j < nx_; ++j) sum += P(i, j) * G[j];
            PG_[i] = sum;
        }
        for (Index r = 0; r < n_; ++r) {
            Row sum = H_[r];
            for (Index i = 0; i < nx_; ++i) sum += G[i][r] * PG_[i];
            H_[r] = sum;
        }
        if (problem_.c != nullptr) close_gaps(problem_.c + k * nx_);
        for (Index i = 0; i < nx_; ++i) h_ += b_[i] * G[i];
    }

    // b becomes b + P c.
    void close_gaps(const double* c) {
        Row shifted = b_;
        for (Index i = 0; i < nx_; ++i) {
            for (Index j = 0; j < nx_; ++j) shifted[i] += P(i, j) * c[j];
        }
        for (Index i = 0; i < nx_; ++i) constant_ += 0.5 * c[i] * (b_[i] + shifted[i]);
        b_ = shifted;
    }

    // V; false if H_uu is not positive definite, or not by much.
    bool factorize() {
        for (Index u = 0; u < nu_; ++u) {
            const Index at = nx_ + u;
            for (Index j = at + 1; j < n_; ++j) H_[at][j] = H_[j][at];
            Row row = H_[at];
            for (Index w = 0; w < u; ++w) row -= V_[w][at] * V_[w];
            // Each against its own entry: inputs may be of any units. Written so that a NaN fails too.
            if (!(row[at] > 0.0 && row[at] > pivot_tolerance_ * H_[at][at])) return false;
            V_[u] = row * (1.0 / std::sqrt(row[at]));
        }
        return true;
    }

    // K, C, P, b of the stage.
    void eliminate_input() {
        for (Index u = 0; u < nu_; ++u) {
            double w = h_[nx_ + u];
            for (Index v = 0; v < u; ++v) w -= V_[v][nx_ + u] * w_[v];
            w_[u] = w / V_[u][nx_ + u];
            constant_ -= 0.5 * w_[u] * w_[u];
        }
        for (Index r = 0; r < nx_; ++r) {
            Row row = H_[r];
            for (Index u = 0; u < nu_; ++u) row -= V_[u][r] * V_[u];
            P_[r] = row;
        }
        b_ = h_;
        for (Index u = 0; u < nu_; ++u) b_ -= w_[u] * V_[u];
        for (Index u = nu_ - 1; u >= 0; --u) {
            Row row = V_[u];
            double w = w_[u];
            for (Index v = u + 1; v < nu_; ++v) {
                row -= V_[u][nx_ + v] * K_[v];
                w -= V_[u][nx_ + v] * w_[v];
            }
            const double inverse = 1.0 / V_[u][nx_ + u];
            K_[u] = row * inverse;
            w_[u] = w * inverse;
        }
    }

    // Of all that was computed.
    double sum() const {
        double total = 0.0;
        for (Index r = 0; r < nx_; ++r) total += P_[r].head(r + 1).sum() + b_[r];
        for (Index u = 0; u < nu_; ++u) total += K_[u].head(nx_).sum() + w_[u];
        return total;
    }

    void store(Index k) {
        for (Index u = 0; u < nu_; ++u) std::copy_n(K_[u].data(), nx_, output_.K + (k * nu_ + u) * nx_);
        std::copy_n(w_.data(), nu_, output_.C + k * nu_);
        if (output_.L_all != nullptr) store_L(output_.L_all + k * nu_ * nu_);
        store_value(k);
    }

    void store_value(Index k) const {
        std::copy_n(b_.data(), nx_, output_.b + k * nx_);
        if (output_.P_all != nullptr) store_P(output_.P_all + k * nx_ * nx_);
    }

    void store_L(double* out) const {
        for (Index u = 0; u < nu_; ++u) {
            for (Index v = 0; v < nu_; ++v) out[u * nu_ + v] = v <= u ? V_[v][nx_ + u] : 0.0;
        }
    }

    void store_P(double* out) const {
        for (Index i = 0; i < nx_; ++i) {
            for (Index j = 0; j < nx_; ++j) out[i * nx_ + j] = P(i, j);
        }
    }

    const LinearQuadraticProblem& problem_;
    const LinearQuadraticOutput& output_;
    Index nx_, nu_, n_;
    double pivot_tolerance_;
    double constant_ = 0.0;
    SmallDynamics<width> dynamics_;
    std::vector<Index> used_;
    Rows PG_, H_, P_, V_, K_;
    Row b_, h_, w_;
};

}  // namespace leastaction
