#include "continuous/pieces.hpp"

#include <algorithm>
#include <cmath>

namespace leastaction {

namespace {

constexpr int most_iterations = 40;
// A matrix is used again while its steps shrink by at least the first; what they leave is below the second, of the state's
// size, or rounding, where they do not shrink any more below the third. The first step is held against the last.
constexpr double shrinks = 0.2, close = 1e-14, rounding = 1e-11, near = 1e-2;

// The matrix of q (0, w) by q.
Eigen::Matrix4d times_rate(const double* w) {
    return Eigen::Matrix4d{
        {0.0, -w[0], -w[1], -w[2]}, {w[0], 0.0, w[2], -w[1]}, {w[1], -w[2], 0.0, w[0]}, {w[2], w[1], -w[0], 0.0}};
}

// The matrix of the vector of q^-1 p by p, whatever the length of q.
Eigen::Matrix<double, 3, 4> from_quaternion(const double* q) {
    const double square = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3];
    return Eigen::Matrix<double, 3, 4>{
               {-q[1], q[0], q[3], -q[2]}, {-q[2], -q[3], q[0], q[1]}, {-q[3], q[2], -q[1], q[0]}} /
           square;
}

// The vector of the rotation that leads from one quaternion to another.
Eigen::Vector3d rotation_to(const double* from, const double* to) {
    const Eigen::Map<const Eigen::Vector4d> a(from), b(to);
    const Eigen::Vector3d v = from_quaternion(from) * b * a.squaredNorm();
    const double w = a.dot(b), sine = v.norm(), cosine = std::abs(w);
    const double angle = sine < 1e-8 ? 2.0 / cosine : 2.0 * std::atan2(sine, cosine) / sine;
    return (w < 0 ? -angle : angle) * v;  // the shorter way
}

}  // namespace

PieceSolver::PieceSolver(Continuous& at, int points, const double* matrix)
    : at_(at),
      m_(at.mechanism()),
      points_(points),
      nd_(m_.n_dynamic),
      nq_(m_.n_variables()),
      n_q_(m_.n_coordinates()),
      nu_(m_.n_inputs),
      nk_(m_.n_kinematic),
      A_(matrix, matrix + points * points),
      in_ball_(nq_) {
    for (int i = 0; i < points; ++i)
        for (int j = 0; j < points; ++j)
            for (int l = 0; l < points; ++l) A2_.push_back(A_[i * points + j] * A_[j * points + l]);
    const std::size_t size = static_cast<std::size_t>(points) * nd_;
    a_.resize(size);
    a_q_.resize(size * nd_);
    a_v_.resize(size * nd_);
    newton_.resize(size, size);
    right_.resize(size);
    dv_.resize(size);
    turning_.resize(4 * points, 4 * points);
    for (const Ball& ball : m_.balls)
        for (int i = 0; i < 3; ++i) in_ball_[ball.variable + i] = true;
}

bool PieceSolver::evaluate(const double* x, const double* t, const double* u, bool derivatives) {
    for (int j = 0; j < points_; ++j) {
        const double *q = x + size() * j, *inputs = u + (nu_ + nk_) * j;
        at_.t = t[j];
        std::copy_n(q, n_q_, at_.q.begin());
        std::copy_n(q + n_q_, nq_, at_.v.begin());
        for (const Ball& ball : m_.balls) Eigen::Map<Eigen::Vector4d>(&at_.q[ball.quaternion]).normalize();
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
        for (int i = 0; i < points_; ++i) {
            double sum = 0;
            for (int j = 0; j < points_; ++j) sum += A_[i * points_ + j] * u[(nu_ + nk_) * j + nu_ + k];
            x[size() * i + n_q_ + nd_ + k] = x0[n_q_ + nd_ + k] + h * sum;
        }
    }
}

// The equations of a ball's quaternions at all points.
void PieceSolver::turn_with(const Ball& ball, double h, const double* x) {
    turning_.setIdentity();
    for (int j = 0; j < points_; ++j) {
        const Eigen::Matrix4d rate = (0.5 * h) * times_rate(x + size() * j + n_q_ + ball.variable);
        for (int i = 0; i < points_; ++i) turning_.block<4, 4>(4 * i, 4 * j) -= A_[i * points_ + j] * rate;
    }
}

