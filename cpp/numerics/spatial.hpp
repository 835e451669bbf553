// Spatial vectors and rigid-body quantities on a generic scalar.
//
// Motion vectors are [v; w]: the velocity of the point of the body that passes the world origin, and the angular
// velocity. Force-like vectors (momenta, wrenches) are [f; n]: the linear part, and the moment about the world origin.
// Both are plain aggregates of nine numbers at most, so the compiler keeps them in registers.
#pragma once

#include <array>

namespace leastaction {

template <class T>
struct Vec3 {
    T x{}, y{}, z{};
};

template <class T, class U>
auto operator+(const Vec3<T>& a, const Vec3<U>& b) {
    return Vec3<decltype(a.x + b.x)>{a.x + b.x, a.y + b.y, a.z + b.z};
}
template <class T, class U>
auto operator-(const Vec3<T>& a, const Vec3<U>& b) {
    return Vec3<decltype(a.x - b.x)>{a.x - b.x, a.y - b.y, a.z - b.z};
}
template <class T>
Vec3<T> operator-(const Vec3<T>& a) {
    return {-a.x, -a.y, -a.z};
}
template <class S, class T>
auto operator*(const S& s, const Vec3<T>& a) {
    return Vec3<decltype(s * a.x)>{s * a.x, s * a.y, s * a.z};
}
template <class T, class U>
Vec3<T>& operator+=(Vec3<T>& a, const Vec3<U>& b) {
    a.x += b.x;
    a.y += b.y;
    a.z += b.z;
    return a;
}
template <class T, class U>
auto dot(const Vec3<T>& a, const Vec3<U>& b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <class T, class U>
[[gnu::always_inline]] inline auto cross(const Vec3<T>& a, const Vec3<U>& b) {
    return Vec3<decltype(a.x * b.x)>{a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

// Rotation (or any 3x3) matrix by its columns: the columns of a rotation are the axes that joints turn about.
template <class T>
struct Mat3 {
    Vec3<T> c0, c1, c2;
};

template <class T, class U>
auto operator*(const Mat3<T>& m, const Vec3<U>& a) {
    return a.x * m.c0 + a.y * m.c1 + a.z * m.c2;
}
template <class T, class U>
auto operator*(const Mat3<T>& m, const Mat3<U>& n) {
    return Mat3<decltype(m.c0.x * n.c0.x)>{m * n.c0, m * n.c1, m * n.c2};
}
template <class T, class U>
auto transposed_times(const Mat3<T>& m, const Vec3<U>& a) {
    return Vec3<decltype(m.c0.x * a.x)>{dot(m.c0, a), dot(m.c1, a), dot(m.c2, a)};
}

// The rotation of a unit quaternion, scalar first.
template <class T>
Mat3<T> rotation_of(const T* quaternion) {
    const T &w = quaternion[0], &x = quaternion[1], &y = quaternion[2], &z = quaternion[3];
    const auto turned = [](const T& diagonal) { return T(1.0) - 2.0 * diagonal; };
    return {{turned(y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)},
            {2.0 * (x * y - w * z), turned(x * x + z * z), 2.0 * (y * z + w * x)},
            {2.0 * (x * z + w * y), 2.0 * (y * z - w * x), turned(x * x + y * y)}};
}

// Symmetric 3x3: xx, yy, zz, xy, xz, yz.
template <class T>
struct Sym3 {
    T xx{}, yy{}, zz{}, xy{}, xz{}, yz{};
};

template <class T, class U>
auto operator*(const Sym3<T>& s, const Vec3<U>& a) {
    return Vec3<decltype(s.xx * a.x)>{s.xx * a.x + s.xy * a.y + s.xz * a.z, s.xy * a.x + s.yy * a.y + s.yz * a.z,
                                      s.xz * a.x + s.yz * a.y + s.zz * a.z};
}

// A rigid placement: x_world = R x_local + p.
template <class T>
struct Pose {
    Mat3<T> R;
    Vec3<T> p;
};

template <class T>
struct Motion {
    Vec3<T> v, w;
};
template <class T>
struct Force {
    Vec3<T> f, n;
};

template <class T>
Motion<T> operator+(const Motion<T>& a, const Motion<T>& b) {
    return {a.v + b.v, a.w + b.w};
}
template <class T>
Motion<T> operator*(const T& s, const Motion<T>& a) {
    return {s * a.v, s * a.w};
}
template <class T>
Force<T>& operator+=(Force<T>& a, const Force<T>& b) {
    a.f += b.f;
    a.n += b.n;
    return a;
}
template <class T>
Force<T> operator-(const Force<T>& a, const Force<T>& b) {
    return {a.f - b.f, a.n - b.n};
}
// Power: the pairing of a force with a motion.
template <class T>
T dot(const Force<T>& a, const Motion<T>& b) {
    return dot(a.f, b.v) + dot(a.n, b.w);
}
// Motion cross product (the Lie bracket): how the motion b changes when carried along a.
template <class T>
Motion<T> cross(const Motion<T>& a, const Motion<T>& b) {
    return {cross(a.w, b.v) + cross(a.v, b.w), cross(a.w, b.w)};
}
// Its dual: (a x* f) . b = -f . (a x b).
template <class T>
Force<T> cross_dual(const Motion<T>& a, const Force<T>& f) {
    return {cross(a.w, f.f), cross(a.w, f.n) + cross(a.v, f.f)};
}

// Spatial inertia about the world origin: mass, first moment m c, and rotational inertia about the origin.
template <class T>
struct Inertia {
    T m{};
    Vec3<T> h;
    Sym3<T> I;
};

template <class T>
Inertia<T>& operator+=(Inertia<T>& a, const Inertia<T>& b) {
    a.m += b.m;
    a.h += b.h;
    a.I.xx += b.I.xx;
    a.I.yy += b.I.yy;
    a.I.zz += b.I.zz;
    a.I.xy += b.I.xy;
    a.I.xz += b.I.xz;
    a.I.yz += b.I.yz;
    return a;
}
template <class T>
[[gnu::always_inline]] inline Force<T> operator*(const Inertia<T>& a, const Motion<T>& s) {
    return {a.m * s.v + cross(s.w, a.h), a.I * s.w + cross(a.h, s.v)};
}

}  // namespace leastaction
