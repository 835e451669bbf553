// Dual numbers: a value and its derivative along one direction.
//
// The kernel is written once on a generic scalar; run on duals it returns the next order of derivative along a
// direction. Dual<Dual<double>> (a hyper-dual) gives two directions.
#pragma once

#include <cmath>
#include <type_traits>
#include <utility>

namespace leastaction {

template <class T>
struct Dual {
    T v{};  // value
    T d{};  // derivative

    Dual() = default;
    Dual(double value) : v(value) {}
    Dual(const T& value, const T& derivative) : v(value), d(derivative) {}
};

template <class T>
Dual<T> operator+(const Dual<T>& a, const Dual<T>& b) {
    return {a.v + b.v, a.d + b.d};
}
template <class T>
Dual<T> operator-(const Dual<T>& a, const Dual<T>& b) {
    return {a.v - b.v, a.d - b.d};
}
template <class T>
Dual<T> operator-(const Dual<T>& a) {
    return {-a.v, -a.d};
}
template <class T>
Dual<T> operator*(const Dual<T>& a, const Dual<T>& b) {
    return {a.v * b.v, a.v * b.d + a.d * b.v};
}
template <class T>
Dual<T> operator*(double a, const Dual<T>& b) {
    return {a * b.v, a * b.d};
}
template <class T>
Dual<T> operator*(const Dual<T>& a, double b) {
    return b * a;
}
template <class T>
Dual<T> operator+(const Dual<T>& a, double b) {
    return {a.v + b, a.d};
}
template <class T>
Dual<T> operator+(double a, const Dual<T>& b) {
    return b + a;
}
template <class T>
Dual<T> operator-(const Dual<T>& a, double b) {
    return {a.v - b, a.d};
}
template <class T>
Dual<T> operator-(double a, const Dual<T>& b) {
    return {a - b.v, -b.d};
}
template <class T>
Dual<T>& operator+=(Dual<T>& a, const Dual<T>& b) {
    a.v += b.v;
    a.d += b.d;
    return a;
}
template <class T>
Dual<T>& operator-=(Dual<T>& a, const Dual<T>& b) {
    a.v -= b.v;
    a.d -= b.d;
    return a;
}
inline void sincos_of(double a, double& s, double& c) {
    s = std::sin(a);
    c = std::cos(a);
}
template <class T>
void sincos_of(const Dual<T>& a, Dual<T>& s, Dual<T>& c) {
    sincos_of(a.v, s.v, c.v);
    s.d = c.v * a.d;
    c.d = -(s.v * a.d);
}

// Sine and cosine of a scalar whose plain number's sine and cosine are known.
inline void sincos_from(double, double sine, double cosine, double& s, double& c) {
    s = sine;
    c = cosine;
}
template <class T>
void sincos_from(const Dual<T>& a, double sine, double cosine, Dual<T>& s, Dual<T>& c) {
    sincos_from(a.v, sine, cosine, s.v, c.v);
    s.d = c.v * a.d;
    c.d = -(s.v * a.d);
}

// Two directions: second derivatives along them, the same direction twice where they are one.
using HyperDual = Dual<Dual<double>>;

// The plain number under a scalar.
inline double value_of(double x) { return x; }
template <class T>
double value_of(const Dual<T>& x) {
    return value_of(x.v);
}

template <class T>
inline constexpr bool is_dual = false;
template <class T>
inline constexpr bool is_dual<Dual<T>> = true;

// What sizes of a scalar are: a plain number, or one for each lane (lanes.hpp).
template <class T>
using SizeOf = std::remove_cvref_t<decltype(value_of(std::declval<const T&>()))>;

}  // namespace leastaction
