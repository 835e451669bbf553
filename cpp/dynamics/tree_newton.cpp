#include "dynamics/tree_newton.hpp"

#include <algorithm>
#include <cmath>
#include <type_traits>
#include <utility>

namespace leastaction {

namespace {

// Measured: it is faster from about ten joints in a row on, and in flat trees once clearing a matrix of n^2 entries
// counts. Just below either there is little in it.
constexpr std::size_t deep = 12;
constexpr int large = 64;

// A pivot below this part of the terms that it is the sum of has no digits left.
constexpr double lost_pivot = 1e-12;

using Inverse = std::array<std::array<double, 3>, 3>;

template <class T>
void multiply(const Inverse& by, T* d) {
    const T r[3] = {d[0], d[1], d[2]};
    for (int k = 0; k < 3; ++k) d[k] = by[k][0] * r[0] + by[k][1] * r[1] + by[k][2] * r[2];
}

// [a; b] of six numbers each, in whole rows.
inline void stack(const double* a, const double* b, double* out) {
    using Row = SmallMatrix<3>::Row;
    typedef double Half __attribute__((vector_size(16)));
    Row first, last;
    Half end, begin;
    __builtin_memcpy(&first, a, sizeof(Row));
    __builtin_memcpy(&end, a + 4, sizeof(Half));
    __builtin_memcpy(&begin, b, sizeof(Half));
    __builtin_memcpy(&last, b + 2, sizeof(Row));
    const Row middle{end[0], end[1], begin[0], begin[1]};
    __builtin_memcpy(out, &first, sizeof(Row));
    __builtin_memcpy(out + 4, &middle, sizeof(Row));
    __builtin_memcpy(out + 8, &last, sizeof(Row));
}

bool is_lost(double pivot, double size) { return !(std::abs(pivot) > lost_pivot * size) || !std::isfinite(pivot); }

}  // namespace

bool TreeNewton::is_faster(const Mechanism& mechanism) {
    std::size_t deepest = 0;
    for (std::size_t k = 0; k < mechanism.coupled.size(); ++k) deepest = std::max(deepest, mechanism.coupled[k].size());
    return deepest >= deep || mechanism.n_dynamic > large;
}

TreeNewton::TreeNewton(const Mechanism& mechanism, bool turning) {
    const int n = mechanism.n_dynamic, n_massive = mechanism.n_massive;
    std::vector<int> ball_of(n_massive, -1);
    for (std::size_t b = 0; turning && b < mechanism.balls.size(); ++b)
        if (!mechanism.balls[b].prescribed) std::fill_n(&ball_of[mechanism.balls[b].joint], 3, static_cast<int>(b));
    // Joints whose variable is kinematic are skipped: children belong to the next dynamic joint above.
    std::vector<int> node_of(n_massive, -1), parent, children(n + 1, 0);
    for (int joint = 0; joint < n_massive; ++joint) {
        const int above = mechanism.joints[joint].parent, ball = ball_of[joint];
        const int parent_node = above < 0 ? -1 : node_of[above];
        const int variable = mechanism.joints[joint].variable;
        node_of[joint] = parent_node;
        if (variable >= n || (ball >= 0 && joint > mechanism.balls[ball].joint)) continue;
        node_of[joint] = static_cast<int>(nodes_.size());
        parent.push_back(parent_node);
        ++children[parent_node + 1];
        nodes_.push_back({joint, variable, ball});
    }
    int slots = 1;
    for (std::size_t i = 0; i < nodes_.size(); ++i) {
        Node& node = nodes_[i];
        node.parent_slot = parent[i] < 0 ? 0 : nodes_[parent[i]].slot;
        const bool only_child = parent[i] >= 0 && children[parent[i] + 1] == 1;
        node.slot = only_child ? node.parent_slot : node.parent_slot + 1;
        node.is_leaf = children[i + 1] == 0;
        node.has_only_child = children[i + 1] == 1;
        slots = std::max(slots, node.slot + 1);
    }
    std::vector<char> seen(n + 1, 0);
    for (std::size_t i = nodes_.size(); i-- > 0;) {
        nodes_[i].is_last_child = !seen[parent[i] + 1];
        seen[parent[i] + 1] = 1;
    }
    factors_.resize(n);
    inverses_.resize(mechanism.balls.size());
    P_.resize(slots);
    sums_.resize(slots);
    wide_sums_.resize(static_cast<std::size_t>(slots) * rank);
}

bool TreeNewton::factor(const Lagrangian<double>& lagrangian, double dt, const double* diagonal,
                        const BallTurn* turns) {
    const double quarter = 0.25 * dt, rate = 1.0 / dt;
    const auto ball = [&](const Node& node, Vector* u, Vector* w, Factors* at, Block& block) {
        load_ball(lagrangian, node.joint, dt, turns[node.ball], u, w, at, block);
    };
    const auto variable = [&](const Node& node, Vector* u, Vector* w, Factors* at, Block& block) {
        const JointVectors vectors = lagrangian.vectors(node.joint);
        for (int k = 0; k < 6; ++k) {
            const double S = vectors.S[k], W = vectors.W[k], even = -rate * S - quarter * vectors.G[k], odd = 0.5 * W;
            at->b[k] = even + odd;
            at->c[k] = even - odd;
            at->b[6 + k] = 0.5 * S - quarter * W;
            at->c[6 + k] = -0.5 * S - quarter * W;
        }
        *u = *w = Eigen::Map<const Vector>(vectors.AB);
        block[0][0] = diagonal[node.variable];
    };
    return eliminate(variable, ball);
}

void TreeNewton::load_ball(const Lagrangian<double>& lagrangian, int joint, double dt, const BallTurn& turn, Vector* u,
                           Vector* w, Factors* at, Block& block) {
    using Weight = Eigen::Array<double, 4, 1>;
    const SmallMatrix<6>& by = *turn.by_ends;
    const double half = 0.5 * dt, four = 4.0 / dt;
    // Put together first, as whole rows, which are quickly in memory when they are read: [S; S], [W; W], [A; B] as a row and as
    // a column, [0; A] and G.
    struct Pairs {
        Vector SS, WW, row, column, A;
        Weight G;
    } pairs[3];
    for (int l = 0; l < 3; ++l) {
        Pairs& to = pairs[l];
        const Motion<double>& S = lagrangian.at.twist[joint + l];
        const double* AB = lagrangian.AB(joint + l);
        stack(&S.v.x, &S.v.x, to.SS.data());
        stack(&lagrangian.W(joint + l).v.x, &lagrangian.W(joint + l).v.x, to.WW.data());
        constexpr double none[6] = {};
        Vector A;
        stack(none, AB, A.data());
        const Vector twice = 2.0 * Eigen::Map<const Vector>(AB), more = four * A;
        to.row = twice + more;
        to.column = twice - more;
        to.A = 2.0 * A;
        const Vec3<double> G = half * cross(S.w, lagrangian.gravity());
        to.G << G.x, G.y, G.z, 0.0;
    }
    Vector up, down;  // what turns X into c and b
    for (int c = 0; c < 6; ++c) up[c] = 1.0, down[c] = -1.0, up[6 + c] = down[6 + c] = half;
    for (int k = 0; k < 3; ++k) {
        Vector start = Vector::Zero(), end = Vector::Zero(), row = Vector::Zero(), column = Vector::Zero();
        Weight of_start = Weight::Zero(), of_end = Weight::Zero();
        for (int l = 0; l < 3; ++l) {
            const Pairs& of = pairs[l];
            const double x_start = by.aa(l, k), n_start = by.ba(l, k), x_end = by.ab(l, k), n_end = by.bb(l, k);
            // Product by product: of two at once only one would be added as it is made.
            start += n_start * of.SS;
            start -= x_start * of.WW;
            end += n_end * of.SS;
            end -= x_end * of.WW;
            of_start += x_start * of.G;
            of_end += x_end * of.G;
            row += x_start * of.row;
            row += n_start * of.A;
            column += x_end * of.column;
            column += n_end * of.A;
        }
        at[k].c = up * start;
        at[k].b = down * end;
        at[k].c.head<4>() -= of_start;
        at[k].b.head<4>() -= of_end;
        u[k] = row;
        w[k] = column;
        for (int l = 0; l < 3; ++l) block[k][l] = turn.more(k, l);
    }
}

bool TreeNewton::factor(const NewtonEuler& bodies, const double* diagonal) {
    const auto variable = [&](const Node& node, Vector* u, Vector* w, Factors* at, Block& block) {
        const Motion<double>& S = bodies.at.twist[node.joint];
        at->b << S.v.x, S.v.y, S.v.z, S.w.x, S.w.y, S.w.z, 0, 0, 0, 0, 0, 0;
        at->c = at->b;
        const double* Y = bodies.inertia_vector(node.joint);
        *u << Y[0], Y[1], Y[2], Y[3], Y[4], Y[5], 0, 0, 0, 0, 0, 0;
        *w = *u;
        block[0][0] = diagonal[node.variable];
    };
    return eliminate(variable, nullptr);
}

template <class Load, class LoadBall>
bool TreeNewton::eliminate(const Load& load, const LoadBall& load_ball) {
    for (std::size_t n = nodes_.size(); n-- > 0;) {
        if constexpr (!std::is_null_pointer_v<LoadBall>) {
            if (nodes_[n].ball >= 0) {
                if (!eliminate_node<3>(n, load_ball)) return false;
                continue;
            }
        }
        if (!eliminate_node<1>(n, load)) return false;
    }
    return true;
}

// Adds P b to w and P'c to u. Of an only child with `below` variables the update of P is still to be done: it shares the pass
// over P with the products.
template <int size, int below>
[[gnu::always_inline]] inline void TreeNewton::add_products(Projection& P, const Factors* below_it, Factors* at,
                                                            Vector* u, Vector* w) {
    for (int r = 0; r < rank; ++r) {
        Vector column = P.columns[r], row = P.rows[r];
        for (int k = 0; k < below; ++k) {
            column -= below_it[k].u[r] * below_it[k].w;
            row -= below_it[k].w[r] * below_it[k].u;
        }
        if (below > 0) {
            P.columns[r] = column;
            P.rows[r] = row;
        }
        for (int k = 0; k < size; ++k) {
            w[k] += at[k].b[r] * column;
            u[k] += at[k].c[r] * row;
        }
    }
}

template <int size>
void TreeNewton::join_sum(const Node& node) {
    const Projection& P = P_[node.slot];
    Projection& sum = P_[node.parent_slot];
    const Factors* at = &factors_[node.variable];
    for (int r = 0; r < rank; ++r) {
        Vector column = P.columns[r], row = P.rows[r];
        for (int k = 0; k < size; ++k) {
            column -= at[k].u[r] * at[k].w;
            row -= at[k].w[r] * at[k].u;
        }
        sum.columns[r] = node.is_last_child ? column : Vector(sum.columns[r] + column);
        sum.rows[r] = node.is_last_child ? row : Vector(sum.rows[r] + row);
    }
}

template <int size, class Load>
[[gnu::always_inline]] inline bool TreeNewton::eliminate_node(std::size_t n, const Load& load) {
    const Node& node = nodes_[n];
    Factors* at = &factors_[node.variable];
    Vector u[size], w[size];
    Block block;
    load(node, u, w, at, block);

    Projection& P = P_[node.slot];
    if (node.has_only_child) {
        const Node& child = nodes_[n + 1];
        if (child.ball < 0)
            add_products<size, 1>(P, &factors_[child.variable], at, u, w);
        else
            add_products<size, 3>(P, &factors_[child.variable], at, u, w);
    } else if (node.is_leaf) {
        for (int r = 0; r < rank; ++r) P.columns[r] = P.rows[r] = Vector::Zero();
    } else {
        add_products<size, 0>(P, nullptr, at, u, w);
    }
    if constexpr (size == 1) {
        const Vector terms = u[0] * at->b;
        const double diagonal = block[0][0], pivot = terms.sum() + diagonal;
        if (is_lost(pivot, terms.abs().sum() + std::abs(diagonal))) return false;
        at->reciprocal = 1.0 / pivot;
        at->w = w[0];
        at->u = u[0] * at->reciprocal;
    } else {
        double size_of[3];
        for (int k = 0; k < 3; ++k) {
            size_of[k] = std::abs(block[k][k]) + (u[k] * at[k].b).abs().sum();
            for (int l = 0; l < 3; ++l) block[k][l] += (u[k] * at[l].b).sum();
        }
        // Inverted in place, from the last variable on.
        for (int k = 2; k >= 0; --k) {
            const double pivot = block[k][k];
            if (is_lost(pivot, size_of[k])) return false;
            at[k].reciprocal = 1.0 / pivot;
            block[k][k] = 1.0;
            for (int j = 0; j < 3; ++j) block[k][j] *= at[k].reciprocal;
            for (int i = 0; i < 3; ++i) {
                if (i == k) continue;
                const double factor = std::exchange(block[i][k], 0.0);
                for (int j = 0; j < 3; ++j) block[i][j] -= factor * block[k][j];
            }
        }
        Vector c[3];
        for (int k = 0; k < 3; ++k) {
            const double* row = block[k];
            c[k] = row[0] * at[0].c + row[1] * at[1].c + row[2] * at[2].c;
            at[k].u = row[0] * u[0] + row[1] * u[1] + row[2] * u[2];
            at[k].w = w[k];
            std::copy_n(row, 3, inverses_[node.ball][k].begin());
        }
        for (int k = 0; k < 3; ++k) at[k].c = c[k];
    }
    if (node.joins_sum()) join_sum<size>(node);
    return true;
}

// Calls f(its variables' count, a node).
template <class F>
[[gnu::always_inline]] inline void TreeNewton::by_size(const Node& node, const F& f) {
    if (node.ball < 0)
        f(std::integral_constant<int, 1>(), node);
    else
        f(std::integral_constant<int, 3>(), node);
}

void TreeNewton::solve(double* b) {
    Vector f = Vector::Zero(), x = Vector::Zero();  // along a chain they stay in registers
    const auto up = [&](auto size, const Node& node) {
        const Factors* at = &factors_[node.variable];
        double* d = b + node.variable;
        if (node.is_leaf)
            f.setZero();
        else if (!node.has_only_child)
            f = sums_[node.slot];
        if constexpr (size == 1)
            *d = (*d - (at->c * f).sum()) * at->reciprocal;
        else {
            multiply(inverses_[node.ball], d);
            for (int k = 0; k < size; ++k) d[k] -= (at[k].c * f).sum();
        }
        for (int k = 0; k < size; ++k) f += d[k] * at[k].w;
        if (node.joins_sum()) sums_[node.parent_slot] = node.is_last_child ? f : Vector(sums_[node.parent_slot] + f);
    };
    const auto down = [&](auto size, const Node& node) {
        const Factors* at = &factors_[node.variable];
        double* d = b + node.variable;
        if (node.slot != node.parent_slot) x = sums_[node.parent_slot];
        for (int k = 0; k < size; ++k) d[k] -= (at[k].u * x).sum();
        for (int k = 0; k < size; ++k) x += d[k] * at[k].b;
        if (!node.has_only_child) sums_[node.slot] = x;
    };
    for (std::size_t n = nodes_.size(); n-- > 0;) by_size(nodes_[n], up);
    sums_[0].setZero();
    for (const Node& node : nodes_) by_size(node, down);
}

void TreeNewton::solve(double* b, int cols, int ld) {
    for (int first = 0; first < cols; first += lanes) {
        const auto row = [&](int i) { return Eigen::Map<Wide>(b + static_cast<std::size_t>(i) * ld + first); };
        const auto up = [&](auto size, const Node& node) {
            const Factors* at = &factors_[node.variable];
            Wide* f = &wide_sums_[node.slot * rank];
            Wide d[size];
            for (int k = 0; k < size; ++k) d[k] = row(node.variable + k);
            if constexpr (size == 3) multiply(inverses_[node.ball], d);
            if (node.is_leaf)
                for (int r = 0; r < rank; ++r) f[r].setZero();
            else
                for (int k = 0; k < size; ++k)
                    for (int r = 0; r < rank; ++r) d[k] -= at[k].c[r] * f[r];
            if constexpr (size == 1) d[0] *= at->reciprocal;
            for (int k = 0; k < size; ++k) {
                row(node.variable + k) = d[k];
                for (int r = 0; r < rank; ++r) f[r] += at[k].w[r] * d[k];
            }
            if (node.joins_sum()) {
                Wide* sum = &wide_sums_[node.parent_slot * rank];
                for (int r = 0; r < rank; ++r) sum[r] = node.is_last_child ? f[r] : Wide(sum[r] + f[r]);
            }
        };
        const auto down = [&](auto size, const Node& node) {
            const Factors* at = &factors_[node.variable];
            const Wide* above = &wide_sums_[node.parent_slot * rank];
            Wide* x = &wide_sums_[node.slot * rank];
            Wide d[size];
            for (int k = 0; k < size; ++k) {
                d[k] = row(node.variable + k);
                for (int r = 0; r < rank; ++r) d[k] -= at[k].u[r] * above[r];
                row(node.variable + k) = d[k];
            }
            for (int r = 0; r < rank; ++r) {
                Wide sum = above[r];
                for (int k = 0; k < size; ++k) sum += at[k].b[r] * d[k];
                x[r] = sum;
            }
        };
        for (std::size_t n = nodes_.size(); n-- > 0;) by_size(nodes_[n], up);
        for (int r = 0; r < rank; ++r) wide_sums_[r].setZero();
        for (const Node& node : nodes_) by_size(node, down);
    }
}

}  // namespace leastaction
