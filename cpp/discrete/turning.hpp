// The rotation R of a ball joint over one step, R2 = R1 exp(phi) with the rotation vector phi in the body.
//
// The midpoint rule in the chart that moves along, Ld(R1, R2) = dt L(R1 exp(phi/2), phi/dt): at the middle the body's
// angular velocity is phi/dt. So Ld is a function of the rotation at the middle and of phi, or, as for every other variable,
// of q1 = theta - phi/2 and q2 = theta + phi/2, where theta stands for turns of the middle.
//
// Turning the ends in their bodies, R1 exp(alpha) and R2 exp(beta), with s = (alpha + beta)/2 and d = beta - alpha, turns
// the middle by xi and changes phi by eta,
//
//   xi  = s + tau phi x d,                              tau = tan(x/4) / (2x),   x = |phi|
//   eta = d + phi x s + c phi x (phi x d),              c = (1 - (x/2) cot(x/2)) / x^2,
//
// for M2 = dexp(phi/2)/2 dexp(phi)^-1 is a function of the skew matrix of phi, of eigenvalue 1/(1 + exp(-ix/2)) =
// (1 + i tan(x/4))/2, and dexp^-1 of (x/2) cot(x/2) + i x/2. Both are regular below a full turn. Both ends are arguments:
// a derivative with R1 held fixed would make no variational integrator.
//
// Second derivatives of functions on rotations are taken along exp: X_u is the derivative by a turn u = (alpha, beta) that is
// constant in the bodies, and X_u X_v - X_v X_u is the derivative by (u x v). Here is the symmetric part of X_u X_v, by (s, d):
// what is a function of the ends is one of s and d as other variables are, q1 ~ s - d/2 and q2 ~ s + d/2.
//
// The kernel (dynamics/lagrangian.hpp) takes second derivatives by turns of the middle and the body's rates as products,
// rows r and columns c of a ball's joints. These stand for D_c D_r, the turn of the column last, but for derivatives by a turn in
// the row and a rate in the column, where h.(r x c) is missing, h = L_v. Half of that is in bend(), which goes with the
// symmetric part of the products.
//
// Elements know a ball as three joints rx, ry, rz behind its rotation, with coordinates that are zero there and rates theta': a
// chart. With J(theta) between its rates and the body's, theta' = J^-1 w, and about theta = 0, with C(b) w = (b3 w2, -b3 w1, b2 w1)
// and N(b, b) w = (w1 (b2^2 - b3^2), -w2 b3^2, 2 b2 b3 w2)/2, J^-1 = 1 - C(theta) + N(theta, theta) + ... OfChart is what second
// derivatives along exp have more than those by the chart.
#pragma once

#include <Eigen/Core>

#include "numerics/small_matrix.hpp"
#include "numerics/spatial.hpp"

namespace leastaction {

// Unit quaternions, scalar first.
void turn_by(const double* quaternion, const double* rotation_vector, double part, double* out);  // q exp(part phi)
void rotation_between(const double* from, const double* to, double* out);                         // log(from^-1 to)
Vec3<double> turned(const double* quaternion, const Vec3<double>& a, double sense = 1.0);         // -1: backwards

SmallMatrix<3> crossing(const Vec3<double>& a);  // a x

class Turning {
public:
    using Vector = Vec3<double>;
    using Matrix3 = SmallMatrix<3>;
    using Matrix6 = SmallMatrix<6>;

    explicit Turning(const double* phi);
    const double* phi() const { return &phi_.x; }

    // From R1 to the middle, and from R1 to R2.
    void turn_half(const double* quaternion, double* out) const;
    void turn_whole(const double* quaternion, double* out) const;
    // Turns of the end (3) as changes of phi, in place.
    void end_to_phi(double* beta) const;
    // Rows of (q1, q2), 3 each, as rows of turns of the ends, in place.
    void turn_rows(double* start, double* end) const;
    // Derivatives of (theta, phi/dt), rows, by (s, d/dt).
    Matrix6 slope(double dt = 1.0) const;
    // What second derivatives by (s, d) of a function with the slopes g and h by theta and phi have besides products.
    Matrix6 bend(const Vector& g, const Vector& h) const;

private:
    friend class TurnedField;
    // The second derivatives by (s, d) of theta and phi, times g and h, and those by (phi, theta) and phi twice that are given.
    Matrix6 along(const Vector& g, const Vector& h, const Matrix3& phi_theta, const Matrix3* twice_phi) const;
    Matrix3 phi_by_d() const;
    Matrix3 by_phi(const Matrix3& m) const;

