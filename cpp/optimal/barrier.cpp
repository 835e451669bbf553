#include "optimal/barrier.hpp"

#include <algorithm>
#include <cmath>

namespace leastaction {

namespace {

constexpr double inside = 0.995;  // of the way to their bounds duals go at most
constexpr double near = 1e3;      // by this factor duals may be off those of the barrier
constexpr double below =
    1.0 - 1e-9;                 // times the price is the largest dual: the price less the dual is to have some digits
constexpr double almost = 0.1;  // of the slope may be left, of the other sign, where a step is not too long
constexpr double guess = 0.1;   // of its price is the first dual of a limit that is not met
constexpr int halvings = 8;     // of a step that is too long
constexpr double nearly = 0.1;  // part to which its length is told

// The sum of term(i), i = first .. last - 1: of halves, so that rounding grows with the logarithm of their number.
template <class Term>
double sum(std::ptrdiff_t first, std::ptrdiff_t last, const Term& term) {
    if (last - first > 128) {
        const std::ptrdiff_t middle = first + (last - first) / 2;
        return sum(first, middle, term) + sum(middle, last, term);
    }
    double total = 0.0;
    for (std::ptrdiff_t i = first; i < last; ++i) total += term(i);
    return total;
}

// sqrt(1 + t^2), t >= 0: beyond a billion it is t, and its square may be out of range.
double root_of(double t) { return t < 1e9 ? std::sqrt(1.0 + t * t) : t; }

double stiffness_of(double slack, double excess, double rho, double y) {
    return 1.0 / (slack / y + excess / (rho - y));
}

}  // namespace

double Barrier::split(const double* c, double* slack, double* excess) const {
    for (std::ptrdiff_t i = 0; i < size; ++i) {
        const double t = std::abs(0.5 * rho[i] * c[i] / mu), large = t + root_of(t), unit = mu / rho[i];
        const double far = unit * (1.0 + large), close = unit * (1.0 + 1.0 / large);
        slack[i] = c[i] > 0.0 ? far : close;
        excess[i] = c[i] > 0.0 ? close : far;
    }
    return value(slack, excess);
}

double Barrier::value(const double* slack, const double* excess) const {
    // The product of the two is within the numbers' range: where one is large the other is about 1.
    return mu * sum(0, size, [&](std::ptrdiff_t i) {
               const double scale = rho[i] / mu, dear = scale * excess[i];
               return dear - std::log(dear * (scale * slack[i]));
           });
}

void Barrier::stiffness(const double* slack, const double* excess, const double* y, double* out) const {
    for (std::ptrdiff_t i = 0; i < size; ++i) out[i] = stiffness_of(slack[i], excess[i], rho[i], y[i]);
}

double Barrier::off_center(const double* slack, const double* excess, const double* y) const {
    double largest = 0.0;
    for (std::ptrdiff_t i = 0; i < size; ++i)
        largest = std::max({largest, y[i] * slack[i], (rho[i] - y[i]) * excess[i]});
    return largest;
}

void Barrier::move_duals(const double* slack, const double* excess, const double* y, const double* dc,
                         const double* slack_after, double* out) const {
    for (std::ptrdiff_t i = 0; i < size; ++i) {
        const double moved = mu / slack[i] - stiffness_of(slack[i], excess[i], rho[i], y[i]) * dc[i];
        const double kept = std::min(std::max(moved, (1.0 - inside) * y[i]), rho[i] - (1.0 - inside) * (rho[i] - y[i]));
        const double barrier = mu / slack_after[i];
        const double most = std::min({near * barrier, rho[i] - (rho[i] - barrier) / near, below * rho[i]});
        out[i] = std::min(std::max(kept, barrier / near), most);
    }
}

double first_multiplier(double barrier, double price) { return barrier > 0.5 * price ? guess * price : barrier; }

// The derivative of the barriers along a direction, with its sign changed: the sum of -psi' dc.
double Barrier::slope_along(const double* c, const double* dc, double length) const {
    return sum(0, size, [&](std::ptrdiff_t i) {
        const double at = c[i] + length * dc[i], t = std::abs(0.5 * rho[i] * at / mu);
        const double part = rho[i] / (1.0 + t + root_of(t));
        return (at > 0.0 ? part : rho[i] - part) * dc[i];
    });
}

double Barrier::step(const double* c, const double* slack, const double* excess, const double* y, const double* dc,
                     double fall, double least, double length) const {
    const Along barriers = along(slack, excess, y, dc);
    const double plain = fall + barriers.fall, bend = 2.0 * (least - fall) - barriers.stiff;
    const auto rise = [&](double a) { return plain + a * bend - slope_along(c, dc, a); };
    if (rise(length) <= -almost * (plain - slope_along(c, dc, 0.0))) return length;
    double low = 0.0, high = length;
    for (int k = 0; k < halvings && !(high - low < nearly * low); ++k) {
        const double middle = 0.5 * (low + high);
        (rise(middle) < 0.0 ? low : high) = middle;
    }
    return low == 0.0 ? high : low;
}

Barrier::Along Barrier::along(const double* slack, const double* excess, const double* y, const double* dc) const {
    return {sum(0, size, [&](std::ptrdiff_t i) { return mu / slack[i] * dc[i]; }), sum(0, size, [&](std::ptrdiff_t i) {
                return stiffness_of(slack[i], excess[i], rho[i], y[i]) * dc[i] * dc[i];
            })};
}

Barrier::Step Barrier::advance(const From& from, const double* dc, double fall, double bend, const To& to) const {
    const Along barriers = along(from.slack, from.excess, from.y, dc);
    const double whole = fall - barriers.fall, least = whole + 0.5 * (bend + barriers.stiff);
    const double length = step(from.c, from.slack, from.excess, from.y, dc, whole, least, 1.0);
    for (std::ptrdiff_t i = 0; i < size; ++i) to.c[i] = from.c[i] + length * dc[i];
    const double found = split(to.c, to.slack, to.excess);
    move_duals(from.slack, from.excess, from.y, dc, to.slack, to.y);
    return {length, found};
}

}  // namespace leastaction
