#include "discrete/turning.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic ignored "-Wpsabi"  // rows of four are passed within this file alone
#endif

namespace leastaction {

namespace {

using Vector = Vec3<double>;
using Matrix3 = Turning::Matrix3;
using Matrix6 = Turning::Matrix6;

using Row = Matrix3::Row;
Row row(double x, double y, double z) { return Row{x, y, z, 0.0}; }
Row row(const Vector& a) { return row(a.x, a.y, a.z); }
const Matrix3 identity{{row(1, 0, 0), row(0, 1, 0), row(0, 0, 1)}};
Matrix3 outer(const Vector& a, const Vector& b) {
    const Row of_b = row(b);
    return {{a.x * of_b, a.y * of_b, a.z * of_b}};
}
void add_diagonal(Matrix3& to, double x) { to = to + Matrix3{{row(x, 0, 0), row(0, x, 0), row(0, 0, x)}}; }
// The product of a x with a matrix.
Matrix3 crossed(const Vector& a, const Matrix3& m) {
    return {{a.y * m.rows[2] - a.z * m.rows[1], a.z * m.rows[0] - a.x * m.rows[2], a.x * m.rows[1] - a.y * m.rows[0]}};
}
Vector times(const Vector& a, const Matrix3& m) {
    const Row out = a.x * m.rows[0] + a.y * m.rows[1] + a.z * m.rows[2];
    return {out[0], out[1], out[2]};
}
// g.C(b) w as a form of b, by rows, and w; its product with a matrix; and the Hessian of g.N(b, b) w.
Matrix3 change_form(const Vector& g) { return {{row(0, 0, 0), row(g.z, 0, 0), row(-g.y, g.x, 0)}}; }
Matrix3 change_form(const Vector& g, const Matrix3& m) {
    return {{row(0, 0, 0), g.z * m.rows[0], g.x * m.rows[1] - g.y * m.rows[0]}};
}
Matrix3 bend_form(const Vector& g, const Vector& w) {
    const double yz = g.z * w.y;
    return {{row(0, 0, 0), row(0, g.x * w.x, yz), row(0, yz, -g.x * w.x - g.y * w.y)}};
}
// The Hessian along exp of g.theta, theta = a - C(a) a/2.
Matrix3 chart_form(const Vector& g) {
    const Vector f = 0.5 * g;
    return {{row(0, -f.z, f.y), row(-f.z, 0, -f.x), row(f.y, -f.x, 0)}};
}
Eigen::Matrix3d plain(const Matrix3& m) {
    Eigen::Matrix3d out;
    for (int i = 0; i < 3; ++i) out.row(i) << m(i, 0), m(i, 1), m(i, 2);
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
constexpr double series_below = 1.0;  // of y, to rounding; and with half of the terms
constexpr double half_of_series_below = 0.0625;

void multiply(const double* q, double w, double x, double y, double z, double* p) {
    p[0] = q[0] * w - q[1] * x - q[2] * y - q[3] * z, p[1] = q[0] * x + q[1] * w + q[2] * z - q[3] * y;
    p[2] = q[0] * y + q[2] * w + q[3] * x - q[1] * z, p[3] = q[0] * z + q[3] * w + q[1] * y - q[2] * x;
}
// Of unit length to rounding, and so kept; what is beyond one counts alike above and below it.
void keep_unit(double* p) {
    const double beyond = (p[0] - 1.0) * (p[0] + 1.0) + p[1] * p[1] + p[2] * p[2] + p[3] * p[3];
    for (int i = 0; i < 4; ++i) p[i] -= 0.5 * beyond * p[i];
}

}  // namespace

Matrix3 change_by_turn(const Vector& w) { return {{row(0, 0, w.y), row(0, 0, -w.x), row(0, w.x, 0)}}; }
Vector weighted_change(const Vector& g, const Vector& w) { return {0.0, w.x * g.z, w.y * g.x - w.x * g.y}; }

Matrix3 crossing(const Vector& a) { return {{row(0, -a.z, a.y), row(a.z, 0, -a.x), row(-a.y, a.x, 0)}}; }

void turn_by(const double* q, const double* phi, double part, double* out) {
    const double square = part * part * (phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]),
                 half = 0.5 * std::sqrt(square);
    const double f = part * (square < 1e-8 ? 0.5 - square / 48.0 : 0.5 * std::sin(half) / half);
    double turned[4];
    multiply(q, std::cos(half), f * phi[0], f * phi[1], f * phi[2], turned);
    keep_unit(turned);
    std::copy_n(turned, 4, out);
}

void rotation_between(const double* a, const double* b, double* out) {
    const double w = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3];
    const double v[3] = {a[0] * b[1] - a[1] * b[0] - a[2] * b[3] + a[3] * b[2],
                         a[0] * b[2] - a[2] * b[0] - a[3] * b[1] + a[1] * b[3],
                         a[0] * b[3] - a[3] * b[0] - a[1] * b[2] + a[2] * b[1]};
    const double square = v[0] * v[0] + v[1] * v[1] + v[2] * v[2], per_w = 1.0 / w, y = square * per_w * per_w;
    double f = 2.0 * per_w;  // times atan(x)/x with x^2 = y, the shorter way
    if (y < 1.0 / 64.0) {
        const double yy = y * y;
        const double even = 1.0 + yy * (1.0 / 5.0 + yy * (1.0 / 9.0 + yy * (1.0 / 13.0 + yy * (1.0 / 17.0))));
        const double odd = 1.0 / 3.0 + yy * (1.0 / 7.0 + yy * (1.0 / 11.0 + yy * (1.0 / 15.0)));
        f *= even - y * odd;
    } else {
        const double sine = std::sqrt(square);
        f = std::copysign(2.0 * std::atan2(sine, std::abs(w)) / sine, w);
    }
    for (int i = 0; i < 3; ++i) out[i] = f * v[i];
}

