// What rotations that are quaternions add to the equations of motion and their derivatives.
//
// The kernel's variables th = [q | v | u | rho_a] are functions of turns, angular velocities and what they change by. With T
// their derivative, and y = (a, lam) of which rows of balls are angular, y_th becomes y_th T + (the slope of J theta'' + K),
// and the Hessian of z.y, with g = y_th'z,
//
//   T'(z.y)_thth T + g.th_xx + z.(J theta'' + K)_xx  [theta'' held]  + the products of J's slope and that of theta''.
//
// Of a ball that is prescribed J theta'' + K is given: theta'' takes the opposite of these terms.
#include <utility>

#include "continuous/dynamics.hpp"

namespace leastaction {

using Rows = Eigen::Matrix<double, 3, Eigen::Dynamic>;

namespace {

Vec3<double> vector_at(const double* at) { return {at[0], at[1], at[2]}; }

}  // namespace

void Continuous::change_accelerations(double sign) {
    for (const Ball& ball : mechanism_->balls) {
        const int at = ball.variable;
        const Vec3<double> w = vector_at(&v[at]), more = turned_rates(w, w);
        a[at] += sign * more.x;
        a[at + 1] += sign * more.y;
        a[at + 2] += sign * more.z;
    }
}

// With a as the kernel has it.
TurnedPoint Continuous::turned_point(const Ball& ball) const {
    return {vector_at(&v[ball.variable]), vector_at(&a[ball.variable])};
}

// Times T.
void Continuous::turn_columns(double* of, std::size_t rows, std::size_t stride) const {
    using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    Eigen::Map<Matrix, 0, Eigen::OuterStride<>> all(of, rows, n_theta_, Eigen::OuterStride<>(stride));
    for (const Ball& ball : mechanism_->balls) {
        const TurnedPoint point = turned_point(ball);
        const int at = ball.variable;
        all.middleCols(at, 3) += (all.middleCols(at_v_ + at, 3) * point.rates()).eval();
        if (at < nd_) continue;
        const Eigen::Matrix<double, 3, 6> slope = point.slope();
        const Eigen::Matrix<double, Eigen::Dynamic, 3> given = all.middleCols(at_rho_ + at - nd_, 3);
        all.middleCols(at, 3) -= given * slope.leftCols<3>();
        all.middleCols(at_v_ + at, 3) -= given * slope.rightCols<3>();
    }
}

void Continuous::turn_slopes() {
    kernel_Y_ = Y;
    turn_columns(Y.data(), nd_ + nc_, ld_);
    for (const Ball& ball : mechanism_->balls) {
        if (ball.variable >= nd_) continue;
        const Eigen::Matrix<double, 3, 6> slope = turned_point(ball).slope();
        for (int i = 0; i < 3; ++i) {
            double* row = &Y[static_cast<std::size_t>(ball.variable + i) * ld_];
            for (int j = 0; j < 3; ++j) {
                row[ball.variable + j] += slope(i, j);
                row[at_v_ + ball.variable + j] += slope(i, 3 + j);
            }
        }
    }
    change_accelerations(1.0);
}

// With a as the kernel has it.
void Continuous::turn_curvature(const double* z_a, const double* z_lam) {
    const int n = n_theta_;
    Eigen::Map<NewtonMatrix::Matrix> all(H.data(), n, n);
    // Of H only what is on and below the diagonal of blocks is made.
    for (const auto& [begin, end] : {std::pair{at_v_, at_u_}, std::pair{at_u_, at_rho_}, std::pair{at_rho_, n}})
        all.block(0, begin, begin, end - begin) = all.block(begin, 0, end - begin, begin).transpose();
    turn_columns(H.data(), n, n);
    all.transposeInPlace();
    turn_columns(H.data(), n, n);
    const Eigen::Map<const NewtonMatrix::Matrix> y(kernel_Y_.data(), nd_ + nc_, ld_), turned(Y.data(), nd_ + nc_, ld_);
    const Eigen::VectorXd g = y.topLeftCorner(nd_, n).transpose() * Eigen::Map<const Eigen::VectorXd>(z_a, nd_) +
                              y.block(nd_, 0, nc_, n).transpose() * Eigen::Map<const Eigen::VectorXd>(z_lam, nc_);
    for (const Ball& ball : mechanism_->balls) {
        const int at = ball.variable, given = at_rho_ + at - nd_;
        const TurnedPoint point = turned_point(ball);
        const Eigen::Matrix<double, 3, 6> slope = point.slope();
        const bool dynamic = at < nd_;
        // Weights on J theta'' + K, and how theta'' changes.
        const Vec3<double> z = dynamic ? vector_at(z_a + at) : -vector_at(&g[given]);
        Rows change = Rows::Zero(3, n);
        if (dynamic)
            change = turned.block(at, 0, 3, n);
        else
            change.middleCols<3>(given).setIdentity();
        change.middleCols<3>(at) -= slope.leftCols<3>();
        change.middleCols<3>(at_v_ + at) -= slope.rightCols<3>();
        const Rows rows = TurnedPoint::mixed(z) * change;
        all.middleRows<3>(at) += rows;
        all.middleCols<3>(at) += rows.transpose();
        const Eigen::Matrix<double, 6, 6> own = point.bend(z, vector_at(&g[at]), vector_at(&g[at_v_ + at]));
        const auto place_of = [&](int k) { return k < 3 ? at + k : at_v_ + at + k - 3; };
        for (int i = 0; i < 6; ++i)
            for (int j = 0; j < 6; ++j) all(place_of(i), place_of(j)) += own(i, j);
    }
}

}  // namespace leastaction
