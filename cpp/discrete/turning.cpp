#include "discrete/turning.hpp"

#include <Eigen/Geometry>
#include <array>
#include <cmath>

namespace leastaction {

namespace {

using Vector6 = Turning::Vector6;
using Matrix6 = Turning::Matrix6;

// A function of n numbers to second order about a point.
template <int n>
struct Jet {
    double v = 0;
    Eigen::Matrix<double, n, 1> g = Eigen::Matrix<double, n, 1>::Zero();
    Eigen::Matrix<double, n, n> h = Eigen::Matrix<double, n, n>::Zero();

    Jet() = default;
    Jet(double value) : v(value) {}
    static Jet variable(int i) {
        Jet out;
        out.g[i] = 1;
        return out;
    }
    // f(this) for a function with this value and these derivatives.
    Jet of(double f, double f1, double f2) const {
        Jet out(f);
        out.g = f1 * g;
        out.h = f1 * h + f2 * g * g.transpose();
        return out;
    }
};
template <int n>
Jet<n> operator+(const Jet<n>& a, const Jet<n>& b) {
    Jet<n> out(a.v + b.v);
    out.g = a.g + b.g;
    out.h = a.h + b.h;
    return out;
}
template <int n>
Jet<n> operator-(const Jet<n>& a, const Jet<n>& b) {
    Jet<n> out(a.v - b.v);
    out.g = a.g - b.g;
    out.h = a.h - b.h;
    return out;
}
template <int n>
Jet<n> operator*(double s, const Jet<n>& a) {
    Jet<n> out(s * a.v);
    out.g = s * a.g;
    out.h = s * a.h;
    return out;
}
template <int n>
Jet<n> operator*(const Jet<n>& a, double s) {
    return s * a;
}
template <int n>
Jet<n> operator*(const Jet<n>& a, const Jet<n>& b) {
    Jet<n> out(a.v * b.v);
    out.g = a.v * b.g + b.v * a.g;
    out.h = a.v * b.h + b.v * a.h + a.g * b.g.transpose() + b.g * a.g.transpose();
    return out;
}
template <int n>
using Jets = Vec3<Jet<n>>;

// J(theta) near theta = 0 to second order: columns (cy cz, -cy sz, sy), (sz, cz, 0), (0, 0, 1).
template <int n>
struct Rates {
    explicit Rates(const Jets<n>& theta)
        : sy(theta.y.of(0, 1, 0)),
          cy(theta.y.of(1, 0, -1)),
          over(theta.y.of(1, 0, 1)),
          sz(theta.z.of(0, 1, 0)),
          cz(theta.z.of(1, 0, -1)) {}
    Jet<n> sy, cy, over, sz, cz;  // over: 1 / cy

