#include "dynamics/loop_newton.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace leastaction {

namespace {

constexpr double lost_pivot = 1e-12;   // below this part of the terms that it is the sum of it has no digits left
constexpr double sound_pivot = 1e-3;   // of a multiplier: otherwise it waits
constexpr double nothing = 1e-9;       // of the terms that a force's work on a joint is the sum of
constexpr double no_direction = 1e-9;  // of a twist, outside of the basis: rounding
constexpr double blurred = 0.5;        // of moments about the origin: below this rounding weighs as much as a tolerance
constexpr int spare_slots = 2;         // for multipliers that wait

using Twist = std::array<double, 6>;

Twist components(const Motion<double>& s) { return {s.v.x, s.v.y, s.v.z, s.w.x, s.w.y, s.w.z}; }

Motion<double> motion(const double* s) { return {{s[0], s[1], s[2]}, {s[3], s[4], s[5]}}; }

double dot(const double* a, const double* b, int n) {
    double out = 0;
    for (int i = 0; i < n; ++i) out += a[i] * b[i];
    return out;
}

double size_of(const Vec3<double>& a) { return std::abs(a.x) + std::abs(a.y) + std::abs(a.z); }

}  // namespace

bool LoopNewton::fits(const Mechanism& m) {
    if (!m.plain || !m.only_tree_couples || m.constraints.empty() || !m.balls.empty()) return false;
    const auto moved_alone = [&](int joint) {
        for (; joint >= 0; joint = m.joints[joint].parent)
            if (joint >= m.n_massive || m.joints[joint].variable >= m.n_dynamic) return false;
        return true;
    };
    return std::ranges::all_of(m.constraints, [&](const auto& constraint) {
        const auto points = constraint->points();
        if (!points) return false;
        const int joint1 = m.points[points->first].joint, joint2 = m.points[points->second].joint;
        return joint1 != joint2 && moved_alone(joint1) && moved_alone(joint2);
    });
}

LoopNewton::LoopNewton(const Mechanism& mechanism)
    : mechanism_(mechanism), n_(mechanism.n_dynamic), nc_(mechanism.n_constraints()) {
    std::vector<int> node_of(mechanism.n_massive, -1);
    for (int joint = 0; joint < mechanism.n_massive; ++joint) {
        const int above = mechanism.joints[joint].parent, parent = above < 0 ? -1 : node_of[above];
        const int variable = mechanism.joints[joint].variable;
        node_of[joint] = variable < n_ ? variable : parent;
        if (variable < n_) nodes_.push_back({joint, parent, false});
    }
    for (const auto& constraint : mechanism.constraints) {
        const auto [point1, point2] = *constraint->points();
        int common = -1;
        for (const int point : {point1, point2}) {
            const int joint = mechanism.points[point].joint;
            ends_.push_back(joint < 0 ? -1 : node_of[joint]);
        }
        // Parents have smaller numbers.
        int a = ends_.end()[-2], b = ends_.end()[-1];
        while (a != b) (a > b ? a : b) = nodes_[std::max(a, b)].parent;
        common = a;
        common_.push_back(common);
        for (int side = 1; side <= 2; ++side)
            for (int node = ends_.end()[-side]; node >= 0 && !nodes_[node].constrained; node = nodes_[node].parent)
                nodes_[node].constrained = true;
    }
    find_basis();
    plan();
    const std::size_t ld = ld_, pivots = n_ + nc_;
    P_.resize(ld * ld);
    for (auto* of_front : {&gross_, &front_}) of_front->resize(ld);
    a_.resize(static_cast<std::size_t>(n_) * r_);
    b_.resize(a_.size());
    c_.resize(a_.size());
    rows_.resize(pivots * ld);
    columns_.resize(pivots * ld);
    pivots_.resize(pivots);
    slot_of_.resize(nc_);
    free_.reserve(ld);
    open_.reserve(nc_);
    F_.resize(static_cast<std::size_t>(n_) * k_);
    K_.resize(static_cast<std::size_t>(n_) * 3 * k_ * k_);
    reach_.resize(mechanism.joints.size());
}

