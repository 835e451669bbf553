// Sines and cosines of many angles at once.
//
// The C library gives them one by one; a mechanism needs those of all its joints, so this takes eight lanes at a time:
// Cody and Waite's reduction by multiples of pi/2 in three exact parts, then the minimax polynomials of fdlibm on
// [-pi/4, pi/4]. Within two units in the last place for |x| < 1e5; beyond that the C library takes over.
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>

namespace leastaction {

constexpr int sincos_lanes = 8;

template <int lanes>
inline void sincos_wide(const double* x, double* sine, double* cosine) {
    constexpr double two_over_pi = 0.63661977236758134308;
    constexpr double part1 = 1.57079632673412561417e+00, part2 = 6.07710050630396597660e-11,
                     part3 = 2.02226624879595063154e-21;
    constexpr double round_to_integer = 6755399441055744.0;  // 1.5 * 2^52: adding it rounds to an integer
    for (int l = 0; l < lanes; ++l) {
        const double shifted = x[l] * two_over_pi + round_to_integer;
        const double n = shifted - round_to_integer;
        const std::int64_t quadrant = std::bit_cast<std::int64_t>(shifted);
        const double r = ((x[l] - n * part1) - n * part2) - n * part3;
        const double z = r * r;
        const double s = r + r * z *
                                 (-1.66666666666666324348e-01 +
                                  z * (8.33333333332248946124e-03 +
                                       z * (-1.98412698298579493134e-04 +
                                            z * (2.75573137070700676789e-06 +
                                                 z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)))));
        const double half = 0.5 * z, w = 1.0 - half;
        const double c =
            w + (((1.0 - w) - half) +
                 z * z *
                     (4.16666666666666019037e-02 +
                      z * (-1.38888888888741095749e-03 +
                           z * (2.48015872894767294178e-05 +
                                z * (-2.75573143513906633035e-07 +
                                     z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11))))));
        const bool swapped = quadrant & 1;
        const double s0 = swapped ? c : s, c0 = swapped ? s : c;
        sine[l] = quadrant & 2 ? -s0 : s0;
        cosine[l] = (quadrant + 1) & 2 ? -c0 : c0;
    }
}

// n angles; the arrays hold whole lanes (a multiple of their number), and x is finite beyond n.
template <int lanes = sincos_lanes>
inline void sincos_all(const double* x, double* sine, double* cosine, int n) {
    constexpr double far = 1e5;
    for (int i = 0; i < n; i += lanes) sincos_wide<lanes>(x + i, sine + i, cosine + i);
    for (int i = 0; i < n; ++i) {
        if (std::abs(x[i]) < far) continue;  // also takes NaN to the library, which passes it on
        sine[i] = std::sin(x[i]);
        cosine[i] = std::cos(x[i]);
    }
}

}  // namespace leastaction
