// Half the weighted squares of what rows are off by, and their derivatives: of the states, or the inputs, of a cost.
#pragma once

#include <cstddef>

namespace leastaction {

// Rows of n entries, one after the other, and what is wanted in their place: one row for all where its stride is 0.
struct Deviations {
    std::size_t rows, n;
    const double* values;
    const double* wanted;
    std::ptrdiff_t wanted_stride;
};

// Weights of the rows: diagonals or symmetric matrices, one for all where the stride is 0.
struct RowWeights {
    const double* data;
    bool diagonal;
    std::ptrdiff_t stride;
};

// Adds half the weighted square of each row.
void add_half_squares(const Deviations& off, const RowWeights& weights, double* out);
// Writes the weights times the rows.
void weigh_rows(const Deviations& off, const RowWeights& weights, double* out);

}  // namespace leastaction
