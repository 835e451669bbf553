// Products of matrices of a few dozen rows and columns.
//
//   C = A B,   C += A B   or   C -= A B,   all of it or the upper triangle only,
//
// and the triangular systems that follow a Cholesky factor. General products copy both factors into panels first, which
// pays for large matrices only; here each tile of C is summed in registers, straight from where A and B stand:
//
//        columns of the tile
//       . . . . . . . .  <- for each k: one entry of B for each column, spread over a packet ...
//     |                |
//     |   sums of C    |    ... times packets of the column k of A, the rows of the tile
//     |                |
//
// Every entry of C is a_i0 b_0j + a_i1 b_1j + ..., added in this order and to C at the end, in whichever tile it lies:
// results depend neither on addresses nor on the size of what is computed beside them.
//
// Rows come in whole packets. A and C stand by columns, with room for padded(rows) numbers in each; what stands behind
// the last row is read and written, and means nothing.

#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>

namespace leastaction {

using Packet = Eigen::internal::packet_traits<double>::type;
constexpr Eigen::Index packet_size = Eigen::internal::packet_traits<double>::size;

// The rows to make room for.
constexpr Eigen::Index padded(Eigen::Index rows) { return (rows + packet_size - 1) / packet_size * packet_size; }

// A factor A: column k starts at data + k stride.
struct Columns {
    const double* data;
    Eigen::Index stride;
};

// A factor B: entry (k, j) stands at data + k down + j across.
struct Entries {
    const double* data;
    Eigen::Index down;
    Eigen::Index across;

    Entries from_column(Eigen::Index j) const { return {data + j * across, down, across}; }
};

// What is written: column j starts at data + j stride.
struct Target {
    double* data;
    Eigen::Index stride;

