// Square matrices of three rows, each row in one register, and of six, as four of these: products are sums of whole rows.
#pragma once

namespace leastaction {

template <int n>
struct SmallMatrix;

template <>
struct SmallMatrix<3> {
    typedef double Row
        __attribute__((vector_size(32)));  // zero beyond three: put together and taken apart in registers
    Row rows[3];

    double operator()(int i, int j) const { return rows[i][j]; }
};
template <>
struct SmallMatrix<6> {
    SmallMatrix<3> aa, ab, ba, bb;

    double operator()(int i, int j) const {
        return i < 3 ? (j < 3 ? aa(i, j) : ab(i, j - 3)) : (j < 3 ? ba(i - 3, j) : bb(i - 3, j - 3));
    }
};

inline SmallMatrix<3> operator+(const SmallMatrix<3>& a, const SmallMatrix<3>& b) {
    return {{a.rows[0] + b.rows[0], a.rows[1] + b.rows[1], a.rows[2] + b.rows[2]}};
}
inline SmallMatrix<3> operator-(const SmallMatrix<3>& a, const SmallMatrix<3>& b) {
    return {{a.rows[0] - b.rows[0], a.rows[1] - b.rows[1], a.rows[2] - b.rows[2]}};
}
inline SmallMatrix<3> operator*(double factor, const SmallMatrix<3>& a) {
    return {{factor * a.rows[0], factor * a.rows[1], factor * a.rows[2]}};
}
inline SmallMatrix<3> operator*(const SmallMatrix<3>& a, const SmallMatrix<3>& b) {
    SmallMatrix<3> out;
    for (int i = 0; i < 3; ++i) out.rows[i] = a(i, 0) * b.rows[0] + a(i, 1) * b.rows[1] + a(i, 2) * b.rows[2];
    return out;
}
// a'b.
inline SmallMatrix<3> transposed_product(const SmallMatrix<3>& a, const SmallMatrix<3>& b) {
    SmallMatrix<3> out;
    for (int i = 0; i < 3; ++i) out.rows[i] = a(0, i) * b.rows[0] + a(1, i) * b.rows[1] + a(2, i) * b.rows[2];
    return out;
}
// Product by product, each added as it is made.
inline void add_product(SmallMatrix<3>& to, const SmallMatrix<3>& a, const SmallMatrix<3>& b) {
    for (int i = 0; i < 3; ++i)
        for (int k = 0; k < 3; ++k) to.rows[i] += a(i, k) * b.rows[k];
}
inline void add_transposed_product(SmallMatrix<3>& to, const SmallMatrix<3>& a, const SmallMatrix<3>& b) {
    for (int i = 0; i < 3; ++i)
        for (int k = 0; k < 3; ++k) to.rows[i] += a(k, i) * b.rows[k];
}
inline SmallMatrix<3> transposed(const SmallMatrix<3>& a) {
    using Row = SmallMatrix<3>::Row;
    return {{Row{a(0, 0), a(1, 0), a(2, 0), 0.0}, Row{a(0, 1), a(1, 1), a(2, 1), 0.0},
             Row{a(0, 2), a(1, 2), a(2, 2), 0.0}}};
}

inline SmallMatrix<6> operator+(const SmallMatrix<6>& a, const SmallMatrix<6>& b) {
    return {a.aa + b.aa, a.ab + b.ab, a.ba + b.ba, a.bb + b.bb};
}
inline SmallMatrix<6> operator*(double factor, const SmallMatrix<6>& a) {
    return {factor * a.aa, factor * a.ab, factor * a.ba, factor * a.bb};
}
inline SmallMatrix<6> operator*(const SmallMatrix<6>& a, const SmallMatrix<6>& b) {
    return {a.aa * b.aa + a.ab * b.ba, a.aa * b.ab + a.ab * b.bb, a.ba * b.aa + a.bb * b.ba, a.ba * b.ab + a.bb * b.bb};
}
inline SmallMatrix<6> transposed_product(const SmallMatrix<6>& a, const SmallMatrix<6>& b) {
    return {transposed_product(a.aa, b.aa) + transposed_product(a.ba, b.ba),
            transposed_product(a.aa, b.ab) + transposed_product(a.ba, b.bb),
            transposed_product(a.ab, b.aa) + transposed_product(a.bb, b.ba),
            transposed_product(a.ab, b.ab) + transposed_product(a.bb, b.bb)};
}
inline SmallMatrix<6> transposed(const SmallMatrix<6>& a) {
    return {transposed(a.aa), transposed(a.ba), transposed(a.ab), transposed(a.bb)};
}

}  // namespace leastaction