Vec3<double> turned(const double* quaternion, const Vec3<double>& a, double sense) {
    const Vec3<double> axis{quaternion[1], quaternion[2], quaternion[3]}, across = 2.0 * cross(axis, a);
    return a + (sense * quaternion[0]) * across + cross(axis, across);
}

Turning::Turning(const double* phi) : phi_{phi[0], phi[1], phi[2]} {
    const double y = dot(phi_, phi_);
    if (y < series_below) {
        const int last = (y < half_of_series_below ? n_terms / 2 : n_terms) - 1;
        Series sum = Eigen::Map<const Series>(all_series[last].data());
        for (int k = last - 1; k >= 0; --k) sum = sum * y + Eigen::Map<const Series>(all_series[k].data());
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
    keep_unit(out);
}
void Turning::turn_whole(const double* q, double* out) const {
    const double twice = 2.0 * cosine_ * sine_;
    multiply(q, 1.0 - 2.0 * sine_ * sine_ * dot(phi_, phi_), twice * phi_.x, twice * phi_.y, twice * phi_.z, out);
    keep_unit(out);
}

void Turning::end_to_phi(double* beta) const {
    const Vec3<double> b{beta[0], beta[1], beta[2]}, turned = cross(phi_, b);
    const Vec3<double> change = b + 0.5 * turned + c_ * cross(phi_, turned);
    beta[0] = change.x, beta[1] = change.y, beta[2] = change.z;
}

void Turning::turn_rows(double* start, double* end) const {
    const Vec3<double> g{start[0] + end[0], start[1] + end[1], start[2] + end[2]},
        h{0.5 * (end[0] - start[0]), 0.5 * (end[1] - start[1]), 0.5 * (end[2] - start[2])};
    const Vec3<double> across = cross(h, phi_), half = 0.5 * (g + across);
    const Vec3<double> by_d = h + tau_ * cross(g, phi_) + c_ * cross(across, phi_);
    const Vec3<double> a = half - by_d, b = half + by_d;
    start[0] = a.x, start[1] = a.y, start[2] = a.z;
    end[0] = b.x, end[1] = b.y, end[2] = b.z;
}

Matrix3 Turning::phi_by_d() const {
    Matrix3 out = outer(c_ * phi_, phi_);
    add_diagonal(out, 1.0 - c_ * dot(phi_, phi_));
    return out;
}

// phi_by_d() times a matrix.
Matrix3 Turning::by_phi(const Matrix3& m) const {
    const Row along = phi_.x * m.rows[0] + phi_.y * m.rows[1] + phi_.z * m.rows[2];
    const double kept = 1.0 - c_ * dot(phi_, phi_);
    return {{kept * m.rows[0] + (c_ * phi_.x) * along, kept * m.rows[1] + (c_ * phi_.y) * along,
             kept * m.rows[2] + (c_ * phi_.z) * along}};
}

Matrix6 Turning::slope(double dt) const {
    return {identity, crossing((dt * tau_) * phi_), crossing((1.0 / dt) * phi_), phi_by_d()};
}

// With eta = P u and xi = s + tau p x d, the second changes of theta and phi along exp are those of
//
//   h.phi + g.theta:   1/2 u'P'Y u,
//   Y u = s x h + c ((p x d) x h + d x (h x p)) + 2 c' p (h.p x (p x d)) + tau d x g + 2 tau' p (g.p x d),
//
// c' and tau' by x^2.
Matrix6 Turning::along(const Vector& g, const Vector& h, const Matrix3& phi_theta, const Matrix3* twice_phi) const {
    const Vector &p = phi_, hp = cross(h, p), gp = cross(g, p), hpp = cross(hp, p);
    const Matrix3 P = crossing(p);
    // -c ([h] [p] + [h x p]) with [h] [p] = p h' - (h.p) 1 and [h x p] = p h' - h p'
    Matrix3 Y = outer(p, 2.0 * (c1_ * hpp + tau1_ * gp - c_ * h)) + outer(c_ * h, p) - tau_ * crossing(g);
    add_diagonal(Y, c_ * dot(h, p));
    Matrix3 left_s = phi_theta - crossing(0.5 * h), left_d = 0.5 * Y + tau_ * (phi_theta * P);
    if (twice_phi) {
        const Matrix3 half = 0.5 * *twice_phi;
        left_s = left_s + half * P;
        left_d = left_d + half * phi_by_d();
    }
    const Matrix3 ss = -1.0 * crossed(p, left_s), dd = by_phi(left_d);
    const Matrix3 both = transposed(by_phi(left_s)) - crossed(p, left_d);
    return {ss + transposed(ss), both, transposed(both), dd + transposed(dd)};
}

Matrix6 Turning::bend(const Vector& g, const Vector& h) const { return along(g, h, crossing(0.5 * h), nullptr); }

OfChart::OfChart(const Vector& phi, const Vector& of_theta, const Vector& of_phi)
    : by_theta(of_theta - weighted_change(of_phi, phi)),
      twice_theta(bend_form(of_phi, phi) + chart_form(by_theta)),
      phi_theta(-1.0 * transposed(change_form(of_phi))) {}

Matrix6 OfChart::by(const Matrix6& slope) const {
    const Matrix6 half{0.5 * twice_theta, Matrix3{}, phi_theta, Matrix3{}};
    const Matrix6 out = transposed_product(slope, half * slope);
    return out + transposed(out);
}

TurnedField::TurnedField(const Turning& turning, const Vector& mu, const Vector& w)
    : at_(turning), s_(0.5 * (mu + w)), d_(w - mu) {
    const double c = at_.c_, tau = at_.tau_;
    const Vector &phi = at_.phi_, across = cross(phi, d_), twice = cross(phi, across);
    xi_ = s_ + tau * across;
    eta_ = d_ + cross(phi, s_) + c * twice;
    xi_phi_ = outer((2.0 * at_.tau1_) * across, phi) - crossing(tau * d_);
    // -c [phi] [d] = -c (d phi' - (phi.d) 1)
    eta_phi_ = outer((2.0 * at_.c1_) * twice - c * d_, phi) - crossing(s_ + c * across);
    add_diagonal(eta_phi_, c * dot(phi, d_));
}

Matrix6 TurnedField::slope() const {
    const Matrix3 P = crossing(at_.phi_), phi_d = at_.phi_by_d();
    return {xi_phi_ * P, xi_phi_ * phi_d, eta_phi_ * P, eta_phi_ * phi_d};
}

Matrix6 TurnedField::slope_in_turned_axes(const Matrix6& by, double dt) const {
    const Matrix3 turn = crossing(dt * xi_), xi = (dt * dt) * xi_phi_, eta = dt * eta_phi_;
    return {xi * by.ba - turn, xi * by.bb - turn * by.ab, eta * by.ba, eta * by.bb};
}

// g.xi = tau q + ... and h.eta = c r + ...
Matrix3 TurnedField::twice_phi(const Vector& g, const Vector& h) const {
    const Vector &phi = at_.phi_, e = cross(d_, g);
    const double ph = dot(phi, h), pd = dot(phi, d_), dh = dot(d_, h), q = dot(phi, e),
                 r = pd * ph - dot(phi, phi) * dh;
    const Vector r_phi = ph * d_ + pd * h - (2.0 * dh) * phi;
    const Vector by_p = 2.0 * (at_.tau1_ * e + at_.c1_ * r_phi + (at_.tau2_ * q + at_.c2_ * r) * phi);
    const Matrix3 half = outer(phi, by_p) + outer(at_.c_ * d_, h);
    Matrix3 out = half + transposed(half);
    add_diagonal(out, 2.0 * (at_.tau1_ * q + at_.c1_ * r - at_.c_ * dh));
    return out;
}

// With D_u the derivative along a turn u of the middle, u x xi what the axes of u turn by, and xi_u and eta_u what the field changes
// by along u: of products D_u D_v along the field (xi, eta) the symmetric part lacks
//
//   1/2 g.(v x xi_u + u x xi_v)   and, as these lack h.(u x phi_v),   1/2 (h'.(u x phi_v) + h.((u x xi + xi_u) x phi_v + u x eta_v))
//
// and what u and v in turn give, where h' is what h changes by along it.
Matrix6 TurnedField::bend(const Vector& g, const Vector& h, const Vector& along_theta, const Vector& along_phi) const {
    const Matrix3 across = crossing(h), missing = transposed_product(xi_phi_, across);
    const Matrix3 phi_theta = crossing(along_phi) - across * crossing(xi_) + transposed_product(eta_phi_, across) +
                              transposed_product(xi_phi_, crossing(g));
    const Matrix3 half = 0.5 * missing, twice = twice_phi(g, h) - half - transposed(half);
    return at_.along(along_theta + cross(xi_, g), times(g, xi_phi_) + times(h, eta_phi_) + along_phi, 0.5 * phi_theta,
                     &twice);
}

Matrix6 TurnedField::bend_of_elements(const Vector& g, const Vector& along_theta, const Vector& along_phi) const {
    OfChart chart(at_.phi_, along_theta - weighted_change(g, xi_), along_phi);
    chart.twice_theta = chart.twice_theta + bend_form(g, xi_);
    chart.phi_theta = chart.phi_theta - transposed(change_form(g, xi_phi_));
    const Matrix3 none{}, twice = twice_phi(g, {});
    return at_.along(chart.by_theta, times(g, xi_phi_) + along_phi, none, &twice) + chart.by(at_.slope());
}

Matrix6 by_ends(const Matrix6& form) {
    const Matrix3 ss = 0.25 * form.aa, sd = 0.5 * form.ab, ds = 0.5 * form.ba;
    const Matrix3 even = ss + form.bb, both = sd + ds, odd = ss - form.bb, turn = sd - ds;
    return {even - both, odd + turn, odd - turn, even + both};
}

Eigen::Matrix3d TurnedAxis::slope() const { return -plain(change_by_turn(w)); }
Eigen::Matrix3d TurnedAxis::bend(const Eigen::Vector3d& g) const {
    const double xy = 0.5 * (w.y * g[0] - w.x * g[1]), xz = -0.5 * w.x * g[2], yz = w.y * g[2];
    Eigen::Matrix3d out;
    out << 0, xy, xz, xy, w.x * g[0], yz, xz, yz, -w.x * g[0] - w.y * g[1];
    return out;
}

Eigen::Matrix3d symmetric_chart_bend(const Eigen::Vector3d& g) { return plain(chart_form({g[0], g[1], g[2]})); }
Eigen::Matrix3d chart_bend(const Eigen::Vector3d& g) {
    return symmetric_chart_bend(g) - 0.5 * plain(crossing({g[0], g[1], g[2]}));
}

}  // namespace leastaction