bool LoopNewton::is_faster() const {
    // Measured: from about ten segments of a lift on.
    return nc_ >= 16 && static_cast<double>(ld_) * ld_ < 0.5 * static_cast<double>(nc_) * nc_;
}

void LoopNewton::find_basis() {
    std::vector<int> all(mechanism_.joints.size());
    std::iota(all.begin(), all.end(), 0);
    const std::vector<double> q(mechanism_.n_variables());
    Placement<double> at(mechanism_);
    place(all, q.data(), at);
    const auto add = [&](Twist s) {
        const double size = std::sqrt(dot(s.data(), s.data(), 6));
        for (int again = 0; again < 2; ++again)
            for (int k = 0; k < k_; ++k) {
                const double part = dot(s.data(), &basis_[6 * k], 6);
                for (int i = 0; i < 6; ++i) s[i] -= part * basis_[6 * k + i];
            }
        const double rest = std::sqrt(dot(s.data(), s.data(), 6));
        if (!(rest > no_direction * size)) return;
        for (const double x : s) basis_.push_back(x / rest);
        ++k_;
    };
    for (int joint = 0; joint < mechanism_.n_massive; ++joint) add(components(at.twist[joint]));
    for (int i = 0; i < k_; ++i)  // grows on the way
        for (int j = 0; j < i; ++j) add(components(cross(motion(&basis_[6 * i]), motion(&basis_[6 * j]))));
    for (int i = k_ - 1; i >= 0; --i) add(components({cross(motion(&basis_[6 * i]).w, mechanism_.gravity), {}}));
    r_ = 3 * k_;
}

void LoopNewton::plan() {
    std::vector<int> order(n_), depth(n_);
    std::iota(order.rbegin(), order.rend(), 0);
    lay_out(order);
    const int ld = ld_;
    for (int i = 0; i < n_; ++i) depth[i] = nodes_[i].parent < 0 ? 0 : depth[nodes_[i].parent] + 1;
    std::vector<int> by_depth = order;
    std::ranges::stable_sort(by_depth, [&](int a, int b) { return depth[a] > depth[b]; });
    lay_out(by_depth);
    if (ld_ > ld) lay_out(order);
}

void LoopNewton::lay_out(const std::vector<int>& order) {
    steps_.clear();
    attachments_.clear();
    ripe_.clear();
    std::vector<int> place_of(n_), block_of(n_, -1), free_blocks;
    for (int s = 0; s < n_; ++s) place_of[order[s]] = s;
    std::vector<std::vector<Attachment>> attached(n_);
    std::vector<std::vector<int>> ripe(n_);
    std::vector<int> change(n_ + 1);  // of the number of open multipliers
    for (int c = 0; c < nc_; ++c) {
        int first = n_, last = 0;
        for (int side = 0; side < 2; ++side) {
            int node = ends_[2 * c + side];
            if (node < 0) continue;
            first = std::min(first, place_of[node]);
            // What moves a point lies in the joints up to the next body above.
            for (; node >= 0; node = nodes_[node].parent) {
                last = std::max(last, place_of[node]);
                const int above = nodes_[node].parent;
                if (above < 0 || !mechanism_.bodies[nodes_[above].joint].is_empty()) break;
            }
        }
        for (int side = 0; side < 2; ++side)
            if (const int node = ends_[2 * c + side]; node >= 0)
                attached[place_of[node]].push_back({c, side, place_of[node] == first});
        ripe[last].push_back(c);
        ++change[first];
        --change[last + 1];
    }
    int blocks = 0, open = 0, most_open = 0;
    for (int s = 0; s < n_; ++s) {
        const int node = order[s], parent = nodes_[node].parent;
        int& block = block_of[node];
        if (block < 0 && free_blocks.empty()) block = blocks++;
        if (block < 0) {
            block = free_blocks.back();
            free_blocks.pop_back();
        }
        int into = -1;
        if (parent >= 0) {
            if (block_of[parent] < 0) block_of[parent] = block;
            into = block_of[parent];
        }
        if (into != block) free_blocks.push_back(block);
        attachments_.insert(attachments_.end(), attached[s].begin(), attached[s].end());
        ripe_.insert(ripe_.end(), ripe[s].begin(), ripe[s].end());
        steps_.push_back({node, block * r_, into < 0 ? -1 : into * r_, static_cast<int>(attachments_.size()),
                          static_cast<int>(ripe_.size())});
        open += change[s];
        most_open = std::max(most_open, open);
    }
    first_slot_ = blocks * r_;
    ld_ = whole_lanes(first_slot_ + most_open + spare_slots);
}

