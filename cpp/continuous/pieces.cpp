#include "continuous/pieces.hpp"

#include <algorithm>
#include <cmath>

namespace leastaction {

namespace {

constexpr int most_iterations = 40;
// A matrix is used again while its steps shrink by at least the first; what they leave is below the second, of the state's
// size, or rounding, where they do not shrink any more below the third. The first step is held against the last.
constexpr double shrinks = 0.2, close = 1e-14, rounding = 1e-11, near = 1e-2;

}  // namespace

PieceSolver::PieceSolver(Continuous& at, int points, const double* matrix)
    : at_(at),
      points_(points),
      nd_(at.mechanism().n_dynamic),
      nq_(at.mechanism().n_variables()),
      nu_(at.mechanism().n_inputs),
      nk_(at.mechanism().n_kinematic),
      A_(matrix, matrix + points * points) {
    for (int i = 0; i < points; ++i)
        for (int j = 0; j < points; ++j)
            for (int l = 0; l < points; ++l) A2_.push_back(A_[i * points + j] * A_[j * points + l]);
    const std::size_t size = static_cast<std::size_t>(points) * nd_;
    a_.resize(size);
    r_q_.resize(size);
    a_q_.resize(size * nd_);
    a_v_.resize(size * nd_);
    newton_.resize(size, size);
    right_.resize(size);
    dv_.resize(size);
}

bool PieceSolver::evaluate(const double* x, const double* u, bool derivatives) {
    for (int j = 0; j < points_; ++j) {
        const double *q = x + 2 * nq_ * j, *inputs = u + (nu_ + nk_) * j;
        std::copy_n(q, nq_, at_.q.begin());
        std::copy_n(q + nq_, nq_, at_.v.begin());
        std::copy_n(inputs, nu_, at_.u.begin());
        std::copy_n(inputs + nu_, nk_, at_.a.begin() + nd_);
        const MotionReport report = derivatives ? at_.differentiate() : at_.accelerate();
        if (report.status != MotionStatus::solved) return false;
        std::copy_n(at_.a.begin(), nd_, a_.begin() + nd_ * j);
        if (!derivatives) continue;
        for (int i = 0; i < nd_; ++i) {
            const double* row = &at_.Y[static_cast<std::size_t>(i) * at_.ld()];
            std::copy_n(row, nd_, &a_q_[(static_cast<std::size_t>(j) * nd_ + i) * nd_]);
            std::copy_n(row + nq_, nd_, &a_v_[(static_cast<std::size_t>(j) * nd_ + i) * nd_]);
        }
    }
    return true;
}

void PieceSolver::move_kinematic(double h, const double* x0, const double* u, double* x) const {
    for (int k = 0; k < nk_; ++k) {
        const int place = nd_ + k;
        for (const bool rates : {true, false}) {
            for (int i = 0; i < points_; ++i) {
                double sum = 0;
                for (int j = 0; j < points_; ++j)
                    sum += A_[i * points_ + j] * (rates ? u[(nu_ + nk_) * j + nu_ + k] : x[2 * nq_ * j + nq_ + place]);
                const int at = rates ? nq_ + place : place;
                x[2 * nq_ * i + at] = x0[at] + h * sum;
            }
        }
    }
}

void PieceSolver::factor(double h) {
    newton_.setIdentity();
    const std::size_t block = static_cast<std::size_t>(nd_) * nd_;
    for (int i = 0; i < points_; ++i) {
        for (int l = 0; l < points_; ++l) {
            for (int a = 0; a < nd_; ++a) {
                for (int b = 0; b < nd_; ++b) {
                    double sum = h * A_[i * points_ + l] * a_v_[l * block + a * nd_ + b];
                    for (int j = 0; j < points_; ++j)
                        sum += h * h * A2_[(i * points_ + j) * points_ + l] * a_q_[j * block + a * nd_ + b];
                    newton_(i * nd_ + a, l * nd_ + b) -= sum;
                }
            }
        }
    }
    factors_.compute(newton_);
}

// Makes a step, and returns its size relative to the state; no number where it leads nowhere.
double PieceSolver::step(double h, const double* x0, double* x) {
    const std::size_t block = static_cast<std::size_t>(nd_) * nd_;
    for (int i = 0; i < points_; ++i) {
        for (int a = 0; a < nd_; ++a) {
            double q = 0, v = 0;
            for (int j = 0; j < points_; ++j) {
                q += A_[i * points_ + j] * x[2 * nq_ * j + nq_ + a];
                v += A_[i * points_ + j] * a_[nd_ * j + a];
            }
            r_q_[nd_ * i + a] = x0[a] + h * q - x[2 * nq_ * i + a];
            right_[nd_ * i + a] = x0[nq_ + a] + h * v - x[2 * nq_ * i + nq_ + a];
        }
    }
    for (int j = 0; j < points_; ++j) {
        for (int a = 0; a < nd_; ++a) {
            double bent = 0;
            for (int b = 0; b < nd_; ++b) bent += a_q_[j * block + a * nd_ + b] * r_q_[nd_ * j + b];
            for (int i = 0; i < points_; ++i) right_[nd_ * i + a] += h * A_[i * points_ + j] * bent;
        }
    }
    dv_ = factors_.solve(right_);
    double size = 0, nothing = 0;
    const auto move = [&](double& value, double change) {
        value += change;
        size = std::max(size, std::abs(change) / (1.0 + std::abs(value)));
        nothing += 0.0 * value;
    };
    for (int i = 0; i < points_; ++i) {
        for (int a = 0; a < nd_; ++a) {
            double dq = r_q_[nd_ * i + a];
            for (int j = 0; j < points_; ++j) dq += h * A_[i * points_ + j] * dv_[nd_ * j + a];
            move(x[2 * nq_ * i + a], dq);
            move(x[2 * nq_ * i + nq_ + a], dv_[nd_ * i + a]);
        }
    }
    return size + nothing;
}

bool PieceSolver::solve(double h, const double* x0, const double* u, double* x) {
    move_kinematic(h, x0, u, x);
    bool factored = false;
    double before = near;
    for (int made = 0; made < most_iterations; ++made) {
        if (!evaluate(x, u, !factored)) return false;
        if (!factored) factor(h);
        const double size = step(h, x0, x), left = size / before;
        if (!std::isfinite(size)) return false;
        // Steps with one matrix shrink by a factor, those with a new one are squared.
        if (size * std::min(left, 1.0) <= close || (size <= rounding && left > shrinks)) return true;
        factored = left <= shrinks;
        before = size;
    }
    return false;
}

int roll_out_pieces(Continuous& at, int points, const double* matrix, int pieces, const double* h,
                    const PieceReference& reference, double* z, double* u) {
    const Mechanism& m = at.mechanism();
    const int nq = m.n_variables(), nx = 2 * nq, nu = points * (m.n_inputs + m.n_kinematic), nz = points * nx + nu;
    PieceSolver solver(at, points, matrix);
    std::vector<double> x0(nx), x(static_cast<std::size_t>(points) * nx), off(nz);
    // Where a point's state stands in z, the last point first.
    const auto place = [&](int point) { return point == points - 1 ? 0 : (point + 1) * nx; };
    const auto outside = [&](int i) { return i < nq ? m.external[i] : nq + m.external[i - nq]; };
    for (int k = 0; k < pieces; ++k) {
        const double *now = z + static_cast<std::size_t>(k) * nz,
                     *wanted = reference.z + static_cast<std::size_t>(k) * nz;
        const double* following = wanted + nz;
        double *next = z + static_cast<std::size_t>(k + 1) * nz, *inputs = u + static_cast<std::size_t>(k) * nu;
        for (int i = 0; i < nz; ++i) off[i] = now[i] - wanted[i];
        const double* K = reference.K + static_cast<std::size_t>(k) * nu * nz;
        for (int a = 0; a < nu; ++a) {
            double back = 0;
            for (int i = 0; i < nz; ++i) back += K[static_cast<std::size_t>(a) * nz + i] * off[i];
            inputs[a] = reference.u[static_cast<std::size_t>(k) * nu + a] - back;
        }
        for (int i = 0; i < nx; ++i) {
            x0[i] = now[outside(i)];
            for (int point = 0; point < points; ++point)
                x[static_cast<std::size_t>(point) * nx + i] = following[place(point) + outside(i)] + off[outside(i)];
        }
        if (!solver.solve(h[k], x0.data(), inputs, x.data())) return k;
        for (int i = 0; i < nx; ++i)
            for (int point = 0; point < points; ++point)
                next[place(point) + outside(i)] = x[static_cast<std::size_t>(point) * nx + i];
        std::copy_n(inputs, nu, next + points * nx);
    }
    return pieces;
}

}  // namespace leastaction