    Jets<n> solve(const Jets<n>& w) const {  // J^-1 w
        const Jet<n> x = (cz * w.x - sz * w.y) * over;
        return {x, sz * w.x + cz * w.y, w.z - sy * x};
    }
    Jets<n> change(const Jets<n>& by, const Jets<n>& nu) const {  // (DJ by) nu
        const Jet<n> y = by.y * nu.x, z = by.z * nu.x, own = by.z * nu.y;
        const Jet<n> turned = cy * z, leant = sy * y;
        return {cz * own - cz * leant - sz * turned, sz * leant - cz * turned - sz * own, cy * y};
    }
};

template <int n>
Jets<n> lifted(const Vec3<double>& a) {
    return {Jet<n>(a.x), Jet<n>(a.y), Jet<n>(a.z)};
}
// (C by) nu, the derivative of J at theta = 0.
template <class T>
Vec3<T> first_change(const Vec3<T>& by, const Vec3<T>& nu) {
    return {by.z * nu.y, -1.0 * (by.z * nu.x), by.y * nu.x};
}

// Sums over k of 1/((2 pi k)^2 - y) and the like: a power series in y = x^2, with derivatives.
constexpr std::array<double, 12> series_c{0.0833333333333333333,   0.00138888888888888889,  0.0000330687830687830688,
                                          8.2671957671957672e-7,   2.0876756987868099e-8,   5.28419013868749318e-10,
                                          1.33825365306846788e-11, 3.38968029632258287e-13, 8.58606205627784456e-15,
                                          2.17486869855806187e-16, 5.50900282836022952e-18, 1.39544646858125233e-19};
constexpr std::array<double, 12> series_tau{0.125,
                                            0.00260416666666666667,
                                            0.0000651041666666666667,
                                            1.64698040674603175e-6,
                                            4.17127390597442681e-8,
                                            1.05658001064088304e-9,
                                            2.67634394509530143e-11,
                                            6.77925714781190394e-13,
                                            1.7172058606100792e-14,
                                            4.349733248883285e-16,
                                            1.10180030298232058e-17,
                                            2.79089277081232254e-19};
void sum_series(const std::array<double, 12>& a, double y, double& f, double& f1, double& f2) {
    f = f1 = f2 = 0;
    for (int i = static_cast<int>(a.size()) - 1; i >= 0; --i) {
        f2 = f2 * y + 2.0 * f1;
        f1 = f1 * y + f;
        f = f * y + a[i];
    }
}
constexpr double series_below = 1.0;  // of y

Eigen::Matrix3d crossing(const Eigen::Vector3d& a) {
    Eigen::Matrix3d out;
    out << 0, -a[2], a[1], a[2], 0, -a[0], -a[1], a[0], 0;
    return out;
}
Eigen::Matrix3d crossing(const Vec3<double>& a) { return crossing(Eigen::Vector3d(a.x, a.y, a.z)); }

}  // namespace

void turn_by(const double* q, const double* phi, double part, double* out) {
    const double square = part * part * (phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]),
                 half = 0.5 * std::sqrt(square);
    const double w = std::cos(half);
    const double f = part * (square < 1e-8 ? 0.5 - square / 48.0 : 0.5 * std::sin(half) / half);
    const double x = f * phi[0], y = f * phi[1], z = f * phi[2];
    double p[4] = {q[0] * w - q[1] * x - q[2] * y - q[3] * z, q[0] * x + q[1] * w + q[2] * z - q[3] * y,
                   q[0] * y + q[2] * w + q[3] * x - q[1] * z, q[0] * z + q[3] * w + q[1] * y - q[2] * x};
    // Of unit length to rounding, and so kept; what is beyond one counts alike above and below it.
    const double beyond = (p[0] - 1.0) * (p[0] + 1.0) + p[1] * p[1] + p[2] * p[2] + p[3] * p[3];
    for (int i = 0; i < 4; ++i) out[i] = p[i] - 0.5 * beyond * p[i];
}

void rotation_between(const double* a, const double* b, double* out) {
    const double w = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3];
    const double v[3] = {a[0] * b[1] - a[1] * b[0] - a[2] * b[3] + a[3] * b[2],
                         a[0] * b[2] - a[2] * b[0] - a[3] * b[1] + a[1] * b[3],
                         a[0] * b[3] - a[3] * b[0] - a[1] * b[2] + a[2] * b[1]};
    const double sine = std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]), cosine = std::abs(w);
    double f = sine < 1e-8 ? 2.0 / cosine : 2.0 * std::atan2(sine, cosine) / sine;
    if (w < 0) f = -f;  // the shorter way
    for (int i = 0; i < 3; ++i) out[i] = f * v[i];
}

Vec3<double> turned(const double* quaternion, const Vec3<double>& a, double sense) {
    const Vec3<double> axis{quaternion[1], quaternion[2], quaternion[3]}, across = 2.0 * cross(axis, a);
    return a + (sense * quaternion[0]) * across + cross(axis, across);
}

Turning::Turning(const double* phi) : phi_{phi[0], phi[1], phi[2]} {
    const double y = dot(phi_, phi_);
    if (y < series_below) {
        sum_series(series_c, y, c_, c1_, c2_);
        sum_series(series_tau, y, tau_, tau1_, tau2_);
    } else {
        const double x = std::sqrt(y), h = 0.5 * x / std::tan(0.5 * x);
        const double h1 = (h - h * h - 0.25 * y) / (2.0 * y);
        const double h2 = ((h1 * (1.0 - 2.0 * h) - 0.25) * 2.0 * y - 2.0 * (h - h * h - 0.25 * y)) / (4.0 * y * y);
        c_ = (1.0 - h) / y;
        c1_ = -(h1 + c_) / y;
        c2_ = -(h2 + 2.0 * c1_) / y;
        const double t = std::tan(0.25 * x), s = 1.0 + t * t;
        tau_ = t / (2.0 * x);
        tau1_ = s / (16.0 * y) - tau_ / (2.0 * y);
        tau2_ = tau_ * s / (32.0 * y) - s / (16.0 * y * y) - tau1_ / (2.0 * y) + tau_ / (2.0 * y * y);
    }
    const Eigen::Matrix3d p = crossing(phi_);
    const Eigen::Matrix3d change_by_d = Eigen::Matrix3d::Identity() + c_ * p * p;
    const auto half = 0.5 * Eigen::Matrix3d::Identity();
    xi_ << half - tau_ * p, half + tau_ * p;
    change_ << 0.5 * p - change_by_d, 0.5 * p + change_by_d;
    // nu = phi less DJ xi phi
    Matrix36 nu = change_;
    nu.row(0) -= phi_.y * xi_.row(2);
    nu.row(1) += phi_.x * xi_.row(2);
    nu.row(2) -= phi_.x * xi_.row(1);
    slope_ << xi_ - 0.5 * nu, xi_ + 0.5 * nu;
}

