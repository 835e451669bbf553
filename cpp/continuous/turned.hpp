// A ball whose rotation is a unit quaternion, at a point of a motion in continuous time.
//
// The kernel knows it as three joints rx, ry, rz behind its rotation R, whose coordinates theta are zero and whose rates are
// the body's angular velocity w. That is a chart, in which the equations of motion are those of any joint. About theta = 0
//
//   w = J(theta) theta',     w' = J(theta) theta'' + K(theta, theta'),     K = (DJ theta') theta',
//
// so at theta = 0 itself theta' = w and w' = theta'' + C(w, w), with C(b, n) = (DJ b) n = (b3 n2, -b3 n1, b2 n1). Derivatives
// are by a turn d in the body, R exp(d), and a change of w, for which theta = d - C(d, d)/2 + O(d^3), theta' = J^-1 w.
#pragma once

#include <Eigen/Core>

#include "numerics/spatial.hpp"

namespace leastaction {

// C(by, rates) above.
template <class T>
Vec3<T> turned_rates(const Vec3<T>& by, const Vec3<T>& rates) {
    return {by.z * rates.y, -1.0 * (by.z * rates.x), by.y * rates.x};
}

struct TurnedPoint {
    using Matrix3 = Eigen::Matrix3d;
    using Matrix36 = Eigen::Matrix<double, 3, 6>;
    using Matrix6 = Eigen::Matrix<double, 6, 6>;

    Vec3<double> w, a;  // angular velocity and theta''

    Matrix3 rates() const;                        // theta' by turns
    Matrix36 slope() const;                       // J theta'' + K by (d, w), with theta'' held
    static Matrix3 mixed(const Vec3<double>& z);  // z.J theta'' by d (rows) and theta'' (columns)
    // The Hessian of z.(J theta'' + K) + g.theta + h.theta' by (d, w), with theta'' held.
    Matrix6 bend(const Vec3<double>& z, const Vec3<double>& g, const Vec3<double>& h) const;
};

}  // namespace leastaction