void LoopNewton::to_basis(const Vec3<double>& v, const Vec3<double>& w, double* out) const {
    const Twist s = components({v, w});
    for (int k = 0; k < k_; ++k) out[k] = dot(&basis_[6 * k], s.data(), 6);
}

LoopNewton::Constraints LoopNewton::make_constraints() const {
    const std::size_t n = n_, nc = nc_, k = k_;
    return {std::vector<double>(n * k), std::vector<double>(2 * nc * k), std::vector<double>(nc),
            std::vector<double>(nc)};
}

void LoopNewton::evaluate(const Placement<double>& at, Constraints& out) {
    for (int i = 0; i < n_; ++i) {
        if (!nodes_[i].constrained) continue;
        const Motion<double>& s = at.twist[nodes_[i].joint];
        to_basis(s.v, s.w, &out.S[i * k_]);
        reach_[i] = std::max(size_of(s.v), nodes_[i].parent < 0 ? 0.0 : reach_[nodes_[i].parent]);
    }
    for (int c = 0; c < nc_; ++c) {
        const ConfigurationFunction& constraint = *mechanism_.constraints[c];
        const auto [point1, point2] = *constraint.points();
        const SlopeByPoints here = constraint.by_points(at);
        out.value[c] = here.value;
        out.scale[c] = here.scale;
        for (int side = 0; side < 2; ++side) {
            const int node = ends_[2 * c + side];
            if (node < 0) continue;
            const Vec3<double> p = at.position(side ? point2 : point1), e = side ? -here.slope : here.slope;
            to_basis(e, cross(p, e), &out.w[(2 * c + side) * k_]);
            // A value is as exact as the places of its points: as what moves them is long.
            out.scale[c] = std::max(out.scale[c], reach_[node]);
        }
    }
}

double LoopNewton::subtract_forces(const Constraints& at, const double* lam, double* residual) {
    double largest = 0, moments = 0;
    std::fill(F_.begin(), F_.end(), 0.0);
    for (int c = 0; c < nc_; ++c)
        for (int side = 0; side < 2; ++side) {
            const int node = ends_[2 * c + side];
            if (node < 0) continue;
            const double* w = &at.w[(2 * c + side) * k_];
            largest = std::max(largest, std::abs(lam[c] * dot(w, &at.S[node * k_], k_)));
            for (int k = 0; k < k_; ++k) F_[node * k_ + k] += lam[c] * w[k];
        }
    for (int i = n_ - 1; i >= 0; --i) {
        if (!nodes_[i].constrained) continue;
        double term = 0, size = 0;
        for (int k = 0; k < k_; ++k) {
            const double part = F_[i * k_ + k] * at.S[i * k_ + k];
            term += part;
            size += std::abs(part);
        }
        largest = std::max(largest, std::abs(term));
        moments = std::max(moments, size);
        residual[i] -= term;
        if (const int parent = nodes_[i].parent; parent >= 0)
            for (int k = 0; k < k_; ++k) F_[parent * k_ + k] += F_[i * k_ + k];
    }
    return std::max(largest, blurred * moments);
}

