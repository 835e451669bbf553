#include "dynamics/tree_newton.hpp"

#include <algorithm>
#include <cmath>

namespace leastaction {

namespace {

// Measured: it is faster from about ten joints in a row on, and in flat trees once clearing a matrix of n^2 entries
// counts. Just below either there is little in it.
constexpr std::size_t deep = 12;
constexpr int large = 64;

// A pivot below this part of the terms that it is the sum of has no digits left.
constexpr double lost_pivot = 1e-12;

}  // namespace

bool TreeNewton::is_faster(const Mechanism& mechanism) {
    std::size_t deepest = 0;
    for (std::size_t k = 0; k < mechanism.coupled.size(); ++k) deepest = std::max(deepest, mechanism.coupled[k].size());
    return deepest >= deep || mechanism.n_dynamic > large;
}

TreeNewton::TreeNewton(const Mechanism& mechanism) {
    // Joints whose variable is kinematic are skipped: children belong to the next dynamic joint above.
    const int n = mechanism.n_dynamic;
    std::vector<int> node_of(mechanism.n_massive, -1), parent(n, -1), children(n + 1, 0);
    for (int joint = 0; joint < mechanism.n_massive; ++joint) {
        const int above = mechanism.joints[joint].parent;
        const int parent_node = above < 0 ? -1 : node_of[above];
        const int variable = mechanism.joints[joint].variable;
        node_of[joint] = parent_node;
        if (variable >= n) continue;
        node_of[joint] = variable;
        parent[variable] = parent_node;
        ++children[parent_node + 1];
        nodes_.push_back({joint});
    }
    int slots = 1;
    for (int i = 0; i < n; ++i) {
        Node& node = nodes_[i];
        node.parent_slot = parent[i] < 0 ? 0 : nodes_[parent[i]].slot;
        const bool only_child = parent[i] >= 0 && children[parent[i] + 1] == 1;
        node.slot = only_child ? node.parent_slot : node.parent_slot + 1;
        node.is_leaf = children[i + 1] == 0;
        node.has_only_child = children[i + 1] == 1;
        slots = std::max(slots, node.slot + 1);
    }
    std::vector<char> seen(n + 1, 0);
    for (int i = n - 1; i >= 0; --i) {
        nodes_[i].is_last_child = !seen[parent[i] + 1];
        seen[parent[i] + 1] = 1;
    }
    factors_.resize(n);
    P_.resize(slots);
    sums_.resize(slots);
    wide_sums_.resize(static_cast<std::size_t>(slots) * rank);
}

bool TreeNewton::factor(const Lagrangian<double>& lagrangian, double dt, const double* diagonal) {
    const double quarter = 0.25 * dt, rate = 1.0 / dt;
    return eliminate([&](int i, int joint, Vector& a, Factors& at) {
        const JointVectors vectors = lagrangian.vectors(joint);
        for (int k = 0; k < 6; ++k) {
            const double S = vectors.S[k], W = vectors.W[k], even = -rate * S - quarter * vectors.G[k], odd = 0.5 * W;
            at.b[k] = even + odd;
            at.c[k] = even - odd;
            at.b[6 + k] = 0.5 * S - quarter * W;
            at.c[6 + k] = -0.5 * S - quarter * W;
        }
        a = Eigen::Map<const Vector>(vectors.AB);
        return diagonal[i];
    });
}

bool TreeNewton::factor(const NewtonEuler& bodies, const double* diagonal) {
    return eliminate([&](int i, int joint, Vector& a, Factors& at) {
        const Motion<double>& S = bodies.at.twist[joint];
        at.b << S.v.x, S.v.y, S.v.z, S.w.x, S.w.y, S.w.z, 0, 0, 0, 0, 0, 0;
        at.c = at.b;
        const double* Y = bodies.inertia_vector(joint);
        a << Y[0], Y[1], Y[2], Y[3], Y[4], Y[5], 0, 0, 0, 0, 0, 0;
        return diagonal[i];
    });
}

template <class Load>
bool TreeNewton::eliminate(const Load& load) {
    for (int i = static_cast<int>(nodes_.size()) - 1; i >= 0; --i) {
        const Node& node = nodes_[i];
        Factors& at = factors_[i];
        Vector u;
        const double diagonal = load(i, node.joint, u, at);
        Vector w = u;

        // Of an only child the update of P is still to be done: it shares the pass over P with the products.
        Projection& P = P_[node.slot];
        if (node.has_only_child) {
            const Factors& child = factors_[i + 1];
            for (int r = 0; r < rank; ++r) {
                const Vector column = P.columns[r] - child.u[r] * child.w, row = P.rows[r] - child.w[r] * child.u;
                P.columns[r] = column;
                P.rows[r] = row;
                w += at.b[r] * column;
                u += at.c[r] * row;
            }
        } else if (node.is_leaf) {
            for (int r = 0; r < rank; ++r) P.columns[r] = P.rows[r] = Vector::Zero();
        } else {
            for (int r = 0; r < rank; ++r) {
                w += at.b[r] * P.columns[r];
                u += at.c[r] * P.rows[r];
            }
        }
        const Vector terms = u * at.b;
        const double pivot = terms.sum() + diagonal;
        const double size = terms.abs().sum() + std::abs(diagonal);
        if (!(std::abs(pivot) > lost_pivot * size) || !std::isfinite(pivot)) return false;
        at.reciprocal = 1.0 / pivot;
        at.w = w;
        at.u = u * at.reciprocal;
        if (node.joins_sum()) {
            Projection& sum = P_[node.parent_slot];
            for (int r = 0; r < rank; ++r) {
                const Vector column = P.columns[r] - at.u[r] * at.w, row = P.rows[r] - at.w[r] * at.u;
                sum.columns[r] = node.is_last_child ? column : Vector(sum.columns[r] + column);
                sum.rows[r] = node.is_last_child ? row : Vector(sum.rows[r] + row);
            }
        }
    }
    return true;
}

void TreeNewton::solve(double* b) {
    const int n = static_cast<int>(nodes_.size());
    Vector f = Vector::Zero(), x = Vector::Zero();  // along a chain they stay in registers
    for (int i = n - 1; i >= 0; --i) {
        const Node& node = nodes_[i];
        const Factors& at = factors_[i];
        if (node.is_leaf)
            f.setZero();
        else if (!node.has_only_child)
            f = sums_[node.slot];
        b[i] = (b[i] - (at.c * f).sum()) * at.reciprocal;
        f += b[i] * at.w;
        if (node.joins_sum()) sums_[node.parent_slot] = node.is_last_child ? f : Vector(sums_[node.parent_slot] + f);
    }
    sums_[0].setZero();
    for (int i = 0; i < n; ++i) {
        const Node& node = nodes_[i];
        const Factors& at = factors_[i];
        if (node.slot != node.parent_slot) x = sums_[node.parent_slot];
        b[i] -= (at.u * x).sum();
        x += b[i] * at.b;
        if (!node.has_only_child) sums_[node.slot] = x;
    }
}

void TreeNewton::solve(double* b, int cols, int ld) {
    const int n = static_cast<int>(nodes_.size());
    for (int first = 0; first < cols; first += lanes) {
        const auto row = [&](int i) { return Eigen::Map<Wide>(b + static_cast<std::size_t>(i) * ld + first); };
        for (int i = n - 1; i >= 0; --i) {
            const Node& node = nodes_[i];
            const Factors& at = factors_[i];
            Wide* f = &wide_sums_[node.slot * rank];
            Wide d = row(i);
            if (node.is_leaf)
                for (int r = 0; r < rank; ++r) f[r].setZero();
            else
                for (int r = 0; r < rank; ++r) d -= at.c[r] * f[r];
            d *= at.reciprocal;
            row(i) = d;
            for (int r = 0; r < rank; ++r) f[r] += at.w[r] * d;
            if (node.joins_sum()) {
                Wide* sum = &wide_sums_[node.parent_slot * rank];
                for (int r = 0; r < rank; ++r) sum[r] = node.is_last_child ? f[r] : Wide(sum[r] + f[r]);
            }
        }
        for (int r = 0; r < rank; ++r) wide_sums_[r].setZero();
        for (int i = 0; i < n; ++i) {
            const Node& node = nodes_[i];
            const Factors& at = factors_[i];
            const Wide* above = &wide_sums_[node.parent_slot * rank];
            Wide* x = &wide_sums_[node.slot * rank];
            Wide d = row(i);
            for (int r = 0; r < rank; ++r) d -= at.u[r] * above[r];
            row(i) = d;
            for (int r = 0; r < rank; ++r) x[r] = above[r] + at.b[r] * d;
        }
    }
}

}  // namespace leastaction
