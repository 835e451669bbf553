// The prices of excess of limits, chosen by their multipliers from one stage of the barrier to the next.
#pragma once

#include <cstddef>
#include <cstdint>

namespace leastaction {

// Limits have columns, each with a price and a scale, and entries of these, one for each instant.
struct LimitColumns {
    std::ptrdiff_t entries, columns;
    const std::int64_t* column;  // of every entry
    const std::int64_t* other;   // the entry of the other side of an equation; of others, the entry itself
    const bool* equal;           // of every column: whether it is a side of an equation
    const bool* hard;            // whether nothing is beyond it, so that its price does not fall
    const double* dear;          // its price, in multipliers
    const double* scale;
};

// What is asked of prices: the highest of an excess of its scale; what is off by more of its scale needs a higher one,
// whatever its multiplier (NaN: nothing); and what an excess of an equation's scale goes on to cost.
struct PriceBounds {
    double dearest, met, kept;
};

struct Priced {
    bool dearer;               // whether some limit needs a price that is higher
    double dearest, cheapest;  // of an excess of its scale, of limits that are not hard
};

// Changes prices `rho` of the columns and multipliers `y` of the entries, whose values are c; writes the prices of entries.
Priced price_limits(const LimitColumns& limits, const PriceBounds& bounds, const double* c, double* rho, double* y,
                    double* prices);

// Whether the price of some entry does not enforce its limit, as its multiplier is too close to it; `other`: as of the
// columns.
bool some_unenforced(std::ptrdiff_t entries, const std::int64_t* other, const double* y, const double* prices);
// Writes which entries are active: whose multiplier, times the scale of its column, is at least so much, and a part
// `hardly` of the column's largest.
void find_active(std::ptrdiff_t entries, std::ptrdiff_t columns, const std::int64_t* column, const double* scale,
                 const double* y, double least, double hardly, bool* active);
// Writes multipliers, or those of the barrier where they have not come near them.
void settle_multipliers(std::ptrdiff_t entries, const double* y, const double* slack, double mu, double* settled);

}  // namespace leastaction
