// What balls that turn along exp add to the Lagrangian: apart, so that mechanisms without these are as quick as without it.
#include "dynamics/lagrangian_gradient.hpp"

namespace leastaction {

namespace {

// of.by'm and m of.by.
SmallMatrix<6> turned_rows(const TurnedJoints& of, const SmallMatrix<6>& m) {
    const SmallMatrix<6>& by = *of.by;
    if (!of.keeps_q) return transposed_product(by, m);
    SmallMatrix<6> out{m.aa, m.ab, transposed_product(by.ab, m.aa), transposed_product(by.ab, m.ab)};
    add_transposed_product(out.aa, by.ba, m.ba);
    add_transposed_product(out.ab, by.ba, m.bb);
    add_transposed_product(out.ba, by.bb, m.ba);
    add_transposed_product(out.bb, by.bb, m.bb);
    return out;
}
SmallMatrix<6> turned_columns(const SmallMatrix<6>& m, const TurnedJoints& of) {
    const SmallMatrix<6>& by = *of.by;
    if (!of.keeps_q) return m * by;
    SmallMatrix<6> out{m.aa, m.aa * by.ab, m.ba, m.ba * by.ab};
    add_product(out.aa, m.ab, by.ba);
    add_product(out.ab, m.ab, by.bb);
    add_product(out.ba, m.bb, by.ba);
    add_product(out.bb, m.bb, by.bb);
    return out;
}

using Row = SmallMatrix<3>::Row;

// Three numbers; the fourth means nothing.
void get_three(const double* from, Row& to) { __builtin_memcpy(&to, from, sizeof(Row)); }
void put_three(const Row& of, double* to) {
    for (int k = 0; k < 3; ++k) to[k] = of[k];
}

SmallMatrix<6> symmetric(const SmallMatrix<6>& m) {
    const SmallMatrix<3> ab = 0.5 * (m.ab + transposed(m.ba));
    return {0.5 * (m.aa + transposed(m.aa)), ab, transposed(ab), 0.5 * (m.bb + transposed(m.bb))};
}

}  // namespace

// Makes second derivatives along exp of a ball's own products (discrete/turning.hpp): by two turns their symmetric part, by a turn
// and a rate the product of the rate's row and the turn's column.
template <class T>
void Lagrangian<T>::order_own_pairs()
    requires(!std::is_same_v<T, Lanes>)
{
    for (const int ball : balls_) {  // of a turn and a rate as of the rate and the turn
        SmallMatrix<6> own = own_products(ball, false);
        own.ab = transposed(own.ba);
        put_own_pairs(ball, symmetric(own));
    }
}

template <class T>
void Lagrangian<T>::turned_products(std::span<const TurnedJoints> turned)
    requires(!std::is_same_v<T, Lanes>)
{
    const int n = mechanism_.n_massive;
    own_.clear();
    const auto is_first = [&](int ball) { return mechanism_.path[ball].size() == 1; };  // its rows see no others
    for (const TurnedJoints& of : turned) {
        if (is_first(of.joint)) own_.push_back(own_turned(of));
        turn(of);
    }
    for (int i = 0; i < n; ++i) {
        if (ball_of_[i] >= 0 && is_first(ball_of_[i])) continue;
        if (i < turned.front().joint)
            pair_products<false>(i);
        else
            pair_products<true>(i);
    }
    auto own = own_.begin();
    for (const TurnedJoints& of : turned) {
        if (is_first(of.joint))
            put_own_pairs(of.joint, of.own + *own++);
        else
            add_to_own_pairs(of.joint, of.own);
    }
}

// To the symmetric part of the products.
template <class T>
void Lagrangian<T>::add_to_own_pairs(int ball, const SmallMatrix<6>& own) {
    auto& [stride, vv, v_q, q_v, qq] = pairs;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j <= i; ++j) {
            const std::size_t ij = (ball + i) * stride + ball + j, ji = (ball + j) * stride + ball + i;
            qq[ij] = 0.5 * (qq[ij] + qq[ji]) + own.aa(i, j);
            vv[ij] = 0.5 * (vv[ij] + vv[ji]) + own.bb(i, j);
            const double of_q = q_v[ij], of_v = v_q[ij];
            q_v[ij] = 0.5 * (of_q + v_q[ji]) + own.ab(i, j);
            v_q[ij] = 0.5 * (of_v + (i == j ? of_q : q_v[ji])) + own.ba(i, j);
        }
}

