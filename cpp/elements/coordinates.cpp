#include "elements/coordinates.hpp"

#include <algorithm>
#include <cmath>

#include "numerics/dual_functions.hpp"

namespace leastaction {

using std::abs;

namespace {

std::vector<int> above_points(const Constants& constants, const std::vector<int>& points,
                              const std::vector<int>& directions = {}) {
    std::vector<int> out;
    for (const int p : points) out = either(out, joints_above(constants.joints, constants.points[p].joint));
    for (const int d : directions) out = either(out, joints_above(constants.joints, constants.directions[d].joint));
    return out;
}

// The joints that move one point relative to the next.
std::vector<int> that_stretch(const Constants& constants, const std::vector<int>& points) {
    std::vector<int> out;
    for (std::size_t k = 0; k + 1 < points.size(); ++k)
        out = either(out, only_one(joints_above(constants.joints, constants.points[points[k]].joint),
                                   joints_above(constants.joints, constants.points[points[k + 1]].joint)));
    return out;
}

template <class T>
T length_of(const Vec3<T>& d) {
    using std::sqrt;
    return sqrt(dot(d, d));
}
double reciprocal(double x) { return 1.0 / x; }
Lanes reciprocal(const Lanes& x) { return 1.0 / x; }
template <class T>
Dual<T> reciprocal(const Dual<T>& x) {
    const T r = reciprocal(x.v);
    return {r, -(r * r * x.d)};
}

template <class T>
T sum_of(const T* a, const T* b, int n) {
    T out{};
    for (int i = 0; i < n; ++i) out += a[i] * b[i];
    return out;
}

// f = sum over the products of sign * z[a].z[b], whose Hessian is constant.
struct Product {
    int a, b;
    double sign;
};
constexpr Product component[] = {{6, 0, 1.0}, {6, 3, -1.0}}, product[] = {{0, 3, 1.0}};

template <const auto& products>
struct Bilinear {
    template <class T>
    void on(const LocalCall<T>& call) const {
        const T* z = call.z;
        call.value = T{};
        if (call.order != Order::value) std::fill_n(call.gradient, call.n, T{});
        if (call.order == Order::hessian) std::fill_n(call.hessian, call.n * call.n, T{});
        for (const auto& [first, second, sign] : products)
            for (int c = 0; c < 3; ++c) {
                const int a = first + c, b = second + c;
                call.value += sign * (z[a] * z[b]);
                if (call.order == Order::value) continue;
                call.gradient[a] += sign * z[b];
                call.gradient[b] += sign * z[a];
                if (call.order == Order::gradient) continue;
                call.hessian[a * call.n + b] += T(sign);
                call.hessian[b * call.n + a] += T(sign);
            }
    }
};

}  // namespace

Combination::Combination(std::vector<int> variables, std::vector<int> factor_slots) : slots_(std::move(factor_slots)) {
    support_ = std::move(variables);
}

template <class T>
void Combination::evaluate_on(const Placement<T>& at, const T* q, Order order, LocalTaylor<T>& out) const {
    const std::size_t m = support_.size();
    out.value = T{};
    out.scale = {};
    for (std::size_t i = 0; i < m; ++i) {
        const T term = at.number(slots_[i]) * q[support_[i]];
        out.value += term;
        raise(out.scale, abs(value_of(term)));
    }
    if (order == Order::value) return;
    out.gradient.resize(m);
    for (std::size_t i = 0; i < m; ++i) out.gradient[i] = at.number(slots_[i]);
    if (order == Order::hessian) out.hessian.assign(m * m, T{});
}

PathLength::PathLength(const Constants& constants, std::vector<int> points)
    : points_(std::move(points)), support_joints_(constants.joints, that_stretch(constants, points_)) {
    support_ = support_joints_.support();
    joints_ = above_points(constants, points_);
    for (std::size_t k = 0; k + 1 < points_.size(); ++k) {
        pieces_.emplace_back();
        for (int i = 0; i < support_joints_.count(); ++i) {
            const bool first = is_above(constants.joints, support_joints_.joint(i), constants.points[points_[k]].joint);
            const bool second =
                is_above(constants.joints, support_joints_.joint(i), constants.points[points_[k + 1]].joint);
            if (first != second) pieces_.back().push_back({i, support_joints_.joint(i), first});
        }
    }
}

template <class T>
void PathLength::evaluate_on(const Placement<T>& at, const T*, Order order, LocalTaylor<T>& out) const {
    const std::size_t m = support_joints_.size();
    out.value = T{};
    out.scale = {};
    if (order != Order::value) out.gradient.assign(m, T{});
    if (order == Order::hessian) out.hessian.assign(m * m, T{});
    out.work.resize(4 * m);
    Vec3<T>* D = reinterpret_cast<Vec3<T>*>(out.work.data());
    T* along = out.work.data() + 3 * m;  // n.D_i
    Vec3<T> p1 = at.position(points_[0]);
    for (std::size_t k = 0; k < pieces_.size(); ++k) {
        const Vec3<T> p2 = at.position(points_[k + 1]), d = p1 - p2;
        const std::vector<End>& ends = pieces_[k];
        const T length = length_of(d);
        out.value += length;
        raise(out.scale, value_of(length));
        for (const T& x : {p1.x, p1.y, p1.z}) raise(out.scale, abs(value_of(x)));
        if (order != Order::value && !ends.empty()) {
            const T r = reciprocal(length);
            const Vec3<T> n = r * d;
            for (std::size_t i = 0; i < ends.size(); ++i) {
                const Motion<T>& s = at.twist[ends[i].joint];
                D[i] = ends[i].first ? s.v + cross(s.w, p1) : -(s.v + cross(s.w, p2));
                along[i] = dot(n, D[i]);
                out.gradient[ends[i].index] += along[i];
            }
            if (order == Order::hessian)
                for (std::size_t j = 0; j < ends.size(); ++j) {
                    const Vec3<T> across = r * (D[j] - along[j] * n);
                    const Vec3<T> carried = across + cross(n, at.twist[ends[j].joint].w);
                    for (std::size_t i = j; i < ends.size(); ++i) {
                        const int a = ends[i].index, b = ends[j].index;
                        const T value = dot(D[i], support_joints_.above(b, a) ? carried : across);
                        out.hessian[a * m + b] += value;
                        if (a != b) out.hessian[b * m + a] += value;
                    }
                }
        }
        p1 = p2;
    }
    support_joints_.fold(order, out);
}

OffsetCoordinate::OffsetCoordinate(std::shared_ptr<const ConfigurationFunction> coordinate, int slot, int variable)
    : coordinate_(std::move(coordinate)), slot_(slot), variable_(variable), index_(-1) {
    support_ = coordinate_->support();
    joints_ = coordinate_->joints();
    if (variable < 0) return;
    const auto found = std::find(support_.begin(), support_.end(), variable);
    index_ = static_cast<int>(found - support_.begin());
    if (found == support_.end()) support_.push_back(variable);
}

template <class T>
void OffsetCoordinate::evaluate_on(const Placement<T>& at, const T* q, Order order, LocalTaylor<T>& out) const {
    coordinate_->evaluate(at, q, order, out);
    T offset{};
    if (slot_ >= 0) offset += at.number(slot_);
    if (variable_ >= 0) offset += q[variable_];
    out.value -= offset;
    if constexpr (!is_dual<T>) raise(out.scale, abs(offset));
    if (order == Order::value || variable_ < 0) return;
    const std::size_t inner = coordinate_->support().size(), m = support_.size();
    if (m > inner) {
        out.gradient.push_back(T{});
        if (order == Order::hessian) {
            out.hessian.resize(m * m);
            for (std::size_t i = inner; i-- > 0;) {  // widen the rows, from the last
                for (std::size_t j = inner; j-- > 0;) out.hessian[i * m + j] = out.hessian[i * inner + j];
                out.hessian[i * m + inner] = T{};
            }
            std::fill_n(&out.hessian[inner * m], m, T{});
        }
    }
    out.gradient[index_] -= T(1.0);
}

SumOfCoordinates::SumOfCoordinates(std::vector<std::shared_ptr<const ConfigurationFunction>> coordinates,
                                   std::vector<int> factor_slots)
    : coordinates_(std::move(coordinates)), slots_(std::move(factor_slots)) {
    for (const auto& coordinate : coordinates_) {
        index_.emplace_back();
        for (const int variable : coordinate->support()) {
            const auto found = std::find(support_.begin(), support_.end(), variable);
            index_.back().push_back(static_cast<int>(found - support_.begin()));
            if (found == support_.end()) support_.push_back(variable);
        }
        joints_ = either(joints_, coordinate->joints());
    }
}

template <class T>
void SumOfCoordinates::evaluate_on(const Placement<T>& at, const T* q, Order order, LocalTaylor<T>& out) const {
    const std::size_t m = support_.size();
    out.value = T{};
    out.scale = {};
    if (order != Order::value) out.gradient.assign(m, T{});
    if (order == Order::hessian) out.hessian.assign(m * m, T{});
    if (out.inner.empty()) out.inner.resize(1);
    LocalTaylor<T>& one = out.inner[0];
    for (std::size_t k = 0; k < coordinates_.size(); ++k) {
        const T factor = at.number(slots_[k]);
        const std::vector<int>& to = index_[k];
        const std::size_t size = to.size();
        coordinates_[k]->evaluate(at, q, order, one);
        out.value += factor * one.value;
        raise(out.scale, abs(value_of(factor)) * one.scale);
        if (order == Order::value) continue;
        for (std::size_t i = 0; i < size; ++i) out.gradient[to[i]] += factor * one.gradient[i];
        if (order == Order::gradient) continue;
        for (std::size_t i = 0; i < size; ++i)
            for (std::size_t j = 0; j < size; ++j) out.hessian[to[i] * m + to[j]] += factor * one.hessian[i * size + j];
    }
}

LocalCoordinate::LocalCoordinate(const Constants& constants, std::vector<int> points, std::vector<int> directions,
                                 std::vector<int> variables, std::shared_ptr<const LocalFunction> function)
    : points_(std::move(points)),
      directions_(std::move(directions)),
      variables_(std::move(variables)),
      function_(std::move(function)),
      support_joints_(constants.joints, above_points(constants, points_, directions_), variables_) {
    support_ = support_joints_.support();
    joints_ = support_joints_.joints();
    for (const int joint : joints_) {
        for (const int p : points_) moves_.push_back(is_above(constants.joints, joint, constants.points[p].joint));
        for (const int d : directions_)
            moves_.push_back(is_above(constants.joints, joint, constants.directions[d].joint));
    }
}

template <class T>
void LocalCoordinate::evaluate_on(const Placement<T>& at, const T* q, Order order, LocalTaylor<T>& out) const {
    const int np = static_cast<int>(points_.size()), vectors = np + static_cast<int>(directions_.size());
    const int nv = static_cast<int>(variables_.size()), n = 3 * vectors + nv;
    const int n_joints = support_joints_.count(), m = support_joints_.size();
    // z | gradient by z | Hessian by z | dz by each joint, vectors only | Hessian times that
    out.work.resize(static_cast<std::size_t>(2 * n + n * n + n_joints * (3 * vectors + n)));
    T* z = out.work.data();
    T *g = z + n, *H = g + n, *dz = H + n * n, *Hdz = dz + n_joints * 3 * vectors;
    Vec3<T>* at_z = reinterpret_cast<Vec3<T>*>(z);
    out.scale = {};
    for (int k = 0; k < vectors; ++k) {
        at_z[k] = k < np ? at.position(points_[k]) : at.direction(directions_[k - np]);
        for (const T& x : {at_z[k].x, at_z[k].y, at_z[k].z}) raise(out.scale, abs(value_of(x)));
    }
    for (int k = 0; k < nv; ++k) z[3 * vectors + k] = q[variables_[k]];
    function_->evaluate(LocalCall<T>{at, z, n, order, out.value, g, H, out.scale});
    raise(out.scale, abs(value_of(out.value)));
    if (order == Order::value) return;
    for (int k = 0; k < n; ++k) raise(out.scale, abs(value_of(g[k]) * value_of(z[k])));

    out.gradient.resize(m);
    for (int i = 0; i < n_joints; ++i) {
        const Motion<T>& s = at.twist[support_joints_.joint(i)];
        Vec3<T>* change = reinterpret_cast<Vec3<T>*>(dz + i * 3 * vectors);
        for (int k = 0; k < vectors; ++k) {
            change[k] = Vec3<T>{};
            if (!moves_[i * vectors + k]) continue;
            change[k] = cross(s.w, at_z[k]);
            if (k < np) change[k] += s.v;
        }
        out.gradient[i] = sum_of(g, dz + i * 3 * vectors, 3 * vectors);
    }
    for (int k = 0; k < nv; ++k) out.gradient[n_joints + k] = g[3 * vectors + k];
    if (order == Order::hessian) {
        out.hessian.assign(m * m, T{});
        for (int i = 0; i < n_joints; ++i)
            for (int r = 0; r < n; ++r) Hdz[i * n + r] = sum_of(H + r * n, dz + i * 3 * vectors, 3 * vectors);
        const auto put = [&](int i, int j, const T& value) {
            out.hessian[i * m + j] = value;
            out.hessian[j * m + i] = value;
        };
        for (int i = 0; i < n_joints; ++i) {
            const Vec3<T>* change = reinterpret_cast<const Vec3<T>*>(dz + i * 3 * vectors);
            for (int j = 0; j <= i; ++j) {
                T value = sum_of(dz + i * 3 * vectors, Hdz + j * n, 3 * vectors);
                if (support_joints_.above(j, i))
                    for (int k = 0; k < vectors; ++k)
                        value += dot(Vec3<T>{g[3 * k], g[3 * k + 1], g[3 * k + 2]},
                                     cross(at.twist[support_joints_.joint(j)].w, change[k]));
                put(i, j, value);
            }
            for (int k = 0; k < nv; ++k) put(n_joints + k, i, Hdz[i * n + 3 * vectors + k]);
        }
        for (int k = 0; k < nv; ++k)
            for (int l = 0; l < nv; ++l)
                out.hessian[(n_joints + k) * m + n_joints + l] = H[(3 * vectors + k) * n + 3 * vectors + l];
    }
    support_joints_.fold(order, out);
}

std::shared_ptr<const LocalFunction> component_function() {
    static const auto only = std::make_shared<OnAnyCall<Bilinear<component>>>(Bilinear<component>{});
    return only;
}
std::shared_ptr<const LocalFunction> product_function() {
    static const auto only = std::make_shared<OnAnyCall<Bilinear<product>>>(Bilinear<product>{});
    return only;
}

LEASTACTION_ON_ANY_SCALAR(Combination);
LEASTACTION_ON_ANY_SCALAR(PathLength);
LEASTACTION_ON_ANY_SCALAR(OffsetCoordinate);
LEASTACTION_ON_ANY_SCALAR(SumOfCoordinates);
LEASTACTION_ON_ANY_SCALAR(LocalCoordinate);

}  // namespace leastaction
