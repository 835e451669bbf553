// Division and the elementary functions of dual numbers, which dual.hpp does not need for the kernel.
//
// Each states its derivative on the generic scalar, so they nest: Dual<Dual<double>> works as well. A value that is
// not finite is passed on as it is.
#pragma once

#include <cmath>

#include "numerics/dual.hpp"

namespace leastaction {

template <class T>
Dual<T> operator/(const Dual<T>& a, const Dual<T>& b) {
    const T quotient = a.v / b.v;
    return {quotient, (a.d - quotient * b.d) / b.v};
}
template <class T>
Dual<T> operator/(const Dual<T>& a, double b) {
    return {a.v / b, a.d / b};
}
template <class T>
Dual<T> operator/(double a, const Dual<T>& b) {
    const T quotient = a / b.v;
    return {quotient, -(quotient * b.d) / b.v};
}

template <class T>
Dual<T> sqrt(const Dual<T>& x) {
    using std::sqrt;
    const T root = sqrt(x.v);
    return {root, 0.5 * x.d / root};
}
template <class T>
Dual<T> exp(const Dual<T>& x) {
    using std::exp;
    const T value = exp(x.v);
    return {value, value * x.d};
}
template <class T>
Dual<T> log(const Dual<T>& x) {
    using std::log;
    return {log(x.v), x.d / x.v};
}
// A constant real exponent; the base must be positive unless the exponent is a whole number.
template <class T>
Dual<T> pow(const Dual<T>& x, double exponent) {
    using std::pow;
    if (exponent == 0.0) return {1.0, 0.0};  // at x = 0 too, where the rule below has no value
    return {pow(x.v, exponent), exponent * pow(x.v, exponent - 1.0) * x.d};
}

template <class T>
Dual<T> sin(const Dual<T>& x) {
    Dual<T> s, c;
    sincos_of(x, s, c);
    return s;
}
template <class T>
Dual<T> cos(const Dual<T>& x) {
    Dual<T> s, c;
    sincos_of(x, s, c);
    return c;
}
template <class T>
Dual<T> tan(const Dual<T>& x) {
    using std::tan;
    const T value = tan(x.v);
    return {value, (1.0 + value * value) * x.d};
}
template <class T>
Dual<T> asin(const Dual<T>& x) {
    using std::asin;
    using std::sqrt;
    return {asin(x.v), x.d / sqrt((1.0 - x.v) * (1.0 + x.v))};
}
template <class T>
Dual<T> acos(const Dual<T>& x) {
    using std::acos;
    using std::sqrt;
    return {acos(x.v), -x.d / sqrt((1.0 - x.v) * (1.0 + x.v))};
}
template <class T>
Dual<T> atan(const Dual<T>& x) {
    using std::atan;
    return {atan(x.v), x.d / (1.0 + x.v * x.v)};
}
template <class T>
Dual<T> atan2(const Dual<T>& y, const Dual<T>& x) {
    using std::atan2;
    return {atan2(y.v, x.v), (x.v * y.d - y.v * x.d) / (x.v * x.v + y.v * y.v)};
}

template <class T>
Dual<T> sinh(const Dual<T>& x) {
    using std::cosh;
    using std::sinh;
    return {sinh(x.v), cosh(x.v) * x.d};
}
template <class T>
Dual<T> cosh(const Dual<T>& x) {
    using std::cosh;
    using std::sinh;
    return {cosh(x.v), sinh(x.v) * x.d};
}
template <class T>
Dual<T> tanh(const Dual<T>& x) {
    using std::tanh;
    const T value = tanh(x.v);
    return {value, (1.0 - value * value) * x.d};
}
template <class T>
Dual<T> asinh(const Dual<T>& x) {
    using std::asinh;
    using std::sqrt;
    return {asinh(x.v), x.d / sqrt(1.0 + x.v * x.v)};
}
template <class T>
Dual<T> acosh(const Dual<T>& x) {
    using std::acosh;
    using std::sqrt;
    return {acosh(x.v), x.d / sqrt((x.v - 1.0) * (x.v + 1.0))};
}
template <class T>
Dual<T> atanh(const Dual<T>& x) {
    using std::atanh;
    return {atanh(x.v), x.d / ((1.0 - x.v) * (1.0 + x.v))};
}

// -1, 0 or 1: the slope of |x|, which has none at zero.
template <class T>
double sign_of(const T& x) {
    const double value = value_of(x);
    return value > 0.0 ? 1.0 : value < 0.0 ? -1.0 : value;
}
template <class T>
Dual<T> abs(const Dual<T>& x) {
    return sign_of(x) * x;
}

}  // namespace leastaction
