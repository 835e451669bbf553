#include "continuous/turned.hpp"

#include "numerics/dual.hpp"

namespace leastaction {

namespace {

using Vector = Vec3<double>;

Vector unit(int i) { return {double(i == 0), double(i == 1), double(i == 2)}; }
Eigen::Vector3d column(const Vector& a) { return {a.x, a.y, a.z}; }

// J(theta) nu and J^-1 w to second order in theta, and K.
template <class T>
struct Chart {
    explicit Chart(const Vec3<T>& turn) : angles(turn - 0.5 * turned_rates(turn, turn)) {
        yy = 0.5 * (angles.y * angles.y);
        zz = 0.5 * (angles.z * angles.z);
    }
    Vec3<T> angles;
    T yy, zz;

    Vec3<T> rates(const Vec3<T>& w) const {
        const T &y = angles.y, &z = angles.z;
        return {w.x + (yy - zz) * w.x - z * w.y, w.y - zz * w.y + z * w.x, w.z - y * w.x + y * (z * w.y)};
    }
    Vec3<T> turned(const Vec3<T>& nu) const {
        const T &y = angles.y, &z = angles.z;
        return {nu.x - (yy + zz) * nu.x + z * nu.y, nu.y - zz * nu.y - z * nu.x, nu.z + y * nu.x};
    }
    Vec3<T> change(const Vec3<T>& nu) const {
        const T &y = angles.y, &z = angles.z;
        const T xy = nu.x * nu.y, xz = nu.x * nu.z, yz = nu.y * nu.z;
        return {yz - zz * yz - y * xy - z * xz, (yy + zz) * xz - xz + z * (y * xy) - z * yz, xy - yy * xy};
    }
};

}  // namespace

TurnedPoint::Matrix3 TurnedPoint::rates() const {
    Matrix3 out;
    for (int i = 0; i < 3; ++i) out.col(i) = -column(turned_rates(unit(i), w));
    return out;
}

TurnedPoint::Matrix36 TurnedPoint::slope() const {
    Matrix36 out;
    for (int i = 0; i < 3; ++i) {
        const Vector e = unit(i), by_w = turned_rates(e, w) + turned_rates(w, e), rate = -turned_rates(e, w);
        // (D2J e w) w, and K's part by theta'
        const Vector bent{-(e.y * w.y + e.z * w.z) * w.x, -e.z * w.z * w.y, 0.0};
        out.col(i) = column(turned_rates(e, a) + bent + turned_rates(rate, w) + turned_rates(w, rate));
        out.col(3 + i) = column(by_w);
    }
    return out;
}

TurnedPoint::Matrix3 TurnedPoint::mixed(const Vec3<double>& z) {
    Matrix3 out;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) out(i, j) = dot(z, turned_rates(unit(i), unit(j)));
    return out;
}

TurnedPoint::Matrix6 TurnedPoint::bend(const Vec3<double>& z, const Vec3<double>& g, const Vec3<double>& h) const {
    Matrix6 out;
    for (int i = 0; i < 6; ++i)
        for (int j = 0; j <= i; ++j) {
            const auto moved = [&](int k, double value) {
                return HyperDual{{value, double(k == i)}, {double(k == j), 0.0}};
            };
            const Vec3<HyperDual> turn{moved(0, 0.0), moved(1, 0.0), moved(2, 0.0)},
                rate{moved(3, w.x), moved(4, w.y), moved(5, w.z)}, held{a.x, a.y, a.z};
            const Chart<HyperDual> chart(turn);
            const Vec3<HyperDual> rates = chart.rates(rate);
            const HyperDual sum =
                dot(z, chart.turned(held) + chart.change(rates)) + dot(g, chart.angles) + dot(h, rates);
            out(i, j) = out(j, i) = sum.d.d;
        }
    return out;
}

}  // namespace leastaction