    Target from_column(Eigen::Index j) const { return {data + j * stride, stride}; }
};

// What becomes of the sums.
enum class Into { set, add, subtract };

// A product A B, of so many columns of A and rows of B.
struct Factors {
    Eigen::Index depth = 0;
    Columns A{nullptr, 0};
    Entries B{nullptr, 0, 0};
};

// One that is the sum of two, as where there is a gap in the factors.
using Sum = std::array<Factors, 2>;

namespace detail {

inline Sum from_column(Sum of, Eigen::Index j) {
    for (Factors& part : of) part.B = part.B.from_column(j);
    return of;
}

// The largest tile: as many sums as leave registers for the factors, and for products where these are not added in
// one instruction.
#ifdef EIGEN_HAS_SINGLE_INSTRUCTION_MADD
constexpr int tile_packets = 3;
#else
constexpr int tile_packets = 2;
#endif
constexpr int tile_columns = EIGEN_ARCH_DEFAULT_NUMBER_OF_REGISTERS >= 32 ? 8 : 4;
constexpr int tall_packets = 8;  // of a tile of one column

inline void put(Into into, double* at, const Packet& sum) {
    using namespace Eigen::internal;
    if (into == Into::set) return pstoreu(at, sum);
    const Packet old = ploadu<Packet>(at);
    pstoreu(at, into == Into::add ? padd(old, sum) : psub(old, sum));
}

template <int packets, int columns>
inline void tile(Into into, const Sum& of, Eigen::Index row, Target C) {
    using namespace Eigen::internal;
    Packet sums[columns][packets];
    for (int j = 0; j < columns; ++j) {
        for (int p = 0; p < packets; ++p) sums[j][p] = pset1<Packet>(0.0);
    }
    for (const Factors& part : of) {
        const double *A = part.A.data + row, *B = part.B.data;
        const Eigen::Index stride = part.A.stride, down = part.B.down, across = part.B.across;
        for (Eigen::Index k = 0; k < part.depth; ++k, A += stride, B += down) {
            Packet a[packets];
            for (int p = 0; p < packets; ++p) a[p] = ploadu<Packet>(A + p * packet_size);
            for (int j = 0; j < columns; ++j) {
                const Packet b = pset1<Packet>(B[j * across]);
                for (int p = 0; p < packets; ++p) sums[j][p] = pmadd(a[p], b, sums[j][p]);
            }
        }
    }
    for (int j = 0; j < columns; ++j) {
        for (int p = 0; p < packets; ++p) put(into, C.data + j * C.stride + row + p * packet_size, sums[j][p]);
    }
}

// Tiles of so many columns under each other; the last has as many packets as are left.
template <int packets, int columns>
inline void strip(Into into, Eigen::Index rows, const Sum& of, Target C, Eigen::Index row = 0) {
    constexpr Eigen::Index step = packets * packet_size;
    for (; rows - row >= step - packet_size + 1; row += step) tile<packets, columns>(into, of, row, C);
    if constexpr (packets > 1) {
        if (row < rows) strip<packets - 1, columns>(into, rows, of, C, row);
    }
}

// A strip of fewer columns than a whole one.
template <int columns = tile_columns>
inline void narrow_strip(Into into, Eigen::Index width, Eigen::Index rows, const Sum& of, Target C) {
    constexpr int packets = columns == 1 ? tall_packets : tile_packets;
    if (width == columns) return strip<packets, columns>(into, rows, of, C);
    if constexpr (columns > 1) narrow_strip<columns - 1>(into, width, rows, of, C);
}

// Calls add_strip(j, width) for strips of columns j, j + 1, ...
template <class AddStrip>
inline void each_strip(Eigen::Index columns, const AddStrip& add_strip) {
    for (Eigen::Index j = 0; j < columns; j += tile_columns) {
        add_strip(j, std::min<Eigen::Index>(tile_columns, columns - j));
    }
}

}  // namespace detail

// C = A B, or added or subtracted: rows x columns.
inline void product(Into into, Eigen::Index rows, Eigen::Index columns, const Sum& of, Target C) {
    detail::each_strip(columns, [&](Eigen::Index j, Eigen::Index width) {
        detail::narrow_strip(into, width, rows, detail::from_column(of, j), C.from_column(j));
    });
}

inline void product(Into into, Eigen::Index rows, Eigen::Index columns, Eigen::Index depth, Columns A, Entries B,
                    Target C) {
    product(into, rows, columns, Sum{Factors{depth, A, B}, Factors{}}, C);
}

// The same for the upper triangle of a square C, entries (i, j) with i <= j; some below it are written too.
inline void upper_product(Into into, Eigen::Index size, const Sum& of, Target C) {
    detail::each_strip(size, [&](Eigen::Index j, Eigen::Index width) {
        detail::narrow_strip(into, width, j + width, detail::from_column(of, j), C.from_column(j));
    });
}

inline void upper_product(Into into, Eigen::Index size, Eigen::Index depth, Columns A, Entries B, Target C) {
    upper_product(into, size, Sum{Factors{depth, A, B}, Factors{}}, C);
}

// X with X L' = X as given; L is lower triangular, by columns.
inline void solve_lower_transposed(Eigen::Index rows, Eigen::Index size, Columns L, Target X) {
    for (Eigen::Index j = 0; j < size; ++j) {
        product(Into::subtract, rows, 1, j, {X.data, X.stride}, {L.data + j, L.stride, 0}, X.from_column(j));
        Eigen::Map<Eigen::VectorXd>(X.data + j * X.stride, padded(rows)) *= 1.0 / L.data[j * L.stride + j];
    }
}

// X with X L = X as given.
inline void solve_lower(Eigen::Index rows, Eigen::Index size, Columns L, Target X) {
    for (Eigen::Index j = size - 1; j >= 0; --j) {
        const double* diagonal = L.data + j * L.stride + j;
        product(Into::subtract, rows, 1, size - 1 - j, {X.data + (j + 1) * X.stride, X.stride}, {diagonal + 1, 1, 0},
                X.from_column(j));
        Eigen::Map<Eigen::VectorXd>(X.data + j * X.stride, padded(rows)) *= 1.0 / *diagonal;
    }
}

// The lower triangle of the first n rows and columns from the upper one; M by columns.
inline void mirror_upper(Eigen::MatrixXd& M, Eigen::Index n) {
    using Eigen::Index;
    constexpr Index tile = 4;
    const Index whole = n - n % tile;
    for (Index j = 0; j < whole; j += tile) {
        for (Index i = 0; i < j; i += tile) {
            const Eigen::Matrix4d block = M.block<tile, tile>(i, j);
            M.block<tile, tile>(j, i) = block.transpose();
        }
    }
    for (Index j = 0; j < n; ++j) {
        for (Index i = j < whole ? j - j % tile : 0; i < j; ++i) M(j, i) = M(i, j);
    }
}

}  // namespace leastaction