bool LoopNewton::keeps_directions(const Constraints& start, const Constraints& end, const double* mobility,
                                  double part) {
    // Of a path the sums of mobility S1 S1', S1 S2' and S2 S2'.
    const int k2 = k_ * k_;
    for (int i = 0; i < n_; ++i) {
        if (!nodes_[i].constrained) continue;
        double* K = &K_[static_cast<std::size_t>(i) * 3 * k2];
        const int parent = nodes_[i].parent;
        if (parent < 0)
            std::fill(K, K + 3 * k2, 0.0);
        else
            std::copy_n(&K_[static_cast<std::size_t>(parent) * 3 * k2], 3 * k2, K);
        const double *S1 = &start.S[i * k_], *S2 = &end.S[i * k_];
        for (int a = 0; a < k_; ++a)
            for (int b = 0; b < k_; ++b) {
                K[a * k_ + b] += mobility[i] * S1[a] * S1[b];
                K[k2 + a * k_ + b] += mobility[i] * S1[a] * S2[b];
                K[2 * k2 + a * k_ + b] += mobility[i] * S2[a] * S2[b];
            }
    }
    const auto product = [&](const double* x, const double* K, const double* y) {
        double out = 0;
        for (int a = 0; a < k_; ++a) out += x[a] * dot(&K[a * k_], y, k_);
        return out;
    };
    for (int c = 0; c < nc_; ++c) {
        double size = 0, change = 0;
        const auto add = [&](int node, int side_a, int side_b, double weight) {
            const double* K = &K_[static_cast<std::size_t>(node) * 3 * k2];
            const double *a1 = &start.w[(2 * c + side_a) * k_], *a2 = &end.w[(2 * c + side_a) * k_];
            const double *b1 = &start.w[(2 * c + side_b) * k_], *b2 = &end.w[(2 * c + side_b) * k_];
            const double before = weight * product(a1, K, b1);
            size += before;
            change +=
                before + weight * (product(a2, K + 2 * k2, b2) - product(a1, K + k2, b2) - product(b1, K + k2, a2));
        };
        for (int side = 0; side < 2; ++side)
            if (const int node = ends_[2 * c + side]; node >= 0) add(node, side, side, 1.0);
        if (common_[c] >= 0) add(common_[c], 0, 1, 2.0);
        if (!(change <= part * part * size)) return false;
    }
    return true;
}

void LoopNewton::subtract_product(const double* w, const double* u, double reciprocal) {
    for (int j = 0; j < ld_; ++j) {
        if (w[j] == 0.0) continue;
        const double factor = w[j] * reciprocal;
        double* row = &P_[static_cast<std::size_t>(j) * ld_];
        for (int i = 0; i < ld_; i += lanes) Eigen::Map<Wide>(row + i) -= factor * Eigen::Map<const Wide>(u + i);
    }
}

bool LoopNewton::factor(const Lagrangian<double>& lagrangian, double dt, const double* diagonal,
                        const Constraints& start, const Constraints& end) {
    // Loops of a length that the compiler knows are twice as fast.
    return k_ == 3 ? eliminate<3>(lagrangian, dt, diagonal, start, end)
                   : eliminate<0>(lagrangian, dt, diagonal, start, end);
}