void Turning::end_to_phi(double* beta) const {
    const Vec3<double> b{beta[0], beta[1], beta[2]}, turned = cross(phi_, b);
    const Vec3<double> change = b + 0.5 * turned + c_ * cross(phi_, turned);
    beta[0] = change.x, beta[1] = change.y, beta[2] = change.z;
}

// dtheta = xi and dnu = -(DJ xi) phi.
Vec3<double> Turning::torque(const double* start, const double* end) const {
    const auto half = [&](int i) { return 0.5 * (end[i] - start[i]); };
    return {start[0] + end[0], start[1] + end[1] - half(2) * phi_.x,
            start[2] + end[2] - half(0) * phi_.y + half(1) * phi_.x};
}

// With P u the change of phi and X u = xi to first order, the second is that of
//
//   h.phi + g.theta:   1/2 u'P'Y u - 1/2 g.(C xi) xi,
//   Y u = s x h + c ((p x d) x h + d x (h x p)) + 2 c' p (h.p x (p x d)) + tau d x g + 2 tau' p (g.p x d),
//
// c' and tau' by x^2; F holds (C xi) xi.
Matrix6 Turning::along(const Eigen::Vector3d& g, const Eigen::Vector3d& h, const Eigen::Matrix3d& mixed,
                       const Eigen::Matrix3d& own) const {
    const Eigen::Vector3d p(phi_.x, phi_.y, phi_.z), hp = h.cross(p);
    const Eigen::Vector3d gp = g.cross(p), hpp = hp.cross(p);
    const Eigen::Matrix3d H = crossing(h);
    const Eigen::Matrix3d by_d = -c_ * (H * crossing(p) + crossing(hp)) + 2.0 * c1_ * p * hpp.transpose() -
                                 tau_ * crossing(g) + 2.0 * tau1_ * p * gp.transpose();
    Matrix36 Y;
    Y << -0.5 * H - by_d, -0.5 * H + by_d;
    Eigen::Matrix3d F;
    F << 0, g[2], -g[1], g[2], 0, g[0], -g[1], g[0], 0;
    const Matrix36 left = 0.5 * Y + mixed.transpose() * xi_;
    const Matrix36 right = (0.5 * own - 0.25 * F) * xi_;
    const Matrix6 half = change_.transpose() * left + xi_.transpose() * right;
    return half + half.transpose();
}

// The symmetric part of g.X_u X_v z: nu = phi + (-z phi_y, z phi_x, -y phi_x) + (phi_x (y^2 - z^2), -phi_y z^2, 2 y z phi_y)/2 with
// theta = (x, y, z).
Matrix6 Turning::chart(const Vector6& g) const {
    const Eigen::Vector3d by_nu = 0.5 * (g.tail<3>() - g.head<3>());
    Eigen::Vector3d by_theta = g.head<3>() + g.tail<3>();
    by_theta[1] -= by_nu[2] * phi_.x;
    by_theta[2] += by_nu[1] * phi_.x - by_nu[0] * phi_.y;
    Eigen::Matrix3d mixed = Eigen::Matrix3d::Zero(), own = Eigen::Matrix3d::Zero();  // theta by phi, theta by theta
    mixed(2, 1) = -by_nu[0];
    mixed(2, 0) = by_nu[1];
    mixed(1, 0) = -by_nu[2];
    own(1, 1) = by_nu[0] * phi_.x;
    own(2, 2) = -by_nu[0] * phi_.x - by_nu[1] * phi_.y;
    own(1, 2) = own(2, 1) = by_nu[2] * phi_.y;
    return along(by_theta, by_nu, mixed, own);
}

