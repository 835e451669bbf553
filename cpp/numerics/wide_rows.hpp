// Matrices of many columns, some rows and a few vectors of them in registers at a time.
//
// They stand by rows of leading dimension ld, a multiple of `row_lanes`: loops run over whole vectors, past the last column.
#pragma once

#include <algorithm>
#include <type_traits>

#include "numerics/small_products.hpp"

namespace leastaction {

constexpr int row_lanes = 8;
constexpr int whole_lanes(int columns) { return (columns + row_lanes - 1) / row_lanes * row_lanes; }

// Some neighbouring vectors of a row, in registers.
template <int wides>
class WideRow {
public:
    explicit WideRow(const double* from) {
        for (int w = 0; w < wides; ++w) part_[w] = at(from, w);
    }
    void add_multiple(double factor, const double* b) {
        for (int w = 0; w < wides; ++w) part_[w] += factor * at(b, w);
    }
    void subtract_multiple(double factor, const double* b) {
        for (int w = 0; w < wides; ++w) part_[w] -= factor * at(b, w);
    }
    void scale(double factor) {
        for (int w = 0; w < wides; ++w) part_[w] *= factor;
    }
    void put(double* to) const {
        for (int w = 0; w < wides; ++w) Eigen::Map<Wide>(to + w * row_lanes) = part_[w];
    }

private:
    using Wide = Eigen::Array<double, row_lanes, 1>;
    static Eigen::Map<const Wide> at(const double* from, int w) { return Eigen::Map<const Wide>(from + w * row_lanes); }
    Wide part_[wides];
};

// Calls panel(wides, first) for panels of columns that are three vectors across, as long as there are so many: enough
// independent chains to hide the latency of each.
template <class Panel>
void each_panel(int columns, const Panel& panel) {
    using std::integral_constant;
    int first = 0;
    for (; first + 2 * row_lanes < columns; first += 3 * row_lanes) panel(integral_constant<int, 3>(), first);
    if (first + row_lanes < columns)
        panel(integral_constant<int, 2>(), first);
    else if (first < columns)
        panel(integral_constant<int, 1>(), first);
}

namespace detail {

// Rows that fit into the registers beside each other, three vectors of each.
constexpr int rows_at_once =
    std::clamp<int>((EIGEN_ARCH_DEFAULT_NUMBER_OF_REGISTERS - 4) / (3 * row_lanes / packet_size), 1, 4);

template <Into into, int wides, int rows>
inline void add_rows(const double* A, std::ptrdiff_t stride, int depth, const double* B, double* C, std::ptrdiff_t ld) {
    const auto sums = [&]<int... r>(std::integer_sequence<int, r...>) {
        return std::array{WideRow<wides>(C + r * ld)...};
    };
    std::array<WideRow<wides>, rows> row = sums(std::make_integer_sequence<int, rows>());
    for (int k = 0; k < depth; ++k, B += ld)
        for (int r = 0; r < rows; ++r) {
            if constexpr (into == Into::add)
                row[r].add_multiple(A[r * stride + k], B);
            else
                row[r].subtract_multiple(A[r * stride + k], B);
        }
    for (int r = 0; r < rows; ++r) row[r].put(C + r * ld);
}

}  // namespace detail

// C += A B or C -= A B, of the first `depth` columns of A, which stands by rows of its own length.
template <Into into, class Matrix>
void multiply_rows(const Matrix& A, int depth, const double* B, double* C, int columns, std::ptrdiff_t ld) {
    const double* a = A.data();
    const std::ptrdiff_t rows = A.rows(), stride = A.outerStride();
    each_panel(columns, [=](auto wides, int first) {
        constexpr int at_once = detail::rows_at_once;
        std::ptrdiff_t i = 0;
        for (; i + at_once <= rows; i += at_once)
            detail::add_rows<into, wides(), at_once>(a + i * stride, stride, depth, B + first, C + i * ld + first, ld);
        for (; i < rows; ++i)
            detail::add_rows<into, wides(), 1>(a + i * stride, stride, depth, B + first, C + i * ld + first, ld);
    });
}

}  // namespace leastaction