// Sets the configurations of all points that belong to their velocities.
void PieceSolver::follow(double h, const double* x0, double* x) {
    for (int i = 0; i < points_; ++i) {
        double* q = x + size() * i;
        for (int a = 0; a < nq_; ++a) {
            if (in_ball_[a]) continue;
            double sum = 0;
            for (int j = 0; j < points_; ++j) sum += A_[i * points_ + j] * x[size() * j + n_q_ + a];
            q[a] = x0[a] + h * sum;
        }
    }
    for (const Ball& ball : m_.balls) {
        turn_with(ball, h, x);
        const Eigen::Map<const Eigen::Vector4d> start(x0 + ball.quaternion);
        const Eigen::VectorXd found = turning_.partialPivLu().solve(start.replicate(points_, 1));
        for (int i = 0; i < points_; ++i) std::copy_n(&found[4 * i], 4, x + size() * i + ball.quaternion);
    }
}

void PieceSolver::factor(double h, const double* x) {
    newton_.setIdentity();
    const std::size_t block = static_cast<std::size_t>(nd_) * nd_;
    for (int i = 0; i < points_; ++i) {
        for (int l = 0; l < points_; ++l) {
            for (int a = 0; a < nd_; ++a) {
                for (int b = 0; b < nd_; ++b) {
                    double sum = h * A_[i * points_ + l] * a_v_[l * block + a * nd_ + b];
                    for (int j = 0; j < points_ && !in_ball_[b]; ++j)
                        sum += h * h * A2_[(i * points_ + j) * points_ + l] * a_q_[j * block + a * nd_ + b];
                    newton_(i * nd_ + a, l * nd_ + b) -= sum;
                }
            }
        }
    }
    for (const Ball& ball : m_.balls) {
        if (ball.variable >= nd_) continue;
        turn_with(ball, h, x);
        Matrix pushed(4 * points_, 3 * points_);
        for (int l = 0; l < points_; ++l) {
            for (int c = 0; c < 3; ++c) {
                double turn[3] = {0.0, 0.0, 0.0};
                turn[c] = 0.5 * h;
                const Eigen::Map<const Eigen::Vector4d> q(x + size() * l + ball.quaternion);
                const Eigen::Vector4d by = times_rate(turn) * q;
                for (int i = 0; i < points_; ++i) pushed.block<4, 1>(4 * i, 3 * l + c) = A_[i * points_ + l] * by;
            }
        }
        pushed = turning_.partialPivLu().solve(pushed).eval();
        turned_.resize(3 * points_, 3 * points_);
        for (int j = 0; j < points_; ++j)
            turned_.middleRows(3 * j, 3) =
                2.0 * from_quaternion(x + size() * j + ball.quaternion) * pushed.middleRows(4 * j, 4);
        for (int j = 0; j < points_; ++j) {
            using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
            const Eigen::Map<const Rows> slopes(&a_q_[j * block], nd_, nd_);
            const Matrix felt = h * slopes.middleCols(ball.variable, 3) * turned_.middleRows(3 * j, 3);
            for (int i = 0; i < points_; ++i)
                for (int l = 0; l < points_; ++l)
                    newton_.block(i * nd_, l * nd_ + ball.variable, nd_, 3) -=
                        A_[i * points_ + j] * felt.middleCols(3 * l, 3);
        }
    }
    factors_.compute(newton_);
}

// Makes a step, and returns its size relative to the state; no number where it leads nowhere.
double PieceSolver::step(double h, const double* x0, double* x) {
    for (int i = 0; i < points_; ++i) {
        for (int a = 0; a < nd_; ++a) {
            double v = 0;
            for (int j = 0; j < points_; ++j) v += A_[i * points_ + j] * a_[nd_ * j + a];
            right_[nd_ * i + a] = x0[n_q_ + a] + h * v - x[size() * i + n_q_ + a];
        }
    }
    dv_ = factors_.solve(right_);
    before_.assign(x, x + static_cast<std::size_t>(points_) * size());
    for (int i = 0; i < points_; ++i)
        for (int a = 0; a < nd_; ++a) x[size() * i + n_q_ + a] += dv_[nd_ * i + a];
    follow(h, x0, x);
    double most = 0, nothing = 0;
    for (std::size_t i = 0; i < before_.size(); ++i) {
        most = std::max(most, std::abs(x[i] - before_[i]) / (1.0 + std::abs(x[i])));
        nothing += 0.0 * x[i];
    }
    return most + nothing;
}