Matrix6 Turning::bend(const Vector6& g) const {
    Matrix6 out = chart(g);
    // Half the commutator: u x v of each end.
    const Vector6 by_turn = slope_.transpose() * g;
    for (int end = 0; end < 2; ++end) {
        const auto half = 0.5 * by_turn.segment<3>(3 * end);
        for (int i = 0; i < 3; ++i) {
            const int a = 3 * end + (i + 1) % 3, b = 3 * end + (i + 2) % 3;  // e_a x e_b = e_i
            out(a, b) += half[i];
            out(b, a) -= half[i];
        }
    }
    return out;
}

namespace {

Matrix6 weighted(const Jets<6>& theta, const Jets<6>& nu, const Vector6& g) {
    const auto part = [](const Jets<6>& of, double x, double y, double z) -> Matrix6 {
        return x * of.x.h + y * of.y.h + z * of.z.h;
    };
    return part(theta, g[0] + g[3], g[1] + g[4], g[2] + g[5]) +
           part(nu, 0.5 * (g[3] - g[0]), 0.5 * (g[4] - g[1]), 0.5 * (g[5] - g[2]));
}

}  // namespace

// As a function of (theta, phi), which then move along exp.
Turning::Field Turning::field(const Vector6& w, const Vector6& g, const Vector6& h) const {
    const Jets<6> theta{Jet<6>::variable(0), Jet<6>::variable(1), Jet<6>::variable(2)};
    Jets<6> phi{Jet<6>::variable(3), Jet<6>::variable(4), Jet<6>::variable(5)};
    phi.x.v = phi_.x, phi.y.v = phi_.y, phi.z.v = phi_.z;
    const Rates<6> rates(theta);
    const Jets<6> nu = rates.solve(phi);
    const Vec3<double> alpha{w[0], w[1], w[2]}, beta{w[3], w[4], w[5]};
    const Vec3<double> s = 0.5 * (alpha + beta), d = beta - alpha;
    const Jet<6> y = dot(phi, phi), c = y.of(c_, c1_, c2_), tau = y.of(tau_, tau1_, tau2_);
    const Jets<6> p_d = cross(phi, d);
    const Jets<6> theta_field = rates.solve(lifted<6>(s) + tau * p_d);
    const Jets<6> nu_field =
        rates.solve(lifted<6>(d) + cross(phi, s) + c * cross(phi, p_d) - rates.change(theta_field, nu));
    Matrix6 move, slope;
    move << xi_, change_;
    const Jet<6>* of_theta[3] = {&theta_field.x, &theta_field.y, &theta_field.z};
    const Jet<6>* of_nu[3] = {&nu_field.x, &nu_field.y, &nu_field.z};
    for (int i = 0; i < 3; ++i) {
        slope.row(i) = (of_theta[i]->g - 0.5 * of_nu[i]->g).transpose();
        slope.row(3 + i) = (of_theta[i]->g + 0.5 * of_nu[i]->g).transpose();
    }
    const Vector6 by = slope.transpose() * g;
    const Eigen::Matrix3d none = Eigen::Matrix3d::Zero();
    const Matrix6 second = weighted(theta_field, nu_field, g);
    return {slope * move, move.transpose() * second * move + along(by.head<3>(), by.tail<3>(), none, none), chart(h)};
}

