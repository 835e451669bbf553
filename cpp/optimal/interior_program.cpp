#include "optimal/interior_program.hpp"

#include <algorithm>
#include <cmath>

namespace leastaction {

namespace {

constexpr double inside_bound = 0.995;  // part of the way to the nearest bound that a step may go
constexpr double warm_slack = 1e-2;     // part of its scale that a slack has at least, to begin again with
constexpr double dearer = 10.0;         // factor by which the price of an excess rises that is needed
constexpr double binding = 0.5;         // part of its price from which on a multiplier has this rise

// A weight, with room for more on its diagonal at every stage.
HessianBlock own_block(const HessianBlock& given, std::ptrdiff_t stages, std::ptrdiff_t n, std::vector<double>& room) {
    const std::ptrdiff_t size = given.diagonal || given.data == nullptr ? n : n * n;
    room.assign(static_cast<std::size_t>(stages * size), 0.0);
    if (given.data != nullptr)
        for (std::ptrdiff_t k = 0; k < stages; ++k) std::copy_n(given.at(k), size, &room[k * size]);
    return {room.data(), size, size == n};
}

double& on_diagonal(std::vector<double>& room, const HessianBlock& block, std::ptrdiff_t k, std::ptrdiff_t n,
                    std::ptrdiff_t i) {
    return room[k * block.stride + (block.diagonal ? i : i * n + i)];
}

}  // namespace

InteriorProgram::InteriorProgram(Index horizon, Index nx, Index nu, std::vector<Index> stage, std::vector<Index> begin,
                                 std::vector<Index> column)
    : coefficients(column.size()),
      N_(horizon),
      nx_(nx),
      nu_(nu),
      nz_(nx + nu),
      stage_(std::move(stage)),
      begin_(std::move(begin)),
      column_(std::move(column)),
      looks_ahead_(stage_.size(), 0) {
    const std::size_t m = stage_.size();
    for (auto* a :
         {&values, &scales, &s, &e, &y, &rho, &sigma_, &left_, &r_s_, &r_e_, &ds_, &de_, &dy_, &moved_, &kept_moved_})
        a->assign(m, 0.0);
    for (auto* a : {&dx, &dx_, &b_all_}) a->assign((N_ + 1) * nx_, 0.0);
    for (auto* a : {&du, &du_, &C, &r_}) a->assign(N_ * nu_, 0.0);
    K.assign(N_ * nu_ * nx_, 0.0);
    L_.assign(N_ * nu_ * nu_, 0.0);
    P0_.assign(nx_ * nx_, 0.0);
    b_.assign(nz_, 0.0);
    q_.assign(N_ * nx_, 0.0);
    q_final_.assign(nx_, 0.0);
    own_begin_.push_back(0);
    part_place_.assign(nz_, -1);
    for (std::size_t i = 0; i < m; ++i) {
        for (Index at = begin_[i]; at < begin_[i + 1]; ++at) looks_ahead_[i] |= column_[at] >= nz_;
        if (looks_ahead_[i])
            for (Index j = 0; j < nz_; ++j) own_column_.push_back(j);
        else
            own_column_.insert(own_column_.end(), column_.begin() + begin_[i], column_.begin() + begin_[i + 1]);
        own_begin_.push_back(static_cast<Index>(own_column_.size()));
        if (own_begin_[i + 1] - own_begin_[i] > 1)
            for (Index at = own_begin_[i]; at < own_begin_[i + 1]; ++at) part_place_[own_column_[at]] = 0;
    }
    own_.assign(own_column_.size(), 0.0);
    number_part();
}

void InteriorProgram::number_part() {
    part_columns_.clear();
    for (Index j = 0; j < nz_; ++j) {
        if (part_place_[j] < 0) continue;
        part_place_[j] = static_cast<Index>(part_columns_.size());
        part_columns_.push_back(j);
    }
    part_.assign(N_ * part_columns_.size() * part_columns_.size(), 0.0);
}

void InteriorProgram::take_part() {
    const HessianPart& given = given_->part;
    const auto is_new = [&](Index j) { return part_place_[j] < 0; };
    if (std::any_of(given.columns, given.columns + given.size, is_new)) {
        for (Index a = 0; a < given.size; ++a) part_place_[given.columns[a]] = 0;
        number_part();
    }
    const Index width = static_cast<Index>(part_columns_.size());
    std::fill(part_.begin(), part_.end(), 0.0);
    for (Index k = 0; k < N_; ++k)
        for (Index a = 0; a < given.size; ++a)
            for (Index b = 0; b <= a; ++b) {
                const Index i = part_place_[given.columns[a]], j = part_place_[given.columns[b]];
                part_[(k * width + i) * width + j] = given.data[(k * given.size + a) * given.size + b];
            }
}

void InteriorProgram::make_rows() {
    for (Index i = 0; i < rows(); ++i) {
        double* row = &own_[own_begin_[i]];
        if (!looks_ahead_[i]) {
            std::copy(&coefficients[begin_[i]], &coefficients[begin_[i]] + (begin_[i + 1] - begin_[i]), row);
            continue;
        }
        std::fill_n(row, nz_, 0.0);
        const double *A = given_->A + stage_[i] * nx_ * nx_, *B = given_->B + stage_[i] * nx_ * nu_;
        for (Index at = begin_[i]; at < begin_[i + 1]; ++at) {
            const double c = coefficients[at];
            if (column_[at] < nz_) {
                row[column_[at]] += c;
                continue;
            }
            const Index next = column_[at] - nz_;
            for (Index j = 0; j < nx_; ++j) row[j] += c * A[next * nx_ + j];
            for (Index j = 0; j < nu_; ++j) row[nx_ + j] += c * B[next * nu_ + j];
        }
    }
}

void InteriorProgram::begin_anew() {
    for (Index i = 0; i < rows(); ++i) {
        const double c = values[i], scale = scales[i];
        if (!kept) {
            s[i] = std::max(c, 0.1 * scale);
            e[i] = std::max(-c, warm_slack * scale);
            y[i] = 1e-3 * rho[i];
        } else {
            // What was active may be so no more, and the other way round.
            y[i] = std::clamp(y[i], 1e-6 * rho[i], 0.9 * rho[i]);
            s[i] = std::max(std::max(c, s[i]), warm_slack * scale);
            e[i] = std::max(std::max(-c, e[i]), warm_slack * warm_slack * scale);
        }
        left_[i] = rho[i] - y[i];
    }
}

void InteriorProgram::weigh() {
    problem_ = *given_;
    problem_.Q = own_block(given_->Q, N_, nx_, Q_);
    problem_.R = own_block(given_->R, N_, nu_, R_);
    HessianBlock final = own_block(given_->Q_final, 1, nx_, Q_final_);
    take_part();
    const Index width = static_cast<Index>(part_columns_.size());
    if (final.diagonal && width > 0) {  // rows of several entries may be of the last state
        std::vector<double> full(nx_ * nx_, 0.0);
        for (Index i = 0; i < nx_; ++i) full[i * nx_ + i] = Q_final_[i];
        Q_final_.swap(full);
        final = {Q_final_.data(), nx_ * nx_, false};
    }
    for (Index i = 0; i < rows(); ++i) {
        const Index first = own_begin_[i], last = own_begin_[i + 1], k = stage_[i];
        if (k == N_) {
            for (Index a = first; a < last; ++a)
                for (Index b = first; b < last; ++b) {
                    const double value = sigma_[i] * own_[a] * own_[b];
                    if (final.diagonal)
                        Q_final_[own_column_[a]] += value;
                    else
                        Q_final_[own_column_[a] * nx_ + own_column_[b]] += value;
                }
        } else if (last - first == 1) {
            const Index j = own_column_[first];
            const double value = sigma_[i] * own_[first] * own_[first];
            if (j < nx_)
                on_diagonal(Q_, problem_.Q, k, nx_, j) += value;
            else
                on_diagonal(R_, problem_.R, k, nu_, j - nx_) += value;
        } else {
            double* to = &part_[k * width * width];
            for (Index a = first; a < last; ++a) {
                const double weighed = sigma_[i] * own_[a];
                double* row = to + part_place_[own_column_[a]] * width;
                for (Index b = first; b < last; ++b) row[part_place_[own_column_[b]]] += weighed * own_[b];
            }
        }
    }
    problem_.Q_final = {Q_final_.data(), 0, final.diagonal};
    problem_.part = {part_.data(), part_columns_.data(), width};
}

bool InteriorProgram::go_towards(bool fresh) {
    const auto or_zeros = [](const double* from, std::size_t n, std::vector<double>& to) {
        if (from != nullptr)
            std::copy_n(from, n, to.begin());
        else
            std::fill(to.begin(), to.end(), 0.0);
    };
    or_zeros(given_->q, q_.size(), q_);
    or_zeros(given_->r, r_.size(), r_);
    or_zeros(given_->q_final, q_final_.size(), q_final_);
    for (Index i = 0; i < rows(); ++i) {
        const double w = y[i] + sigma_[i] * (s[i] - e[i] - values[i] + r_s_[i] / y[i] - r_e_[i] / left_[i]);
        const Index k = stage_[i];
        for (Index at = own_begin_[i]; at < own_begin_[i + 1]; ++at) {
            const Index j = own_column_[at];
            (k == N_ ? q_final_[j] : j < nx_ ? q_[k * nx_ + j] : r_[k * nu_ + j - nx_]) -= w * own_[at];
        }
    }
    if (fresh) {
        problem_.q = q_.data();
        problem_.r = r_.data();
        problem_.q_final = q_final_.data();
        LinearQuadraticOutput out{K.data(), C.data(), b_all_.data(), P0_.data(), nullptr, L_.data()};
        const LinearQuadraticReport report = solve_linear_quadratic(problem_, {}, out);
        if (report.status != LinearQuadraticReport::Status::solved) return false;
    } else {
        // The recursion for vectors alone: K' h_u is what V w is.
        double* b = b_.data();
        std::copy(q_final_.begin(), q_final_.end(), b);
        std::vector<double>& h = b_all_;
        for (Index k = N_ - 1; k >= 0; --k) {
            const double *A = given_->A + k * nx_ * nx_, *B = given_->B + k * nx_ * nu_, *K_k = &K[k * nu_ * nx_];
            double *h_x = &h[0], *h_u = &C[k * nu_];
            std::copy_n(&q_[k * nx_], nx_, h_x);
            std::copy_n(&r_[k * nu_], nu_, h_u);
            for (Index i = 0; i < nx_; ++i) {
                const double weight = b[i];
                if (weight == 0.0) continue;
                for (Index j = 0; j < nx_; ++j) h_x[j] += A[i * nx_ + j] * weight;
                for (Index j = 0; j < nu_; ++j) h_u[j] += B[i * nu_ + j] * weight;
            }
            for (Index a = 0; a < nu_; ++a)
                for (Index j = 0; j < nx_; ++j) h_x[j] -= K_k[a * nx_ + j] * h_u[a];
            const double* L = &L_[k * nu_ * nu_];
            for (Index a = 0; a < nu_; ++a) {
                for (Index c = 0; c < a; ++c) h_u[a] -= L[a * nu_ + c] * h_u[c];
                h_u[a] /= L[a * nu_ + a];
            }
            for (Index a = nu_ - 1; a >= 0; --a) {
                for (Index c = a + 1; c < nu_; ++c) h_u[a] -= L[c * nu_ + a] * h_u[c];
                h_u[a] /= L[a * nu_ + a];
            }
            std::copy_n(h_x, nx_, b);
        }
    }
    std::fill_n(dx_.begin(), nx_, 0.0);
    sweep_forward(problem_, K.data(), C.data(), dx_.data(), du_.data());
    for (Index i = 0; i < rows(); ++i) {
        double moved = 0;
        const Index k = stage_[i];
        for (Index at = own_begin_[i]; at < own_begin_[i + 1]; ++at) {
            const Index j = own_column_[at];
            moved += own_[at] * (j < nx_ ? dx_[k * nx_ + j] : du_[k * nu_ + j - nx_]);
        }
        moved_[i] = moved;
    }
    return true;
}

void InteriorProgram::changes() {
    for (Index i = 0; i < rows(); ++i) {
        const double dy = sigma_[i] * (s[i] - e[i] - values[i] - moved_[i] + r_s_[i] / y[i] - r_e_[i] / left_[i]);
        dy_[i] = dy;
        ds_[i] = (r_s_[i] - s[i] * dy) / y[i];
        de_[i] = (r_e_[i] + e[i] * dy) / left_[i];
    }
}

double InteriorProgram::longest(double inside) const {
    double rate = 0;  // the largest at which one of them falls, in parts of itself
    for (Index i = 0; i < rows(); ++i)
        rate = std::max({rate, -ds_[i] / s[i], -de_[i] / e[i], -dy_[i] / y[i], dy_[i] / left_[i]});
    return rate <= inside ? 1.0 : inside / rate;
}

double InteriorProgram::gap(double length) const {
    double sum = 0;
    for (Index i = 0; i < rows(); ++i)
        sum += (s[i] + length * ds_[i]) * (y[i] + length * dy_[i]) +
               (e[i] + length * de_[i]) * (left_[i] - length * dy_[i]);
    return sum / (2.0 * static_cast<double>(rows()));
}

double InteriorProgram::fall() const {
    double sum = 0;
    if (given_->q != nullptr)
        for (Index i = 0; i < N_ * nx_; ++i) sum += given_->q[i] * dx[i];
    if (given_->r != nullptr)
        for (Index i = 0; i < N_ * nu_; ++i) sum += given_->r[i] * du[i];
    if (given_->q_final != nullptr)
        for (Index i = 0; i < nx_; ++i) sum += given_->q_final[i] * dx[N_ * nx_ + i];
    return std::abs(sum);
}

InteriorProgram::Report InteriorProgram::solve(const LinearQuadraticProblem& problem, double tolerance,
                                               double magnitude, int most) {
    given_ = &problem;
    Report report;
    make_rows();
    begin_anew();
    if (rows() == 0) {
        weigh();
        if (!go_towards(true)) return report;
        dx = dx_;
        du = du_;
        return {true, 1, true, 0.0};
    }
    const Index m = rows();
    bool begun = false;
    while (report.iterations < most && !report.converged) {
        for (Index i = 0; i < m; ++i) {
            sigma_[i] = 1.0 / (s[i] / y[i] + e[i] / left_[i]);
            r_s_[i] = -s[i] * y[i];
            r_e_[i] = -e[i] * left_[i];
            ds_[i] = de_[i] = dy_[i] = 0.0;
        }
        const double now = gap(0.0);
        weigh();
        if (!go_towards(true)) return report;
        changes();
        const double then = gap(longest(1.0)), mu = now * std::pow(then / now, 3);
        for (Index i = 0; i < m; ++i) {
            r_s_[i] += mu - ds_[i] * dy_[i];
            r_e_[i] += mu + de_[i] * dy_[i];
        }
        go_towards(false);
        changes();
        const double length = longest(inside_bound);
        for (Index i = 0; i < m; ++i) {
            s[i] += length * ds_[i];
            e[i] += length * de_[i];
            y[i] += length * dy_[i];
            left_[i] -= length * dy_[i];
        }
        const auto go = [&](std::vector<double>& from, const std::vector<double>& to) {
            for (std::size_t i = 0; i < from.size(); ++i) {
                const double start = begun ? from[i] : 0.0;
                from[i] = length == 1.0 ? to[i] : start + length * (to[i] - start);
            }
        };
        go(dx, dx_);
        go(du, du_);
        go(kept_moved_, moved_);
        begun = true;
        ++report.iterations;
        double off = 0, products = 0;
        for (Index i = 0; i < m; ++i) {
            off = std::max(off, std::abs(values[i] + kept_moved_[i] - s[i] + e[i]) / scales[i]);
            products += s[i] * y[i] + e[i] * left_[i];
        }
        if (!std::isfinite(off) || !std::isfinite(products)) return report;
        report.converged = off < tolerance && products < tolerance * (fall() + magnitude);
    }
    kept = true;
    for (Index i = 0; i < m; ++i) {
        if (y[i] > binding * rho[i]) rho[i] *= dearer;
        report.excess = std::max(report.excess, -(values[i] + kept_moved_[i]) / scales[i]);
    }
    report.solved = true;
    return report;
}

}  // namespace leastaction
