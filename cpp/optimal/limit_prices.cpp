#include "optimal/limit_prices.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "optimal/barrier.hpp"

namespace leastaction {

namespace {

constexpr double binding = 0.5;              // multiplier, in parts of the price, of a limit that is not enforced by it
constexpr double cheaper = 1e-3, more = 10;  // factors by which prices change at most
constexpr double inside = 0.9;               // multiplier, in parts of the price, that it has at most
constexpr double rounding = 1e-13;           // error of a multiplier by rounding, in parts of its price
constexpr double settled_by = 2.3;           // logarithm of the factor by which multipliers are off at most in the end

}  // namespace

Priced price_limits(const LimitColumns& limits, const PriceBounds& bounds, const double* c, double* rho, double* y,
                    double* prices) {
    std::vector<double> net(limits.entries), largest(limits.columns), off_by(limits.columns);
    for (std::ptrdiff_t e = 0; e < limits.entries; ++e) {
        const std::int64_t j = limits.column[e];
        net[e] = limits.equal[j] ? y[e] - y[limits.other[e]] : y[e];
        largest[j] = std::max(largest[j], std::abs(net[e]));
        off_by[j] = std::max(off_by[j], -c[e]);
    }
    Priced found{false, 0.0, std::numeric_limits<double>::infinity()};
    std::vector<char> needs_more(limits.columns);
    for (std::ptrdiff_t j = 0; j < limits.columns; ++j) {
        const double scale = limits.scale[j], most = bounds.dearest / scale, before = rho[j];
        const bool off = off_by[j] > bounds.met * scale;
        needs_more[j] = (largest[j] > binding * before || off) && before < most;
        double wanted = limits.dear[j] * largest[j];
        if (limits.equal[j]) wanted = std::max(wanted, bounds.kept / scale);
        if (limits.hard[j])
            rho[j] = std::max(before, wanted);
        else if (needs_more[j])
            rho[j] = std::min(more * before, most);
        else if (!off)  // what is off has no multiplier yet to go by, and equations only in the end
            rho[j] = std::min(std::max(cheaper * before, wanted), before);
        found.dearer = found.dearer || needs_more[j];
        if (limits.hard[j]) continue;
        found.dearest = std::max(found.dearest, rho[j] * scale);
        found.cheapest = std::min(found.cheapest, rho[j] * scale);
    }
    for (std::ptrdiff_t e = 0; e < limits.entries; ++e) {
        const std::int64_t j = limits.column[e];
        const double price = prices[e] = rho[j];
        if (limits.equal[j]) {
            const double halved = 0.5 * (price + std::min(std::max(-inside * price, net[e]), inside * price));
            // What differs by rounding only stays as it is, and with it what was computed with these multipliers.
            if (std::abs(halved - y[e]) > rounding * price) y[e] = halved;
        } else {
            y[e] = std::min(y[e], inside * price);
            if (needs_more[j] && c[e] < 0.0) y[e] = first_multiplier(y[e], price);
        }
    }
    return found;
}

bool some_unenforced(std::ptrdiff_t entries, const std::int64_t* other, const double* y, const double* prices) {
    for (std::ptrdiff_t e = 0; e < entries; ++e) {
        const double net = other[e] == e ? y[e] : y[e] - y[other[e]];
        if (std::abs(net) > binding * prices[e]) return true;
    }
    return false;
}

void find_active(std::ptrdiff_t entries, std::ptrdiff_t columns, const std::int64_t* column, const double* scale,
                 const double* y, double least, double hardly, bool* active) {
    std::vector<double> enough(columns);
    for (std::ptrdiff_t e = 0; e < entries; ++e) enough[column[e]] = std::max(enough[column[e]], y[e]);
    for (std::ptrdiff_t j = 0; j < columns; ++j) enough[j] = std::max(least / scale[j], hardly * enough[j]);
    for (std::ptrdiff_t e = 0; e < entries; ++e) active[e] = y[e] > enough[column[e]];
}

void settle_multipliers(std::ptrdiff_t entries, const double* y, const double* slack, double mu, double* settled) {
    for (std::ptrdiff_t e = 0; e < entries; ++e) {
        const double barrier = mu / slack[e];
        settled[e] = std::abs(std::log(y[e] / barrier)) < settled_by ? y[e] : barrier;
    }
}

}  // namespace leastaction
