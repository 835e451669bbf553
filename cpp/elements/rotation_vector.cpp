#include "elements/rotation_vector.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace leastaction {

namespace {

template <class T>
using Quaternion = std::array<T, 4>;

template <class T>
Quaternion<T> product(const Quaternion<T>& p, const Quaternion<T>& q) {
    return {
        p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3], p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
        p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1], p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0]};
}

// A turn by an angle about an axis, and its derivative by the angle.
template <class T>
Quaternion<T> turn(const T& angle, int axis, bool derived) {
    T s, c;
    sincos_of(T(0.5 * angle), s, c);
    Quaternion<T> out{};
    out[0] = derived ? T(-0.5 * s) : c;
    out[1 + axis] = derived ? T(0.5 * c) : s;
    return out;
}

constexpr int highest = 4;  // derivative of A: two on hyper-duals, and two more

// A and its derivatives.
std::array<double, highest + 1> angle_by_sine(double w) {
    std::array<double, highest + 1> A{};
    const double x = 1.0 - w;
    if (x < 0.3) {
        // 0.15 to the power of 24 is rounding, with the factors of a fourth derivative.
        double a = 1.0, power = 1.0;
        std::array<double, highest + 1> powers{};  // x^(n - k)
        for (int n = 0; n < 28; ++n) {
            for (int k = highest; k > 0; --k) powers[k] = powers[k - 1];
            powers[0] = power;
            double factor = 1.0;  // n!/(n - k)!, and the sign of d/dw = -d/dx
            for (int k = 0; k <= std::min(n, highest); ++k) {
                A[k] += a * factor * powers[k];
                factor *= -(n - k);
            }
            a *= (n + 1.0) / (2.0 * n + 3.0);
            power *= x;
        }
        return A;
    }
    const double square = (1.0 - w) * (1.0 + w);
    A[0] = std::acos(w) / std::sqrt(square);
    A[1] = (w * A[0] - 1.0) / square;
    for (int k = 2; k <= highest; ++k) A[k] = ((2 * k - 1) * w * A[k - 1] + (k - 1) * (k - 1) * A[k - 2]) / square;
    return A;
}

// Its k-th derivative at a scalar, from those at the plain number.
double derivative_at(const double* table, double) { return *table; }
template <class T>
Dual<T> derivative_at(const double* table, const Dual<T>& w) {
    return {derivative_at(table, w.v), derivative_at(table + 1, w.v) * w.d};
}

}  // namespace

RotationVector::RotationVector(int variable, int quaternion, int axis)
    : variable_(variable), quaternion_(quaternion), axis_(axis) {
    support_ = {variable, variable + 1, variable + 2};
}

template <class T>
void RotationVector::evaluate_on(const Placement<T>&, const T* q, Order order, LocalTaylor<T>& out) const {
    if constexpr (std::is_same_v<T, Lanes>) {  // one after the other
        LocalTaylor<double> one;
        out.gradient.resize(3);
        out.hessian.resize(9);
        for (int l = 0; l < lane_count; ++l) {
            double quaternion[4], theta[3];
            for (int i = 0; i < 4; ++i) quaternion[i] = q[quaternion_ + i][l];
            for (int i = 0; i < 3; ++i) theta[i] = q[variable_ + i][l];
            evaluate_at(quaternion, theta, order, one);
            out.value.set(l, one.value);
            out.scale.set(l, one.scale);
            for (int i = 0; i < 3 && order != Order::value; ++i) out.gradient[i].set(l, one.gradient[i]);
            for (int i = 0; i < 9 && order == Order::hessian; ++i) out.hessian[i].set(l, one.hessian[i]);
        }
    } else {
        evaluate_at(q + quaternion_, q + variable_, order, out);
    }
}

template <class T>
void RotationVector::evaluate_at(const T* quaternion, const T* theta, Order order, LocalTaylor<T>& out) const {
    const Quaternion<T> start{quaternion[0], quaternion[1], quaternion[2], quaternion[3]};
    // The rotation whose turns of the given axes are derived.
    const auto derived = [&](bool x, bool y, bool z) {
        return product(product(product(start, turn(theta[0], 0, x)), turn(theta[1], 1, y)), turn(theta[2], 2, z));
    };
    Quaternion<T> p = derived(false, false, false);
    const double side = value_of(p[0]) < 0.0 ? -1.0 : 1.0;
    const T w = side * p[0], v = side * p[1 + axis_];
    const std::array<double, highest + 1> A = angle_by_sine(std::min(value_of(w), 1.0));
    const T A0 = derivative_at(A.data(), w);
    out.value = 2.0 * (A0 * v);
    out.scale = std::abs(value_of(out.value));
    if (order == Order::value) return;

    const T A1 = derivative_at(A.data() + 1, w);
    std::array<T, 3> w_, v_;
    out.gradient.resize(3);
    for (int i = 0; i < 3; ++i) {
        p = derived(i == 0, i == 1, i == 2);
        w_[i] = side * p[0];
        v_[i] = side * p[1 + axis_];
        out.gradient[i] = 2.0 * (A1 * v * w_[i] + A0 * v_[i]);
    }
    if (order == Order::gradient) return;

    const T A2 = derivative_at(A.data() + 2, w);
    out.hessian.resize(9);
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j <= i; ++j) {
            T w_ij = -0.25 * w, v_ij = -0.25 * v;
            if (i != j) {
                p = derived(i == 0 || j == 0, i == 1 || j == 1, i == 2 || j == 2);
                w_ij = side * p[0];
                v_ij = side * p[1 + axis_];
            }
            const T value = A2 * v * w_[i] * w_[j] + A1 * (w_[i] * v_[j] + w_[j] * v_[i]) + A1 * v * w_ij + A0 * v_ij;
            out.hessian[i * 3 + j] = out.hessian[j * 3 + i] = 2.0 * value;
        }
}

LEASTACTION_ON_ANY_SCALAR(RotationVector);

}  // namespace leastaction
