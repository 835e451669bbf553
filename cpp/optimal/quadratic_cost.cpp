#include "optimal/quadratic_cost.hpp"

namespace leastaction {

namespace {

// Entry i of a weight times what a row is off by.
double weighed(const double* weight, bool diagonal, std::size_t n, const double* value, const double* wanted,
               std::size_t i) {
    if (diagonal) return weight[i] * (value[i] - wanted[i]);
    double sum = 0.0;
    for (std::size_t j = 0; j < n; ++j) sum += weight[i * n + j] * (value[j] - wanted[j]);
    return sum;
}

// Calls with(k, i, off, weighed) for entry i of each row k.
template <class With>
void each_entry(const Deviations& off, const RowWeights& weights, const With& with) {
    const double *value = off.values, *wanted = off.wanted, *weight = weights.data;
    for (std::size_t k = 0; k < off.rows; ++k) {
        for (std::size_t i = 0; i < off.n; ++i)
            with(k, i, value[i] - wanted[i], weighed(weight, weights.diagonal, off.n, value, wanted, i));
        value += off.n;
        wanted += off.wanted_stride;
        weight += weights.stride;
    }
}

}  // namespace

void add_half_squares(const Deviations& off, const RowWeights& weights, double* out) {
    each_entry(off, weights, [out](std::size_t k, std::size_t, double d, double pull) { out[k] += 0.5 * d * pull; });
}

void weigh_rows(const Deviations& off, const RowWeights& weights, double* out) {
    const std::size_t n = off.n;
    each_entry(off, weights, [out, n](std::size_t k, std::size_t i, double, double pull) { out[k * n + i] = pull; });
}

}  // namespace leastaction
