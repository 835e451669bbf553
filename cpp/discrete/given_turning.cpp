#include <cmath>

#include "discrete/turning.hpp"

namespace leastaction {

namespace {

using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;

// A function of six numbers to second order about a point.
struct Jet {
    double v = 0;
    Vector6 g = Vector6::Zero();
    Matrix6 h = Matrix6::Zero();

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
Jet operator+(const Jet& a, const Jet& b) {
    Jet out(a.v + b.v);
    out.g = a.g + b.g;
    out.h = a.h + b.h;
    return out;
}
Jet operator-(const Jet& a, const Jet& b) {
    Jet out(a.v - b.v);
    out.g = a.g - b.g;
    out.h = a.h - b.h;
    return out;
}
Jet operator*(double s, const Jet& a) {
    Jet out(s * a.v);
    out.g = s * a.g;
    out.h = s * a.h;
    return out;
}
Jet operator*(const Jet& a, const Jet& b) {
    Jet out(a.v * b.v);
    out.g = a.v * b.g + b.v * a.g;
    out.h = a.v * b.h + b.v * a.h + a.g * b.g.transpose() + b.g * a.g.transpose();
    return out;
}
using Jets = Vec3<Jet>;

Jets lifted(const Vec3<double>& a) { return {Jet(a.x), Jet(a.y), Jet(a.z)}; }
Matrix6 weighted(const Jets& of, const Eigen::Vector3d& g) { return g[0] * of.x.h + g[1] * of.y.h + g[2] * of.z.h; }

// The turn over a part of the step, and its change by (alpha, e) to second order.
struct GivenPart {
    Jets turn;
    GivenPart(const Vec3<double>& at, double part) {
        const double zero[4] = {1, 0, 0, 0}, whole[3] = {at.x, at.y, at.z};
        double quaternion[4];
        turn_by(zero, whole, part, quaternion);
        Jets alpha;
        Jet* each[3] = {&alpha.x, &alpha.y, &alpha.z};
        for (int i = 0; i < 3; ++i) {
            const Vec3<double> a = turned(quaternion, {double(i == 0), double(i == 1), double(i == 2)}, -1.0);
            each[0]->g[i] = a.x, each[1]->g[i] = a.y, each[2]->g[i] = a.z;
        }
        const Jets change{Jet::variable(3), Jet::variable(4), Jet::variable(5)};
        const Vec3<double> x = part * at;
        const Jets e = part * change, p = lifted(x), across = cross(p, e), twice = cross(p, across);
        double f, f1, g, g1;  // dexp = 1 - f [x] + g [x]^2, by y = x^2
        slopes(dot(x, x), f, f1, g, g1);
        const Jet along = dot(p, e);
        const Jets beta =
            e - f * across + g * twice + 0.5 * g * cross(e, across) - (f1 * along) * across + (g1 * along) * twice;
        turn = alpha + beta + 0.5 * cross(alpha, beta);
    }

private:
    static void slopes(double y, double& f, double& f1, double& g, double& g1) {
        if (y < 1.0) {
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

// Of (alpha, e) as of (s, d): alpha = s - d/2, e = s + d/2.
Matrix6 from_given() {
    Matrix6 out;
    const auto one = Eigen::Matrix3d::Identity();
    out << one, -0.5 * one, one, 0.5 * one;
    return out;
}

Turning::Matrix6 small(const Matrix6& m) {
    const auto block = [&](int row, int column) {
        Turning::Matrix3 out;
        for (int i = 0; i < 3; ++i)
            out.rows[i] =
                Turning::Matrix3::Row{m(row + i, column), m(row + i, column + 1), m(row + i, column + 2), 0.0};
        return out;
    };
    return {block(0, 0), block(0, 3), block(3, 0), block(3, 3)};
}

}  // namespace

Turning::Matrix6 GivenTurning::slope(double dt) const {
    const GivenPart half(phi_, 0.5);
    Matrix6 out = Matrix6::Zero();
    out.topRows<3>() << half.turn.x.g.transpose(), half.turn.y.g.transpose(), half.turn.z.g.transpose();
    out.bottomRightCorner<3, 3>().setIdentity();
    out *= from_given();
    out.topRightCorner<3, 3>() *= dt;
    out.bottomLeftCorner<3, 3>() /= dt;
    return small(out);
}
Matrix6 GivenTurning::turn_bend(const Vec3<double>& g) const {
    const Matrix6 bend = weighted(GivenPart(phi_, 0.5).turn, {g.x, g.y, g.z});
    return from_given().transpose() * bend * from_given();
}
Turning::Matrix6 GivenTurning::bend(const Vec3<double>& g, const Vec3<double>& h) const {
    const Turning::Matrix6 by = slope(), missing{{}, {}, crossing(0.5 * h), {}},
                           out = transposed_product(by, missing * by);
    return small(turn_bend(g)) + out + transposed(out);
}
Turning::Matrix6 GivenTurning::bend_of_elements(const Vec3<double>& g, const Vec3<double>& h) const {
    const OfChart chart(phi_, g, h);
    return small(turn_bend(chart.by_theta)) + chart.by(slope());
}
GivenTurning::Matrix36 GivenTurning::end_slope() const {
    const GivenPart whole(phi_, 1.0);
    Matrix36 out;
    out << whole.turn.x.g.transpose(), whole.turn.y.g.transpose(), whole.turn.z.g.transpose();
    return out;
}
Matrix6 GivenTurning::end_bend(const Eigen::Vector3d& g) const { return weighted(GivenPart(phi_, 1.0).turn, g); }

}  // namespace leastaction