namespace {

// The turn over a part of the step, and its change by (alpha, e) to second order.
struct GivenPart {
    Jets<6> phi, turn;
    GivenPart(const Vec3<double>& at, double part) {
        const double zero[4] = {1, 0, 0, 0}, whole[3] = {at.x, at.y, at.z};
        double quaternion[4];
        turn_by(zero, whole, part, quaternion);
        Jets<6> alpha;
        Jet<6>* each[3] = {&alpha.x, &alpha.y, &alpha.z};
        for (int i = 0; i < 3; ++i) {
            const Vec3<double> a = turned(quaternion, {double(i == 0), double(i == 1), double(i == 2)}, -1.0);
            each[0]->g[i] = a.x, each[1]->g[i] = a.y, each[2]->g[i] = a.z;
        }
        const Jets<6> change{Jet<6>::variable(3), Jet<6>::variable(4), Jet<6>::variable(5)};
        phi = lifted<6>(at) + change;
        const Vec3<double> x = part * at;
        const Jets<6> e = part * change, p = lifted<6>(x), across = cross(p, e), twice = cross(p, across);
        double f, f1, g, g1;  // dexp = 1 - f [x] + g [x]^2, by y = x^2
        slopes(dot(x, x), f, f1, g, g1);
        const Jet<6> along = dot(p, e);
        const Jets<6> beta =
            e - f * across + g * twice + 0.5 * g * cross(e, across) - (f1 * along) * across + (g1 * along) * twice;
        turn = alpha + beta + 0.5 * cross(alpha, beta);
    }

private:
    static void slopes(double y, double& f, double& f1, double& g, double& g1) {
        if (y < series_below) {
            // (-y)^k / (2k + 2)! and (-y)^k / (2k + 3)!
            f = f1 = g = g1 = 0;
            for (int k = 9; k >= 0; --k) {
                const double a = std::tgamma(2 * k + 3), sign = k % 2 ? -1.0 : 1.0;
                f1 = f1 * y + f;
                f = f * y + sign / a;
                g1 = g1 * y + g;
                g = g * y + sign / (a * (2 * k + 3));
            }
            return;
        }
        const double x = std::sqrt(y), s = std::sin(x), c = std::cos(x);
        f = (1.0 - c) / y;
        g = (x - s) / (x * y);
        f1 = (0.5 * x * s - (1.0 - c)) / (y * y);
        g1 = (1.5 * s - x - 0.5 * x * c) / (x * y * y);
    }
};

struct GivenMiddle {
    Jets<6> theta, nu;
    explicit GivenMiddle(const Vec3<double>& phi) {
        const GivenPart half(phi, 0.5);
        theta = half.turn - 0.5 * first_change(half.turn, half.turn);
        nu = Rates<6>(theta).solve(half.phi);
    }
};

}  // namespace

Matrix6 GivenTurning::slope() const {
    const GivenMiddle at(phi_);
    Matrix6 out;
    const Jets<6> q1 = at.theta - 0.5 * at.nu, q2 = at.theta + 0.5 * at.nu;
    out << q1.x.g.transpose(), q1.y.g.transpose(), q1.z.g.transpose(), q2.x.g.transpose(), q2.y.g.transpose(),
        q2.z.g.transpose();
    return out;
}
Matrix6 GivenTurning::bend(const Vector6& g) const {
    const GivenMiddle at(phi_);
    return weighted(at.theta, at.nu, g);
}
GivenTurning::Matrix36 GivenTurning::end_slope() const {
    const GivenPart whole(phi_, 1.0);
    Matrix36 out;
    out << whole.turn.x.g.transpose(), whole.turn.y.g.transpose(), whole.turn.z.g.transpose();
    return out;
}
Matrix6 GivenTurning::end_bend(const Eigen::Vector3d& g) const {
    const GivenPart whole(phi_, 1.0);
    return g[0] * whole.turn.x.h + g[1] * whole.turn.y.h + g[2] * whole.turn.z.h;
}

namespace {

Jets<3> turned_angles() {  // theta along exp
    const Jets<3> a{Jet<3>::variable(0), Jet<3>::variable(1), Jet<3>::variable(2)};
    return a - 0.5 * first_change(a, a);
}
Eigen::Matrix3d weighted(const Jets<3>& of, const Eigen::Vector3d& g) {
    return g[0] * of.x.h + g[1] * of.y.h + g[2] * of.z.h;
}

}  // namespace

Eigen::Matrix3d TurnedField::slope() const {
    const Jets<3> field = Rates<3>(turned_angles()).solve(lifted<3>(w));
    Eigen::Matrix3d out;
    out << field.x.g.transpose(), field.y.g.transpose(), field.z.g.transpose();
    return out;
}
Eigen::Matrix3d TurnedField::bend(const Eigen::Vector3d& g) const {
    return weighted(Rates<3>(turned_angles()).solve(lifted<3>(w)), g);
}
Eigen::Matrix3d symmetric_chart_bend(const Eigen::Vector3d& g) { return weighted(turned_angles(), g); }
Eigen::Matrix3d chart_bend(const Eigen::Vector3d& g) {
    Eigen::Matrix3d out = symmetric_chart_bend(g);
    for (int i = 0; i < 3; ++i) {
        const int a = (i + 1) % 3, b = (i + 2) % 3;
        out(a, b) += 0.5 * g[i];
        out(b, a) -= 0.5 * g[i];
    }
    return out;
}

}  // namespace leastaction