template <int known>
bool LoopNewton::eliminate(const Lagrangian<double>& lagrangian, double dt, const double* diagonal,
                           const Constraints& start, const Constraints& end) {
    const int k_ = known ? known : this->k_, r_ = 3 * k_;
    const double quarter = 0.25 * dt, rate = 1.0 / dt;
    const std::size_t ld = ld_;
    std::fill(P_.begin(), P_.end(), 0.0);
    std::fill(gross_.begin(), gross_.end(), 0.0);
    free_.clear();
    open_.clear();
    for (int slot = ld_ - 1; slot >= first_slot_; --slot) free_.push_back(slot);
    sign_ = 1;
    int pivots = 0, attached = 0, ripened = 0;
    const auto note = [&](double pivot, int step, int constraint, int slot) {
        if (pivot < 0) sign_ = -sign_;
        pivots_[pivots++] = {step, constraint, slot, 1.0 / pivot};
    };
    for (int s = 0; s < n_; ++s) {
        const Step& step = steps_[s];
        const int o = step.block, oc = o + 2 * k_;
        for (; attached < step.attach_end; ++attached) {
            const auto [constraint, side, is_first] = attachments_[attached];
            if (is_first) {
                if (free_.empty()) return false;
                slot_of_[constraint] = free_.back();
                free_.pop_back();
            }
            const int slot = slot_of_[constraint];
            const double *w1 = &start.w[(2 * constraint + side) * k_], *w2 = &end.w[(2 * constraint + side) * k_];
            for (int k = 0; k < k_; ++k) {
                P_[(oc + k) * ld + slot] -= w1[k];
                P_[slot * ld + oc + k] += w2[k];
            }
        }

        const int node = step.node;
        double *a = &a_[node * r_], *b = &b_[node * r_], *c = &c_[node * r_];
        {
            const JointVectors at = lagrangian.vectors(nodes_[node].joint);
            for (int k = 0; k < k_; ++k) {
                const double* e = &basis_[6 * k];
                const double S = dot(e, at.S, 6), W = dot(e, at.W, 6), G = dot(e, at.G, 6);
                const double even = -rate * S - quarter * G, odd = 0.5 * W;
                a[k] = dot(e, at.AB, 6);
                a[k_ + k] = dot(e, at.AB + 6, 6);
                b[k] = even + odd;
                c[k] = even - odd;
                b[k_ + k] = 0.5 * S - quarter * W;
                c[k_ + k] = -0.5 * S - quarter * W;
                b[2 * k_ + k] = end.S[node * k_ + k];
                c[2 * k_ + k] = start.S[node * k_ + k];
            }
        }
        double *u = &rows_[pivots * ld], *w = &columns_[pivots * ld];
        std::fill(u, u + ld, 0.0);
        for (int i = 0; i < r_; ++i) {
            const double* row = &P_[(o + i) * ld];
            for (int j = 0; j < ld_; j += lanes) Eigen::Map<Wide>(u + j) += c[i] * Eigen::Map<const Wide>(row + j);
        }
        for (int j = 0; j < ld_; ++j) w[j] = dot(&P_[j * ld + o], b, r_);
        for (int i = 0; i < 2 * k_; ++i) {
            u[o + i] += a[i];
            w[o + i] += a[i];
        }
        double pivot = diagonal[node], size = std::abs(pivot);
        for (int i = 0; i < r_; ++i) {
            const double term = u[o + i] * b[i];
            pivot += term;
            size += std::abs(term);
        }
        if (!(std::abs(pivot) > lost_pivot * size) || !std::isfinite(pivot)) return false;
        for (int slot = first_slot_; slot < ld_; ++slot) {
            // What moves a point may not move it along the constraint at all, but for rounding.
            double by_row = 0, by_column = 0;
            for (int i = 0; i < r_; ++i) {
                by_row += std::abs(P_[slot * ld + o + i] * b[i]);
                by_column += std::abs(c[i] * P_[(o + i) * ld + slot]);
            }
            gross_[slot] += (std::abs(w[slot] * u[slot]) + nothing * by_row * by_column) / std::abs(pivot);
        }
        subtract_product(w, u, 1.0 / pivot);
        note(pivot, s, -1, -1);

        if (step.into != o) {
            // The rows and columns of the block join those of another, or end at the world.
            for (int i = 0; i < r_; ++i) {
                double* row = &P_[(o + i) * ld];
                if (step.into >= 0) {
                    double* to = &P_[(step.into + i) * ld];
                    for (int j = 0; j < ld_; ++j) to[j] += row[j];
                }
                std::fill(row, row + ld, 0.0);
            }
            for (int j = 0; j < ld_; ++j) {
                double* row = &P_[j * ld];
                if (step.into >= 0)
                    for (int i = 0; i < r_; ++i) row[step.into + i] += row[o + i];
                std::fill(row + o, row + o + r_, 0.0);
            }
        }

        for (; ripened < step.ripe_end; ++ripened) open_.push_back(ripe_[ripened]);
        while (!open_.empty()) {
            std::size_t best = 0;
            double soundest = -1;
            for (std::size_t i = 0; i < open_.size(); ++i) {
                const int slot = slot_of_[open_[i]];
                const double part = std::abs(P_[slot * ld + slot]) / gross_[slot];
                if (!(part <= soundest)) {
                    soundest = part;
                    best = i;
                }
            }
            if (!(soundest > sound_pivot)) break;
            const int constraint = open_[best], slot = slot_of_[constraint];
            open_[best] = open_.back();
            open_.pop_back();
            double *row = &rows_[pivots * ld], *column = &columns_[pivots * ld];
            const double at = P_[slot * ld + slot];
            if (!std::isfinite(at)) return false;
            std::copy_n(&P_[slot * ld], ld, row);
            for (int j = 0; j < ld_; ++j) column[j] = P_[j * ld + slot];
            row[slot] = column[slot] = 0.0;
            subtract_product(column, row, 1.0 / at);
            std::fill_n(&P_[slot * ld], ld, 0.0);
            for (int j = 0; j < ld_; ++j) P_[j * ld + slot] = 0.0;
            gross_[slot] = 0.0;
            free_.push_back(slot);
            note(at, s, constraint, slot);
        }
    }
    return open_.empty();
}