bool PieceSolver::solve(double h, const double* x0, const double* t, const double* u, double* x) {
    move_kinematic(h, x0, u, x);
    follow(h, x0, x);
    bool factored = false;
    double before = near;
    for (int made = 0; made < most_iterations; ++made) {
        if (!evaluate(x, t, u, !factored)) return false;
        if (!factored) factor(h, x);
        const double size = step(h, x0, x), left = size / before;
        if (!std::isfinite(size)) return false;
        // Steps with one matrix shrink by a factor, those with a new one are squared.
        if (size * std::min(left, 1.0) <= close || (size <= rounding && left > shrinks)) return true;
        factored = left <= shrinks;
        before = size;
    }
    return false;
}

int roll_out_pieces(Continuous& at, int points, const double* matrix, int pieces, const double* h, const double* t,
                    const PieceReference& reference, double* z, double* u) {
    const Mechanism& m = at.mechanism();
    const int nq = m.n_variables(), n_q = m.n_coordinates(), nc = m.n_configuration(), nx = m.n_states();
    const int nu = points * m.n_controls(), nz = points * nx + nu, ndx = m.n_tangent(), ndz = points * ndx + nu;
    PieceSolver solver(at, points, matrix);
    std::vector<double> x0(solver.size()), x(static_cast<std::size_t>(points) * solver.size(), 0.0), off(ndz);
    // Where a point's state stands, the last point first.
    const auto place = [&](int point) { return point == points - 1 ? 0 : point + 1; };
    for (int k = 0; k < pieces; ++k) {
        const double *now = z + static_cast<std::size_t>(k) * nz,
                     *wanted = reference.z + static_cast<std::size_t>(k) * nz;
        const double* following = wanted + nz;
        double *next = z + static_cast<std::size_t>(k + 1) * nz, *inputs = u + static_cast<std::size_t>(k) * nu;
        for (int point = 0; point < points; ++point) {
            const double *is = now + point * nx, *meant = wanted + point * nx;
            double* by = &off[static_cast<std::size_t>(point) * ndx];
            for (int i = 0; i < nq; ++i) {
                by[m.external[i]] = is[m.places[i]] - meant[m.places[i]];
                by[nq + m.external[i]] = is[nc + m.external[i]] - meant[nc + m.external[i]];
            }
            for (const Ball& ball : m.balls)
                Eigen::Map<Eigen::Vector3d>(by + m.external[ball.variable]) =
                    rotation_to(meant + ball.place, is + ball.place);
        }
        for (int i = 0; i < nu; ++i) off[points * ndx + i] = now[points * nx + i] - wanted[points * nx + i];
        const double* K = reference.K + static_cast<std::size_t>(k) * nu * ndz;
        for (int a = 0; a < nu; ++a) {
            double back = 0;
            for (int i = 0; i < ndz; ++i) back += K[static_cast<std::size_t>(a) * ndz + i] * off[i];
            inputs[a] = reference.u[static_cast<std::size_t>(k) * nu + a] - back;
        }
        for (int i = 0; i < nq; ++i) {
            const int v = m.external[i];
            x0[i] = now[m.places[i]];
            x0[n_q + i] = now[nc + v];
            for (int point = 0; point < points; ++point)
                x[point * solver.size() + n_q + i] = following[place(point) * nx + nc + v] + off[nq + v];
        }
        for (const Ball& ball : m.balls) {
            std::fill_n(&x0[ball.variable], 3, 0.0);
            std::copy_n(now + ball.place, 4, &x0[ball.quaternion]);
        }
        if (!solver.solve(h[k], x0.data(), t + static_cast<std::size_t>(k) * points, inputs, x.data())) return k;
        for (int point = 0; point < points; ++point) {
            const double* found = &x[static_cast<std::size_t>(point) * solver.size()];
            double* out = next + place(point) * nx;
            for (int i = 0; i < nq; ++i) {
                out[m.places[i]] = found[i];
                out[nc + m.external[i]] = found[n_q + i];
            }
            for (const Ball& ball : m.balls) std::copy_n(found + ball.quaternion, 4, out + ball.place);
        }
        std::copy_n(inputs, nu, next + points * nx);
    }
    return pieces;
}

}  // namespace leastaction
