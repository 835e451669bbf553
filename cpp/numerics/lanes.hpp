// Several numbers side by side in a register, as a scalar of the kernel: what it computes for one it computes for each lane,
// by the same instructions, so that no lane sees what its neighbours hold.
//
// By the vector extension of GCC and Clang, as wide as what the file is compiled for.
#pragma once

#include <cmath>
#include <cstring>
#include <limits>

#include "numerics/dual.hpp"
#include "numerics/sincos.hpp"

namespace leastaction {

#if defined(__AVX512F__)
inline constexpr int lane_count = 8;
#elif defined(__AVX__)
inline constexpr int lane_count = 4;
#else
inline constexpr int lane_count = 2;
#endif

struct Lanes {
    using Vector [[gnu::vector_size(lane_count * sizeof(double))]] = double;
    using Mask = decltype(Vector{} < Vector{});  // all bits of a lane, or none

    Vector v;

    Lanes() = default;
    Lanes(double x) : v(x - Vector{}) {}
    explicit Lanes(const Vector& v) : v(v) {}

    double operator[](int lane) const { return v[lane]; }
    void set(int lane, double x) { v[lane] = x; }
    void put(double* to) const { std::memcpy(to, &v, sizeof v); }
    static Lanes from(const double* values) {
        Lanes out;
        std::memcpy(&out.v, values, sizeof out.v);
        return out;
    }

    friend Lanes operator+(const Lanes& a, const Lanes& b) { return Lanes(a.v + b.v); }
    friend Lanes operator-(const Lanes& a, const Lanes& b) { return Lanes(a.v - b.v); }
    friend Lanes operator*(const Lanes& a, const Lanes& b) { return Lanes(a.v * b.v); }
    friend Lanes operator/(const Lanes& a, const Lanes& b) { return Lanes(a.v / b.v); }
    friend Lanes operator-(const Lanes& a) { return Lanes(-a.v); }
    Lanes& operator+=(const Lanes& a) { return *this = *this + a; }
    Lanes& operator-=(const Lanes& a) { return *this = *this - a; }
    Lanes& operator*=(const Lanes& a) { return *this = *this * a; }

    friend Mask operator<(const Lanes& a, const Lanes& b) { return a.v < b.v; }
    friend Mask operator<=(const Lanes& a, const Lanes& b) { return a.v <= b.v; }
    friend Mask operator>(const Lanes& a, const Lanes& b) { return a.v > b.v; }
    friend Mask operator>=(const Lanes& a, const Lanes& b) { return a.v >= b.v; }
};

inline constexpr Lanes::Mask no_lanes{};

inline Lanes select(const Lanes::Mask& which, const Lanes& yes, const Lanes& no) { return Lanes(which ? yes.v : no.v); }
// As std::max does: the first where the other is not a number.
inline Lanes max(const Lanes& a, const Lanes& b) { return select(a < b, b, a); }
inline Lanes abs(const Lanes& a) { return select(a < Lanes(0.0), -a, a); }
inline Lanes::Mask finite(const Lanes& a) { return abs(a) <= Lanes(std::numeric_limits<double>::max()); }
inline bool any(const Lanes::Mask& which) {
    bool out = false;
    for (int l = 0; l < lane_count; ++l) out = out || which[l] != 0;
    return out;
}

inline const Lanes& value_of(const Lanes& x) { return x; }
// Sizes of terms: raises the first to the second where that is larger.
inline void raise(double& size, double x) { size = size < x ? x : size; }
inline void raise(Lanes& size, const Lanes& x) { size = max(size, x); }
inline Lanes sqrt(const Lanes& x) {
    double of_lane[lane_count];
    x.put(of_lane);
    for (double& each : of_lane) each = std::sqrt(each);
    return Lanes::from(of_lane);
}
inline void sincos_of(const Lanes& x, Lanes& s, Lanes& c) {
    double angle[lane_count], sine[lane_count], cosine[lane_count];
    x.put(angle);
    sincos_all<lane_count>(angle, sine, cosine, lane_count);
    s = Lanes::from(sine);
    c = Lanes::from(cosine);
}

}  // namespace leastaction
