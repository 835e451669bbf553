#include "discrete/turning.hpp"

#include <Eigen/Geometry>
#include <array>
#include <cmath>

namespace leastaction {

namespace {

using Vector3 = Turning::Vector3;
using Matrix3 = Turning::Matrix3;
using Matrix6 = Turning::Matrix6;

Vector3 column(const Vec3<double>& a) { return {a.x, a.y, a.z}; }
Matrix3 crossing(const Vector3& a) {
    Matrix3 out;
    out << 0, -a[2], a[1], a[2], 0, -a[0], -a[1], a[0], 0;
    return out;
}
// C(b) w and g.C(b) w as matrices of b, and as one of w.
Matrix3 change_by_turn(const Vector3& w) {
    Matrix3 out;
    out << 0, 0, w[1], 0, 0, -w[0], 0, w[0], 0;
    return out;
}
Matrix3 change_of_rates(const Vector3& b) {
    Matrix3 out;
    out << 0, b[2], 0, -b[2], 0, 0, b[1], 0, 0;
    return out;
}
Matrix3 weighted_change(const Vector3& g) {
    Matrix3 out;
    out << 0, 0, 0, g[2], 0, 0, -g[1], g[0], 0;
    return out;
}
// The Hessian of g.N(b, b) w.
Matrix3 weighted_bend(const Vector3& g, const Vector3& w) {
    Matrix3 out = Matrix3::Zero();
    out(1, 1) = g[0] * w[0];
    out(2, 2) = -g[0] * w[0] - g[1] * w[1];
    out(1, 2) = out(2, 1) = g[2] * w[1];
    return out;
}

// Power series in y = x^2, side by side: c, tau, each with its derivatives, cos(x/4) and sin(x/4)/x.
constexpr int n_terms = 12, n_series = 8;
using Series = Eigen::Array<double, n_series, 1>;
constexpr std::array<double, n_terms + 2> c_series{
    0.0833333333333333333,   0.00138888888888888889,  0.0000330687830687830688, 8.2671957671957672e-7,
    2.0876756987868099e-8,   5.28419013868749318e-10, 1.33825365306846788e-11,  3.38968029632258287e-13,
    8.58606205627784456e-15, 2.17486869855806187e-16, 5.50900282836022952e-18,  1.39544646858125233e-19,
    3.53470703962946753e-21, 8.95351742703754686e-23};
constexpr std::array<double, n_terms + 2> tau_series{0.125,
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
                                                     2.79089277081232254e-19,
                                                     7.06941407925893506e-21,
                                                     1.79070348540750937e-22};
constexpr auto all_series = [] {
    std::array<std::array<double, n_series>, n_terms> out{};
    double cosine = 1, sine = 0.25;
    for (int k = 0; k < n_terms; ++k) {
        out[k] = {c_series[k],
                  (k + 1) * c_series[k + 1],
                  (k + 2) * (k + 1) * c_series[k + 2],
                  tau_series[k],
                  (k + 1) * tau_series[k + 1],
                  (k + 2) * (k + 1) * tau_series[k + 2],
                  cosine,
                  sine};
        cosine /= -16.0 * (2 * k + 1) * (2 * k + 2);
        sine /= -16.0 * (2 * k + 2) * (2 * k + 3);
    }
    return out;
}();
constexpr double series_below = 1.0;  // of y

void multiply(const double* q, double w, double x, double y, double z, double* out) {
    const double p[4] = {q[0] * w - q[1] * x - q[2] * y - q[3] * z, q[0] * x + q[1] * w + q[2] * z - q[3] * y,
                         q[0] * y + q[2] * w + q[3] * x - q[1] * z, q[0] * z + q[3] * w + q[1] * y - q[2] * x};
    // Of unit length to rounding, and so kept; what is beyond one counts alike above and below it.
    const double beyond = (p[0] - 1.0) * (p[0] + 1.0) + p[1] * p[1] + p[2] * p[2] + p[3] * p[3];
    for (int i = 0; i < 4; ++i) out[i] = p[i] - 0.5 * beyond * p[i];
}

}  // namespace

void turn_by(const double* q, const double* phi, double part, double* out) {
    const double square = part * part * (phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]),
                 half = 0.5 * std::sqrt(square);
    const double f = part * (square < 1e-8 ? 0.5 - square / 48.0 : 0.5 * std::sin(half) / half);
    multiply(q, std::cos(half), f * phi[0], f * phi[1], f * phi[2], out);
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
        Series sum = Eigen::Map<const Series>(all_series[n_terms - 1].data());
        for (int k = n_terms - 2; k >= 0; --k) sum = sum * y + Eigen::Map<const Series>(all_series[k].data());
        c_ = sum[0], c1_ = sum[1], c2_ = sum[2], tau_ = sum[3], tau1_ = sum[4], tau2_ = sum[5];
        cosine_ = sum[6], sine_ = sum[7];
        return;
    }
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
    cosine_ = std::cos(0.25 * x);
    sine_ = std::sin(0.25 * x) / x;
}