double LoopNewton::log2_determinant() const {
    double out = 0;
    for (const Pivot& pivot : pivots_) out -= std::log2(std::abs(pivot.reciprocal));
    return out;
}

void LoopNewton::solve(double* f, double* g) {
    const std::size_t ld = ld_;
    double* front = front_.data();
    std::fill(front_.begin(), front_.end(), 0.0);
    int attached = 0;
    const auto add_multiple = [&](double factor, const double* column) {
        for (int j = 0; j < ld_; j += lanes) Eigen::Map<Wide>(front + j) += factor * Eigen::Map<const Wide>(column + j);
    };
    const auto along = [&](const double* row) {
        Wide sum = Wide::Zero();
        for (int j = 0; j < ld_; j += lanes) sum += Eigen::Map<const Wide>(row + j) * Eigen::Map<const Wide>(front + j);
        return sum.sum();
    };
    for (std::size_t p = 0; p < pivots_.size(); ++p) {
        const auto [s, constraint, slot, reciprocal] = pivots_[p];
        if (constraint >= 0) {
            g[constraint] = -front[slot] * reciprocal;
            add_multiple(g[constraint], &columns_[p * ld]);
            front[slot] = 0.0;
            continue;
        }
        const Step& step = steps_[s];
        for (; attached < step.attach_end; ++attached)
            if (const Attachment& at = attachments_[attached]; at.is_first)
                front[slot_of_[at.constraint]] -= g[at.constraint];
        double* own = front + step.block;
        f[step.node] = (f[step.node] - dot(&c_[step.node * r_], own, r_)) * reciprocal;
        add_multiple(f[step.node], &columns_[p * ld]);
        if (step.into == step.block) continue;
        for (int i = 0; i < r_; ++i) {
            if (step.into >= 0) front[step.into + i] += own[i];
            own[i] = 0.0;
        }
    }
    std::fill(front_.begin(), front_.end(), 0.0);
    for (std::size_t p = pivots_.size(); p-- > 0;) {
        const auto [s, constraint, slot, reciprocal] = pivots_[p];
        if (constraint >= 0) {
            front[slot] = 0.0;
            g[constraint] -= along(&rows_[p * ld]) * reciprocal;
            front[slot] = g[constraint];
            continue;
        }
        const Step& step = steps_[s];
        double* own = front + step.block;
        if (step.into != step.block)
            for (int i = 0; i < r_; ++i) own[i] = step.into >= 0 ? front[step.into + i] : 0.0;
        f[step.node] -= along(&rows_[p * ld]) * reciprocal;
        for (int i = 0; i < r_; ++i) own[i] += f[step.node] * b_[step.node * r_ + i];
    }
}

}  // namespace leastaction
