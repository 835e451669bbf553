#include "discrete/turning.hpp"

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

Vector6 stacked(const Vec3<double>& a, const Vec3<double>& b) {
    Vector6 out;
    out << a.x, a.y, a.z, b.x, b.y, b.z;
    return out;
}

}  // namespace

void turn_by(const double* q, const double* phi, double part, double* out) {
    const double square = part * part * (phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]),
                 half = 0.5 * std::sqrt(square);
    const double w = std::cos(half);
    const double f = part * (square < 1e-8 ? 0.5 - square / 48.0 : 0.5 * std::sin(half) / half);
    const double x = f * phi[0], y = f * phi[1], z = f * phi[2];
    double p[4] = {q[0] * w - q[1] * x - q[2] * y - q[3] * z, q[0] * x + q[1] * w + q[2] * z - q[3] * y,
                   q[0] * y + q[2] * w + q[3] * x - q[1] * z, q[0] * z + q[3] * w + q[1] * y - q[2] * x};
    // Of unit length to rounding, and so kept.
    const double norm = 1.5 - 0.5 * (p[0] * p[0] + p[1] * p[1] + p[2] * p[2] + p[3] * p[3]);
    for (int i = 0; i < 4; ++i) out[i] = norm * p[i];
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
    for (int end = 0; end < 2; ++end)
        for (int i = 0; i < 3; ++i) {
            const Vec3<double> e{double(i == 0), double(i == 1), double(i == 2)};
            const Vec3<double> s = 0.5 * e, d = end ? e : -e;
            const Vec3<double> xi = s + tau_ * cross(phi_, d);
            const Vec3<double> nu = d + cross(phi_, s) + c_ * cross(phi_, cross(phi_, d)) - first_change(xi, phi_);
            slope_.col(3 * end + i) = stacked(xi - 0.5 * nu, xi + 0.5 * nu);
        }
}

void Turning::end_to_phi(double* beta) const {
    const Vec3<double> b{beta[0], beta[1], beta[2]}, turned = cross(phi_, b);
    const Vec3<double> change = b + 0.5 * turned + c_ * cross(phi_, turned);
    beta[0] = change.x, beta[1] = change.y, beta[2] = change.z;
}

namespace {

// theta and phi to second order in the turns u along exp.
struct Moved {
    Jets<6> s, d, theta, phi;
    Moved(const Vec3<double>& at, double c, double c1, double tau, double tau1) {
        Jets<6> a, b;
        a = {Jet<6>::variable(0), Jet<6>::variable(1), Jet<6>::variable(2)};
        b = {Jet<6>::variable(3), Jet<6>::variable(4), Jet<6>::variable(5)};
        s = 0.5 * (a + b);
        d = b - a;
        const Jets<6> p = lifted<6>(at), p_d = cross(p, d), p_p_d = cross(p, p_d);
        const Jets<6> change = d + cross(p, s) + c * p_p_d, xi = s + tau * p_d;
        const Jet<6> along = 2.0 * dot(p, change);  // of x^2
        const Jets<6> twice =
            cross(change, s) + c * (cross(change, p_d) + cross(p, cross(change, d))) + (c1 * along) * p_p_d;
        phi = p + change + 0.5 * twice;
        theta = xi + 0.5 * (tau * cross(change, d) + (tau1 * along) * p_d - first_change(xi, xi));
    }
};

Matrix6 weighted(const Jets<6>& theta, const Jets<6>& nu, const Vector6& g) {
    const auto part = [](const Jets<6>& of, double x, double y, double z) -> Matrix6 {
        return x * of.x.h + y * of.y.h + z * of.z.h;
    };
    return part(theta, g[0] + g[3], g[1] + g[4], g[2] + g[5]) +
           part(nu, 0.5 * (g[3] - g[0]), 0.5 * (g[4] - g[1]), 0.5 * (g[5] - g[2]));
}

}  // namespace

Matrix6 Turning::bend(const Vector6& g) const {
    const Moved at(phi_, c_, c1_, tau_, tau1_);
    Matrix6 out = weighted(at.theta, Rates<6>(at.theta).solve(at.phi), g);
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

Turning::Field Turning::field(const Vector6& w, const Vector6& g, const Vector6& h) const {
    const Moved at(phi_, c_, c1_, tau_, tau1_);
    const Rates<6> rates(at.theta);
    const Jets<6> nu = rates.solve(at.phi);
    const Vec3<double> alpha{w[0], w[1], w[2]}, beta{w[3], w[4], w[5]};
    const Jets<6> s = lifted<6>(0.5 * (alpha + beta)), d = lifted<6>(beta - alpha);
    const Jet<6> y = dot(at.phi, at.phi), c = y.of(c_, c1_, c2_), tau = y.of(tau_, tau1_, tau2_);
    const Jets<6> p_d = cross(at.phi, d);
    const Jets<6> theta_field = rates.solve(s + tau * p_d);
    const Jets<6> nu_field = rates.solve(d + cross(at.phi, s) + c * cross(at.phi, p_d) - rates.change(theta_field, nu));
    Field out{Matrix6(), weighted(theta_field, nu_field, g), weighted(at.theta, nu, h)};
    const Jet<6>* theta[3] = {&theta_field.x, &theta_field.y, &theta_field.z};
    const Jet<6>* rate[3] = {&nu_field.x, &nu_field.y, &nu_field.z};
    for (int i = 0; i < 3; ++i) {
        out.slope.row(i) = (theta[i]->g - 0.5 * rate[i]->g).transpose();
        out.slope.row(3 + i) = (theta[i]->g + 0.5 * rate[i]->g).transpose();
    }
    return out;
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
