// Square matrices of three or six rows, each row in one register: products are sums of whole rows.
#pragma once

#include <Eigen/Core>
#include <cstring>

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
    using Row = Eigen::Array<double, 8, 1>;  // zero beyond six
    Row rows[6];

    double& operator()(int i, int j) { return rows[i][j]; }
    double operator()(int i, int j) const { return rows[i][j]; }
};

template <int n>
SmallMatrix<n> operator+(const SmallMatrix<n>& a, const SmallMatrix<n>& b) {
    SmallMatrix<n> out;
    for (int i = 0; i < n; ++i) out.rows[i] = a.rows[i] + b.rows[i];
    return out;
}
template <int n>
SmallMatrix<n> operator-(const SmallMatrix<n>& a, const SmallMatrix<n>& b) {
    SmallMatrix<n> out;
    for (int i = 0; i < n; ++i) out.rows[i] = a.rows[i] - b.rows[i];
    return out;
}
template <int n>
SmallMatrix<n> operator*(double factor, const SmallMatrix<n>& a) {
    SmallMatrix<n> out;
    for (int i = 0; i < n; ++i) out.rows[i] = factor * a.rows[i];
    return out;
}
template <int n>
SmallMatrix<n> operator*(const SmallMatrix<n>& a, const SmallMatrix<n>& b) {
    SmallMatrix<n> out;
    for (int i = 0; i < n; ++i) {
        out.rows[i] = a(i, 0) * b.rows[0];
        for (int k = 1; k < n; ++k) out.rows[i] = out.rows[i] + a(i, k) * b.rows[k];
    }
    return out;
}
// a'b.
template <int n>
SmallMatrix<n> transposed_product(const SmallMatrix<n>& a, const SmallMatrix<n>& b) {
    SmallMatrix<n> out;
    for (int i = 0; i < n; ++i) {
        out.rows[i] = a(0, i) * b.rows[0];
        for (int k = 1; k < n; ++k) out.rows[i] = out.rows[i] + a(k, i) * b.rows[k];
    }
    return out;
}
inline SmallMatrix<3> transposed(const SmallMatrix<3>& a) {
    using Row = SmallMatrix<3>::Row;
    return {{Row{a(0, 0), a(1, 0), a(2, 0), 0.0}, Row{a(0, 1), a(1, 1), a(2, 1), 0.0},
             Row{a(0, 2), a(1, 2), a(2, 2), 0.0}}};
}
inline SmallMatrix<6> transposed(const SmallMatrix<6>& a) {
    SmallMatrix<6> out{};
    for (int i = 0; i < 6; ++i)
        for (int j = 0; j < 6; ++j) out(j, i) = a(i, j);
    return out;
}
// [aa ab; ba bb]
inline SmallMatrix<6> joined(const SmallMatrix<3>& aa, const SmallMatrix<3>& ab, const SmallMatrix<3>& ba,
                             const SmallMatrix<3>& bb) {
    SmallMatrix<6> out;
    const auto put = [](SmallMatrix<6>::Row& to, const SmallMatrix<3>::Row& left, const SmallMatrix<3>::Row& right) {
        std::memcpy(to.data(), &left, sizeof left);
        std::memcpy(to.data() + 3, &right, sizeof right);
        to[7] = 0.0;
    };
    for (int i = 0; i < 3; ++i) {
        put(out.rows[i], aa.rows[i], ab.rows[i]);
        put(out.rows[3 + i], ba.rows[i], bb.rows[i]);
    }
    return out;
}

}  // namespace leastaction
