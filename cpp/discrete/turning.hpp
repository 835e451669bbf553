// The rotation R of a ball joint over one step, R2 = R1 exp(phi) with the rotation vector phi in the body.
//
// The midpoint rule in the chart that moves along, Ld(R1, R2) = dt L(R1 exp(phi/2), phi/dt): at the middle the body's
// angular velocity is phi/dt. The kernel knows the ball as three joints rx, ry, rz behind the rotation R1 exp(phi/2), with
// coordinates theta, zero there, and rates nu/dt; so Ld is a function of (theta, nu), or, as for every other variable, of
//
//   z = (q1, q2),   q1 = theta - nu/2,   q2 = theta + nu/2.
//
// Turning the ends in their bodies, R1 exp(alpha) and R2 exp(beta), with s = (alpha + beta)/2 and d = beta - alpha,
// changes the middle and phi by
//
//   xi   = s + tau phi x d,                              tau = tan(x/4) / (2x),   x = |phi|
//   dphi = d + phi x s + c phi x (phi x d),              c = (1 - (x/2) cot(x/2)) / x^2,
//
// for M2 = dexp(phi/2)/2 dexp(phi)^-1 is a function of the skew matrix of phi, of eigenvalue 1/(1 + exp(-ix/2)) =
// (1 + i tan(x/4))/2, and dexp^-1 of (x/2) cot(x/2) + i x/2. Both are regular below a full turn. Both ends are arguments:
// a derivative with R1 held fixed would make no variational integrator.
//
// With J(theta) between the rates and the body's angular velocity, dtheta = J^-1 xi, nu = J^-1 phi and
// dnu = J^-1 (dphi - (DJ dtheta) nu). Second derivatives of functions on rotations are taken along exp: X_u is the derivative
// by a turn u = (alpha, beta) that is constant in the bodies, and X_u X_v - X_v X_u is the derivative by (u x v).
#pragma once

#include <Eigen/Core>

#include "numerics/spatial.hpp"

namespace leastaction {

// Unit quaternions, scalar first.
void turn_by(const double* quaternion, const double* rotation_vector, double part, double* out);  // q exp(part phi)
void rotation_between(const double* from, const double* to, double* out);                         // log(from^-1 to)
Vec3<double> turned(const double* quaternion, const Vec3<double>& a, double sense = 1.0);         // -1: backwards

class Turning {
public:
    using Vector6 = Eigen::Matrix<double, 6, 1>;
    using Matrix6 = Eigen::Matrix<double, 6, 6>;

    explicit Turning(const double* phi);
    const double* phi() const { return &phi_.x; }

    // Turns of the end (3) as changes of phi, in place.
    void end_to_phi(double* beta) const;
    // What rows of z (3 each) turn the middle by, phi held: the impulse of a torque, in the axes of the middle.
    Vec3<double> torque(const double* start, const double* end) const;
    // Derivatives of z (rows) by u (columns).
    const Matrix6& slope() const { return slope_; }
    // g.X_u X_v z, for weights g: u by rows, v by columns.
    Matrix6 bend(const Vector6& g) const;
    Matrix6 chart(const Vector6& g) const;  // the symmetric part of it

    // Of the field Z = X_w z along a turn w: its derivatives X_u Z (rows Z, columns u), and the symmetric part of
    // g.X_u X_v Z; and the symmetric part of h.X_u X_v z.
    struct Field {
        Matrix6 slope, bend, chart;
    };
    Field field(const Vector6& w, const Vector6& g, const Vector6& h) const;

private:
    using Matrix36 = Eigen::Matrix<double, 3, 6>;

    // The Hessian by u along exp of g.theta + h.phi + a quadratic form of theta and phi.
    Matrix6 along(const Eigen::Vector3d& g, const Eigen::Vector3d& h, const Eigen::Matrix3d& mixed,
                  const Eigen::Matrix3d& own) const;

    Vec3<double> phi_;
    double c_, c1_, c2_, tau_, tau1_, tau2_;  // with first and second derivatives by x^2
    Matrix36 xi_, change_;                    // derivatives of theta and of phi by u
    Matrix6 slope_;
};

// A ball that is prescribed: the rotation vector phi of a step is given, in place of where it ends. By a turn alpha of the
// start and a change e of phi, which is an ordinary vector,
//
//   the middle turns by   exp(-phi/2)(alpha) * dexp(phi/2) e/2,   the end by   beta = exp(-phi)(alpha) * dexp(phi) e
//
// with * the product of turns, a * b = a + b + a x b/2 to second order.
class GivenTurning {
public:
    using Vector6 = Turning::Vector6;
    using Matrix6 = Turning::Matrix6;
    using Matrix36 = Eigen::Matrix<double, 3, 6>;

    explicit GivenTurning(const double* phi) : phi_{phi[0], phi[1], phi[2]} {}

    // Derivatives of z (rows) by (alpha, e), and the second ones, weighted.
    Matrix6 slope() const;
    Matrix6 bend(const Vector6& g) const;
    // Of beta (rows), and the second ones.
    Matrix36 end_slope() const;
    Matrix6 end_bend(const Eigen::Vector3d& g) const;

private:
    Vec3<double> phi_;
};

// Turns about one place alone: J^-1 w of a w that is constant in the body, and its derivatives along exp.
struct TurnedField {
    explicit TurnedField(const double* w) : w{w[0], w[1], w[2]} {}
    Vec3<double> w;
    Eigen::Matrix3d slope() const;                         // X_u (J^-1 w), columns u
    Eigen::Matrix3d bend(const Eigen::Vector3d& g) const;  // symmetric part of g.X_u X_v (J^-1 w)
};
// g.X_u X_v theta about one place: u by rows, v by columns; and its symmetric part.
Eigen::Matrix3d chart_bend(const Eigen::Vector3d& g);
Eigen::Matrix3d symmetric_chart_bend(const Eigen::Vector3d& g);

}  // namespace leastaction