template <class T>
void Lagrangian<T>::put_own_pairs(int ball, const SmallMatrix<6>& own) {
    const auto write = [&](const SmallMatrix<3>& from, std::vector<double>& plane) {
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j <= i; ++j) plane[(ball + i) * pairs.stride + ball + j] = from(i, j);
    };
    write(own.aa, pairs.qq), write(own.ab, pairs.q_v), write(own.ba, pairs.v_q), write(own.bb, pairs.vv);
}

// The symmetric part of W'HW, and of duals of W'DW + F'HW + W'HF.
template <class T>
SmallMatrix<6> Lagrangian<T>::own_turned(const TurnedJoints& of) const
    requires(!std::is_same_v<T, Lanes>)
{
    SmallMatrix<6> halves = turned_rows(of, 0.5 * own_products(of.joint, false));
    if (parts > 1) halves = halves + transposed_product(*of.along, symmetric(own_products(of.joint, true)));
    const SmallMatrix<6> half = turned_columns(halves, of);
    return half + transposed(half);
}

// Products of the rows and columns of a ball, (q, v) each: as `pairs` holds them, or of duals the values.
template <class T>
SmallMatrix<6> Lagrangian<T>::own_products(int ball, bool values) const
    requires(!std::is_same_v<T, Lanes>)
{
    struct Sums {
        Row vv{}, v_q{}, q_v{}, qq{};
    } rows[3];
    const auto load = [](const double* from, Row& to) { __builtin_memcpy(&to, from, sizeof(Row)); };
    for (int part = 0; part < (values ? 1 : parts); ++part) {
        const double* A = &AB_[values ? 0 : parts - 1 - part][ball * 12];
        for (int c = 0; c < 6; ++c) {
            Row S, W, G;
            load(&S_wide_[part][c * stride_ + ball], S);
            load(&W_wide_[part][c * stride_ + ball], W);
            for (int i = 0; i < 3; ++i) {
                const double a = A[i * 12 + c], b = A[i * 12 + 6 + c];
                rows[i].vv += a * S;
                rows[i].v_q -= a * W;
                rows[i].q_v += b * S;
                rows[i].qq -= b * W;
            }
            if (c >= 3) continue;
            load(&G_wide_[part][c * stride_ + ball], G);
            for (int i = 0; i < 3; ++i) rows[i].qq -= A[i * 12 + c] * G;
        }
    }
    const auto block = [&](Row Sums::* of) { return SmallMatrix<3>{{rows[0].*of, rows[1].*of, rows[2].*of}}; };
    return {block(&Sums::qq), block(&Sums::q_v), block(&Sums::v_q), block(&Sums::vv)};
}

// The vectors of a ball as columns and as rows of products: derivatives first, of the values that were.
template <class T>
template <bool keeps_q>
void Lagrangian<T>::turn_columns(const TurnedJoints& of)
    requires(!std::is_same_v<T, Lanes>)
{
    const int at = of.joint;
    for (int part = parts - 1; part >= 0; --part)
        for (int c = 0; c < 6; ++c) {
            const std::size_t column = c * stride_ + at;
            Row S{}, W{}, G{}, turned_G{};
            const auto add = [&](const SmallMatrix<6>& by, int from, bool keeps) {
                const double *of_S = &S_wide_[from][column], *of_W = &W_wide_[from][column];
                if (keeps) W += Row{of_W[0], of_W[1], of_W[2], 0.0};
                for (int l = 0; l < 3; ++l) {
                    S += of_S[l] * by.bb.rows[l];
                    S -= of_W[l] * by.ab.rows[l];
                    W -= of_S[l] * by.ba.rows[l];
                    if (!keeps) W += of_W[l] * by.aa.rows[l];
                }
                if (c >= 3) return;
                const double* of_G = &G_wide_[from][column];
                if (keeps) G += Row{of_G[0], of_G[1], of_G[2], 0.0};
                for (int l = 0; l < 3; ++l) {
                    turned_G += of_G[l] * by.ab.rows[l];
                    if (!keeps) G += of_G[l] * by.aa.rows[l];
                }
            };
            add(*of.by, part, keeps_q);
            if (part > 0) add(*of.along, 0, false);
            put_three(S, &S_wide_[part][column]);
            put_three(W, &W_wide_[part][column]);
            if (c >= 3) continue;
            put_three(G, &G_wide_[part][column]);
            put_three(turned_G, &turned_G_wide_[part][column]);
        }
}