    Vector phi_;
    double c_, c1_, c2_, tau_, tau1_, tau2_;  // with first and second derivatives by x^2
    double cosine_, sine_;                    // exp(phi/2) is the quaternion (cosine, sine phi)
};

// Of elements at the middle: second derivatives by (theta, phi), and what their slope by theta is along exp. `by_phi`: their slope
// by phi.
struct OfChart {
    Turning::Vector by_theta;
    Turning::Matrix3 twice_theta, phi_theta;

    OfChart(const Turning::Vector& phi, const Turning::Vector& by_theta, const Turning::Vector& by_phi);
    // With (theta, phi) of this slope by others.
    Turning::Matrix6 by(const Turning::Matrix6& slope) const;
};
// C(.) w as a matrix, and g.C(.) w as a vector.
Turning::Matrix3 change_by_turn(const Vec3<double>& w);
Vec3<double> weighted_change(const Vec3<double>& g, const Vec3<double>& w);

// What (theta, phi) change by along turns (mu, w) of the ends, as functions of the ends itself.
class TurnedField {
public:
    TurnedField(const Turning& turning, const Vec3<double>& mu, const Vec3<double>& w);
    const Vec3<double>& theta() const { return xi_; }
    const Vec3<double>& phi() const { return eta_; }
    Turning::Matrix6 slope() const;  // derivatives of it (rows) by (s, d)
    // dt times the same of (theta, phi/dt) by (s, d/dt), in axes that turn along theta(), as the kernel's do: less what these turn by.
    // `by`: Turning::slope(dt).
    Turning::Matrix6 slope_in_turned_axes(const Turning::Matrix6& by, double dt) const;
    // What second derivatives by (s, d) of g and h times the field have besides products; `along_theta` and `along_phi`: what g and
    // h change by along it, in axes that turn too.
    Turning::Matrix6 bend(const Vec3<double>& g, const Vec3<double>& h, const Vec3<double>& along_theta,
                          const Vec3<double>& along_phi) const;
    // The same of elements, of which h is zero.
    Turning::Matrix6 bend_of_elements(const Vec3<double>& g, const Vec3<double>& along_theta,
                                      const Vec3<double>& along_phi) const;

private:
    Turning::Matrix3 twice_phi(const Vec3<double>& g, const Vec3<double>& h) const;  // of g.xi + h.eta
    const Turning& at_;
    Vec3<double> s_, d_, xi_, eta_;      // xi and eta along (mu, w)
    Turning::Matrix3 xi_phi_, eta_phi_;  // derivatives
};

// A ball that is prescribed: the rotation vector phi of a step is given, in place of where it ends. By a turn alpha of the
// start and a change e of phi, which is an ordinary vector,
//
//   the middle turns by   exp(-phi/2)(alpha) * dexp(phi/2) e/2,   the end by   beta = exp(-phi)(alpha) * dexp(phi) e
//
// with * the product of turns, a * b = a + b + a x b/2 to second order.
class GivenTurning {
public:
    using Matrix6 = Eigen::Matrix<double, 6, 6>;
    using Matrix36 = Eigen::Matrix<double, 3, 6>;

    explicit GivenTurning(const double* phi) : phi_{phi[0], phi[1], phi[2]} {}

    // As of Turning and TurnedField, with s = (alpha + e)/2 and d = e - alpha. The field of the weights does not move this ball, so
    // g and h are the slopes by theta and phi of the whole weighted sum.
    Turning::Matrix6 slope(double dt = 1.0) const;
    Turning::Matrix6 bend(const Vec3<double>& g, const Vec3<double>& h) const;
    Turning::Matrix6 bend_of_elements(const Vec3<double>& g, const Vec3<double>& h) const;
    // Of beta (rows) by (alpha, e), and the second ones, weighted.
    Matrix36 end_slope() const;
    Matrix6 end_bend(const Eigen::Vector3d& g) const;

private:
    Matrix6 turn_bend(const Vec3<double>& g) const;
    Vec3<double> phi_;
};

// A form of (s, d) as one of the ends, alpha = s - d/2 and beta = s + d/2.
Turning::Matrix6 by_ends(const Turning::Matrix6& form);

// Turns about one place alone: J^-1 w of a w that is constant in the body, and its derivatives along exp.
struct TurnedAxis {
    explicit TurnedAxis(const double* w) : w{w[0], w[1], w[2]} {}
    Vec3<double> w;
    Eigen::Matrix3d slope() const;                         // X_u (J^-1 w), columns u
    Eigen::Matrix3d bend(const Eigen::Vector3d& g) const;  // symmetric part of g.X_u X_v (J^-1 w)
};
// g.X_u X_v theta about one place: u by rows, v by columns; and its symmetric part.
Eigen::Matrix3d chart_bend(const Eigen::Vector3d& g);
Eigen::Matrix3d symmetric_chart_bend(const Eigen::Vector3d& g);

}  // namespace leastaction