void Turning::turn_half(const double* q, double* out) const {
    multiply(q, cosine_, sine_ * phi_.x, sine_ * phi_.y, sine_ * phi_.z, out);
}
void Turning::turn_whole(const double* q, double* out) const {
    const double twice = 2.0 * cosine_ * sine_;
    multiply(q, 1.0 - 2.0 * sine_ * sine_ * dot(phi_, phi_), twice * phi_.x, twice * phi_.y, twice * phi_.z, out);
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

void Turning::turn_rows(double* start, double* end) const {
    const Vec3<double> g = torque(start, end),
                       h{0.5 * (end[0] - start[0]), 0.5 * (end[1] - start[1]), 0.5 * (end[2] - start[2])};
    const Vec3<double> across = cross(h, phi_), half = 0.5 * (g + across);
    const Vec3<double> by_d = h + tau_ * cross(g, phi_) + c_ * cross(across, phi_);
    const Vec3<double> a = half - by_d, b = half + by_d;
    start[0] = a.x, start[1] = a.y, start[2] = a.z;
    end[0] = b.x, end[1] = b.y, end[2] = b.z;
}

Matrix3 Turning::by_d() const {
    const Vector3 p = column(phi_);
    Matrix3 out = c_ * p * p.transpose();
    out.diagonal().array() += 1.0 - c_ * p.squaredNorm();
    return out;
}

Matrix6 Turning::slope() const {
    const Vector3 p = column(phi_);
    const Matrix3 P = crossing(p), C = change_by_turn(p), xi_by_d = tau_ * P;
    Matrix6 out;
    out << Matrix3::Identity(), xi_by_d, P - C, by_d() - C * xi_by_d;
    return out;
}

// With d = by_d u and so on, the second changes of theta and phi along exp are those of
//
//   h.phi + g.theta:   1/2 u'P'Y u - 1/2 g.(C xi) xi,
//   Y u = s x h + c ((p x d) x h + d x (h x p)) + 2 c' p (h.p x (p x d)) + tau d x g + 2 tau' p (g.p x d),
//
// c' and tau' by x^2; F holds (C xi) xi.
Matrix6 Turning::along(const Vector3& g, const Vector3& h, const Matrix3& twice_theta, const Matrix3& theta_phi,
                       const Matrix3& twice_phi) const {
    const Vector3 p = column(phi_), hp = h.cross(p), gp = g.cross(p), hpp = hp.cross(p);
    const Matrix3 P = crossing(p), H = crossing(h), phi_by_d = by_d(), xi_by_d = tau_ * P;
    Matrix3 F;
    F << 0, g[2], -g[1], g[2], 0, g[0], -g[1], g[0], 0;
    // c (H P + [hp]) with [hp] = p h' - h p', H P = p h' - (h.p) 1
    Matrix3 Y = -c_ * (2.0 * p * h.transpose() - h * p.transpose()) + p * (2.0 * (c1_ * hpp + tau1_ * gp)).transpose();
    Y.diagonal().array() += c_ * h.dot(p);
    Y -= tau_ * crossing(g);
    const Matrix3 own = 0.5 * twice_theta - 0.25 * F, own_by_d = own * xi_by_d;
    const Matrix3 left_s = 0.5 * (twice_phi * P - H) + theta_phi.transpose();
    const Matrix3 left_d = 0.5 * (twice_phi * phi_by_d + Y) + theta_phi.transpose() * xi_by_d;
    const Matrix3 ss = own - P * left_s, sd = own_by_d - P * left_d;
    const Matrix3 ds = phi_by_d * left_s - xi_by_d * own, dd = phi_by_d * left_d - xi_by_d * own_by_d;
    Matrix6 out;
    out << ss + ss.transpose(), sd + ds.transpose(), ds + sd.transpose(), dd + dd.transpose();
    return out;
}

// nu = J^-1 phi.
Matrix6 Turning::bend(const Vector3& g, const Vector3& h) const {
    const Vector3 p = column(phi_);
    return along(g - change_by_turn(p).transpose() * h, h, weighted_bend(h, p), -weighted_change(h), Matrix3::Zero());
}

// theta moves by J^-1 xi and nu by J^-1 eta - C(xi) phi + ..., of which xi and eta = dphi depend on phi.
TurnedField::TurnedField(const Turning& turning, const Vector3& mu, const Vector3& w)
    : at_(turning), phi_(column(turning.phi_)), s_(0.5 * (mu + w)), d_(w - mu) {
    const double c = at_.c_, tau = at_.tau_;
    const Vector3 across = phi_.cross(d_), twice = phi_.cross(across);
    xi_ = s_ + tau * across;
    eta_ = d_ + phi_.cross(s_) + c * twice;
    xi_phi_ = across * (2.0 * at_.tau1_ * phi_).transpose() - tau * crossing(d_);
    eta_phi_ = twice * (2.0 * at_.c1_ * phi_).transpose() - crossing(s_ + c * across);
    // -c [phi] [d] = -c (d phi' - (phi.d) 1)
    eta_phi_ -= c * d_ * phi_.transpose();
    eta_phi_.diagonal().array() += c * phi_.dot(d_);
    const Matrix3 C = change_by_turn(phi_);
    nu_theta_ = C * change_by_turn(xi_) - change_by_turn(eta_);
    // 2 N(., xi) phi
    nu_theta_(0, 1) += phi_[0] * xi_[1];
    nu_theta_(0, 2) -= phi_[0] * xi_[2];
    nu_theta_(1, 2) -= phi_[1] * xi_[2];
    nu_theta_(2, 1) += phi_[1] * xi_[2];
    nu_theta_(2, 2) += phi_[1] * xi_[1];
    nu_phi_ = eta_phi_ - change_of_rates(xi_) - C * xi_phi_;
}

Matrix6 TurnedField::slope() const {
    const Matrix3 P = crossing(phi_), phi_by_d = at_.by_d(), xi_by_d = at_.tau_ * P, theta = -change_by_turn(xi_);
    Matrix6 out;
    out << theta + xi_phi_ * P, theta * xi_by_d + xi_phi_ * phi_by_d, nu_theta_ + nu_phi_ * P,
        nu_theta_ * xi_by_d + nu_phi_ * phi_by_d;
    return out;
}

Vector3 TurnedField::nu() const { return eta_ - change_by_turn(phi_) * xi_; }

Matrix6 TurnedField::bend(const Vector3& g, const Vector3& h, const Vector3& of_theta, const Vector3& of_nu) const {
    const double x = phi_[0], y = phi_[1];
    const Vector3 by_xi = g - change_by_turn(phi_).transpose() * h;  // at theta = 0
    const Vector3 by_theta = nu_theta_.transpose() * h - change_by_turn(xi_).transpose() * g + of_theta -
                             change_by_turn(phi_).transpose() * of_nu,
                  by_phi = xi_phi_.transpose() * g + nu_phi_.transpose() * h + of_nu;
    Matrix3 twice_theta = weighted_bend(by_xi, xi_) + weighted_bend(h, eta_) + weighted_bend(of_nu, phi_);
    twice_theta(1, 1) -= 2.0 * h[2] * (y * xi_[0] + x * xi_[1]) + h[0] * y * xi_[2];
    twice_theta(2, 2) += h[2] * (2.0 * y * xi_[0] + x * xi_[1]) + h[0] * y * xi_[2] - h[1] * x * xi_[2];
    const double across = h[0] * (2.0 * x * xi_[0] - y * xi_[1]) + h[1] * y * xi_[0] + h[2] * x * xi_[2];
    twice_theta(1, 2) += across;
    twice_theta(2, 1) += across;

    Matrix3 theta_phi = (weighted_bend(h, phi_) - weighted_change(by_xi)) * xi_phi_ - weighted_change(h) * eta_phi_ -
                        weighted_change(of_nu);
    theta_phi(1, 0) += h[0] * xi_[1] - h[1] * xi_[0];
    theta_phi(1, 1) += h[0] * xi_[0] + h[2] * xi_[2];
    theta_phi(2, 0) -= h[0] * xi_[2] + h[2] * xi_[0];
    theta_phi(2, 1) += h[2] * xi_[1] - h[1] * xi_[2];

    // by_xi.xi = tau q + ... and h.eta = c r + ...
    const Vector3 e = d_.cross(by_xi);
    const double ph = phi_.dot(h), pd = phi_.dot(d_), dh = d_.dot(h), q = phi_.dot(e),
                 r = pd * ph - phi_.squaredNorm() * dh;
    const Vector3 r_phi = d_ * ph + h * pd - 2.0 * dh * phi_;
    const Vector3 by_p = 2.0 * (at_.tau1_ * e + at_.c1_ * r_phi + (at_.tau2_ * q + at_.c2_ * r) * phi_);
    const Matrix3 half =
        phi_ * by_p.transpose() + at_.c_ * d_ * h.transpose() - xi_phi_.transpose() * weighted_change(h);
    Matrix3 twice_phi = half + half.transpose();
    twice_phi.diagonal().array() += 2.0 * (at_.tau1_ * q + at_.c1_ * r - at_.c_ * dh);
    return at_.along(by_theta, by_phi, twice_theta, theta_phi, twice_phi);
}

Matrix6 by_ends(const Matrix6& form) {
    const Matrix3 ss = 0.25 * form.topLeftCorner<3, 3>(), sd = 0.5 * form.topRightCorner<3, 3>(),
                  ds = 0.5 * form.bottomLeftCorner<3, 3>(), dd = form.bottomRightCorner<3, 3>();
    Matrix6 out;
    out << ss - sd - ds + dd, ss + sd - ds - dd, ss - sd + ds - dd, ss + sd + ds + dd;
    return out;
}

Matrix3 TurnedAxis::slope() const { return -change_by_turn(w); }
Matrix3 TurnedAxis::bend(const Vector3& g) const {
    Matrix3 out;
    const double xy = 0.5 * (w[1] * g[0] - w[0] * g[1]), xz = -0.5 * w[0] * g[2], yz = w[1] * g[2];
    out << 0, xy, xz, xy, w[0] * g[0], yz, xz, yz, -w[0] * g[0] - w[1] * g[1];
    return out;
}

// theta = a - C(a) a/2 along exp.
Matrix3 symmetric_chart_bend(const Vector3& g) {
    Matrix3 out;
    out << 0, -0.5 * g[2], 0.5 * g[1], -0.5 * g[2], 0, -0.5 * g[0], 0.5 * g[1], -0.5 * g[0], 0;
    return out;
}
Matrix3 chart_bend(const Vector3& g) { return symmetric_chart_bend(g) - 0.5 * crossing(g); }

}  // namespace leastaction