template <class T>
template <bool keeps_q>
void Lagrangian<T>::turn_rows(const TurnedJoints& of)
    requires(!std::is_same_v<T, Lanes>)
{
    const int at = of.joint;
    for (int part = parts - 1; part >= 0; --part) {
        struct {
            Row A[2]{}, B[2]{}, by_q{}, by_v{};
        } turned[3];  // forces and moments, and the weights of forces
        const auto add = [&](const SmallMatrix<6>& by, int from, bool keeps) {
            for (int l = 0; l < 3; ++l) {
                const double* row = &AB_[from][(at + l) * 12];
                for (int half = 0; half < 2; ++half) {
                    Row of_A, of_B;
                    get_three(row + 3 * half, of_A), get_three(row + 6 + 3 * half, of_B);
                    if (keeps) turned[l].B[half] += of_B;
                    if (keeps && half == 0) turned[l].by_q += of_A;
                    for (int k = 0; k < 3; ++k) {
                        turned[k].A[half] += by.bb(l, k) * of_A;
                        turned[k].A[half] += by.ab(l, k) * of_B;
                        turned[k].B[half] += by.ba(l, k) * of_A;
                        if (!keeps) turned[k].B[half] += by.aa(l, k) * of_B;
                        if (half > 0) continue;
                        turned[k].by_v += by.ab(l, k) * of_A;
                        if (!keeps) turned[k].by_q += by.aa(l, k) * of_A;
                    }
                }
            }
        };
        add(*of.by, part, keeps_q);
        if (part > 0) add(*of.along, 0, false);
        for (int k = 0; k < 3; ++k) {
            double *row = &AB_[part][(at + k) * 12], *weights = &turned_A_[part][(at + k) * 6];
            put_three(turned[k].A[0], row), put_three(turned[k].A[1], row + 3);
            put_three(turned[k].B[0], row + 6), put_three(turned[k].B[1], row + 9);
            put_three(turned[k].by_q, weights), put_three(turned[k].by_v, weights + 3);
        }
    }
}

template <class T>
void Lagrangian<T>::turn(const TurnedJoints& of)
    requires(!std::is_same_v<T, Lanes>)
{
    const int behind = of.joint + 3;
    const bool is_first = mechanism_.path[of.joint].size() == 1;  // its rows see no others
    const bool is_seen = behind < mechanism_.n_massive && mechanism_.joints[behind].parent >= of.joint;
    if (!is_first || is_seen) of.keeps_q ? turn_columns<true>(of) : turn_columns<false>(of);
    if (!is_first) of.keeps_q ? turn_rows<true>(of) : turn_rows<false>(of);
}

#define LEASTACTION_TURNED(T)                                                     \
    template void Lagrangian<T>::gradient_with<true>(const T*, const T*);         \
    template void Lagrangian<T>::order_own_pairs();                               \
    template void Lagrangian<T>::turned_products(std::span<const TurnedJoints>);  \
    template SmallMatrix<6> Lagrangian<T>::own_products(int, bool) const;         \
    template SmallMatrix<6> Lagrangian<T>::own_turned(const TurnedJoints&) const; \
    template void Lagrangian<T>::add_to_own_pairs(int, const SmallMatrix<6>&);    \
    template void Lagrangian<T>::put_own_pairs(int, const SmallMatrix<6>&);       \
    template void Lagrangian<T>::turn(const TurnedJoints&)
LEASTACTION_TURNED(double);
LEASTACTION_TURNED(Dual<double>);
LEASTACTION_TURNED(HyperDual);
template void Lagrangian<Lanes>::gradient_with<true>(const Lanes*, const Lanes*);

}  // namespace leastaction
