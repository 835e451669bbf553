#include "elements/constraints.hpp"

#include <algorithm>
#include <cmath>

namespace leastaction {

namespace {

template <class T>
SizeOf<T> size_of(const Vec3<T>& a) {
    using std::abs;
    return abs(value_of(a.x)) + abs(value_of(a.y)) + abs(value_of(a.z));
}

std::vector<int> above_point(const Constants& constants, int point) {
    return joints_above(constants.joints, constants.points[point].joint);
}

std::vector<int> if_any(int variable) { return variable < 0 ? std::vector<int>{} : std::vector<int>{variable}; }

}  // namespace

PointPair::PointPair(const std::vector<Joint>& joints, int joint1, int joint2, int point1, int point2,
                     const SupportJoints& support)
    : point1_(point1), point2_(point2) {
    for (const int joint : support.joints())
        support_joints_.push_back({joint, is_above(joints, joint, joint1), is_above(joints, joint, joint2)});
}

template <class T>
void PointPair::difference(const Placement<T>& at, Order order, Difference<T>& out) const {
    const std::size_t n = support_joints_.size();
    const Vec3<T> p1 = out.p1 = at.position(point1_), p2 = out.p2 = at.position(point2_);
    out.d = p1 - p2;
    if (order == Order::value) return;
    Vec3<T>* D = reinterpret_cast<Vec3<T>*>(out.on_stack);
    if (n > max_stack) {
        out.on_heap.resize(n);
        D = out.on_heap.data();
    }
    out.D = D;
    for (std::size_t i = 0; i < n; ++i) {
        const Motion<T>& s = at.twist[support_joints_[i].joint];
        if (support_joints_[i].moves1 && support_joints_[i].moves2)
            D[i] = cross(s.w, out.d);
        else if (support_joints_[i].moves1)
            D[i] = s.v + cross(s.w, p1);
        else
            D[i] = -(s.v + cross(s.w, p2));
    }
}

Distance::Distance(const Constants& constants, int point1, int point2, int length_slot, int length_variable)
    : support_joints_(constants.joints, only_one(above_point(constants, point1), above_point(constants, point2)),
                      if_any(length_variable)),
      pair_(constants.joints, constants.points[point1].joint, constants.points[point2].joint, point1, point2,
            support_joints_),
      length_slot_(length_slot),
      length_variable_(length_variable) {
    support_ = support_joints_.support();
    // Joints above both ends must be placed too, although nothing depends on them.
    joints_ = either(above_point(constants, point1), above_point(constants, point2));
}

template <class T>
void Distance::evaluate_on(const Placement<T>& at, const T* q, Order order, LocalTaylor<T>& out) const {
    const std::size_t n = support_joints_.count(), m = support_joints_.size();
    PointPair::Difference<T> change;
    pair_.difference(at, order, change);
    const Vec3<T>& d = change.d;
    const T length = length_variable_ >= 0 ? q[length_variable_] : at.number(length_slot_);
    const T d2 = dot(d, d), l2 = length * length;
    out.value = d2 - l2;
    if constexpr (!is_dual<T>) out.scale = d2 + l2;
    if (order == Order::value) return;

    out.gradient.resize(m);
    for (std::size_t i = 0; i < n; ++i) out.gradient[i] = 2.0 * dot(d, change.D[i]);
    if (length_variable_ >= 0) out.gradient[n] = -2.0 * length;
    if (order == Order::hessian) {
        out.hessian.assign(m * m, T{});
        for (std::size_t j = 0; j < n; ++j) {
            const Vec3<T> carried = change.D[j] + cross(d, at.twist[support_joints_.joint(j)].w);
            for (std::size_t i = j; i < n; ++i) {
                const T value = 2.0 * dot(change.D[i], support_joints_.above(j, i) ? carried : change.D[j]);
                out.hessian[i * m + j] = value;
                out.hessian[j * m + i] = value;
            }
        }
        if (length_variable_ >= 0) out.hessian[n * m + n] = T(-2.0);
    }
    support_joints_.fold(order, out);
}

std::optional<std::pair<int, int>> Distance::points() const {
    return length_variable_ < 0 ? std::optional(pair_.points()) : std::nullopt;
}

SlopeByPoints Distance::by_points(const Placement<double>& at) const {
    const auto [point1, point2] = pair_.points();
    const Vec3<double> d = at.position(point1) - at.position(point2);
    const double d2 = dot(d, d), length = at.number(length_slot_), l2 = length * length;
    return {d2 - l2, d2 + l2, 2.0 * d};
}

SlopeByPoints Coincidence::by_points(const Placement<double>& at) const {
    const auto [point1, point2] = pair_.points();
    const Vec3<double> p1 = at.position(point1), p2 = at.position(point2);
    return {dot(direction_, p1 - p2), size_of(p1) + size_of(p2), direction_};
}

Coincidence::Coincidence(const Constants& constants, int point1, int point2, const Vec3<double>& direction)
    : support_joints_(constants.joints, either(above_point(constants, point1), above_point(constants, point2))),
      pair_(constants.joints, constants.points[point1].joint, constants.points[point2].joint, point1, point2,
            support_joints_),
      direction_(direction) {
    support_ = support_joints_.support();
    joints_ = support_joints_.joints();
}

template <class T>
void Coincidence::evaluate_on(const Placement<T>& at, const T*, Order order, LocalTaylor<T>& out) const {
    const std::size_t m = support_joints_.size();
    PointPair::Difference<T> change;
    pair_.difference(at, order, change);
    out.value = dot(direction_, change.d);
    if constexpr (!is_dual<T>) {
        // Of the places and of their changes: what rounding goes with.
        SizeOf<T> size = size_of(change.p1) + size_of(change.p2);
        for (std::size_t i = 0; i < m && order != Order::value; ++i) raise(size, size_of(change.D[i]));
        out.scale = size;
    }
    if (order == Order::value) return;

    out.gradient.resize(m);
    for (std::size_t i = 0; i < m; ++i) out.gradient[i] = dot(direction_, change.D[i]);
    if (order == Order::hessian) {
        out.hessian.assign(m * m, T{});
        for (std::size_t j = 0; j < m; ++j) {
            const Vec3<T> carried = cross(direction_, at.twist[support_joints_.joint(j)].w);
            for (std::size_t i = j; i < m; ++i) {
                const T value = support_joints_.above(j, i) ? dot(change.D[i], carried) : T{};
                out.hessian[i * m + j] = value;
                out.hessian[j * m + i] = value;
            }
        }
    }
    support_joints_.fold(order, out);
}

LEASTACTION_ON_ANY_SCALAR(Distance);
LEASTACTION_ON_ANY_SCALAR(Coincidence);

}  // namespace leastaction
