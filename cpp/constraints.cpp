#include "constraints.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace leastaction {

namespace {

bool is_above(const std::vector<Joint>& joints, int ancestor, int joint) {
    for (; joint >= 0; joint = joints[joint].parent)
        if (joint == ancestor) return true;
    return false;
}

template <class T>
double size_of(const Vec3<T>& a) {
    return std::abs(value_of(a.x)) + std::abs(value_of(a.y)) + std::abs(value_of(a.z));
}

}  // namespace

PointPair::PointPair(const std::vector<Joint>& joints, const Point& point1, const Point& point2)
    : point1_(point1), point2_(point2) {
    for (int joint = 0; joint < static_cast<int>(joints.size()); ++joint) {
        const bool moves1 = point1.joint >= 0 && is_above(joints, joint, point1.joint);
        const bool moves2 = point2.joint >= 0 && is_above(joints, joint, point2.joint);
        if (moves1 || moves2) {
            movers_.push_back({joint, moves1, moves2});
            joints_.push_back(joint);
            support_.push_back(joints[joint].variable);
        }
    }
    const std::size_t n = movers_.size();
    above_.resize(n * n);
    for (std::size_t i = 0; i < n; ++i)
        for (std::size_t j = 0; j < n; ++j) above_[i * n + j] = is_above(joints, movers_[j].joint, movers_[i].joint);
}

template <class T>
void PointPair::difference(const Placement<T>& at, Order order, Difference<T>& out) const {
    const std::size_t n = movers_.size();
    const Vec3<T> p1 = at.position(point1_), p2 = at.position(point2_);
    out.d = p1 - p2;
    out.size = size_of(p1) + size_of(p2);
    if (order == Order::value) return;
    Vec3<T>* D = out.on_stack;
    if (n > max_stack) {
        out.on_heap.resize(n);
        D = out.on_heap.data();
    }
    out.D = D;
    for (std::size_t i = 0; i < n; ++i) {
        const Motion<T>& s = at.twist[movers_[i].joint];
        if (movers_[i].moves1 && movers_[i].moves2)
            D[i] = cross(s.w, out.d);
        else if (movers_[i].moves1)
            D[i] = s.v + cross(s.w, p1);
        else
            D[i] = -(s.v + cross(s.w, p2));
        out.size = std::max(out.size, size_of(D[i]));
    }
}

Distance::Distance(const std::vector<Joint>& joints, const Point& point1, const Point& point2, double length,
                   int length_variable)
    : PointPair(joints, point1, point2), length_(length), length_variable_(length_variable) {
    if (length_variable >= 0) support_.push_back(length_variable);
}

void Distance::evaluate(const Placement<double>& at, const double* q, Order order, LocalTaylor<double>& out) const {
    evaluate_on(at, q, order, out);
}
void Distance::evaluate(const Placement<Dual<double>>& at, const Dual<double>* q, Order order,
                        LocalTaylor<Dual<double>>& out) const {
    evaluate_on(at, q, order, out);
}

template <class T>
void Distance::evaluate_on(const Placement<T>& at, const T* q, Order order, LocalTaylor<T>& out) const {
    const std::size_t n = movers_.size(), m = support_.size();
    Difference<T> change;
    difference(at, order, change);
    const Vec3<T>& d = change.d;
    const T length = length_variable_ >= 0 ? q[length_variable_] : T(length_);
    const T d2 = dot(d, d), l2 = length * length;
    out.value = d2 - l2;
    if constexpr (std::is_same_v<T, double>) out.scale = d2 + l2;
    if (order == Order::value) return;

    out.gradient.resize(m);
    for (std::size_t i = 0; i < n; ++i) out.gradient[i] = 2.0 * dot(d, change.D[i]);
    if (length_variable_ >= 0) out.gradient[n] = -2.0 * length;
    if (order == Order::gradient) return;

    out.hessian.assign(m * m, T{});
    for (std::size_t j = 0; j < n; ++j) {
        const Vec3<T> carried = change.D[j] + cross(d, at.twist[movers_[j].joint].w);
        for (std::size_t i = j; i < n; ++i) {
            const T value = 2.0 * dot(change.D[i], above_[i * n + j] ? carried : change.D[j]);
            out.hessian[i * m + j] = value;
            out.hessian[j * m + i] = value;
        }
    }
    if (length_variable_ >= 0) out.hessian[n * m + n] = T(-2.0);
}

Coincidence::Coincidence(const std::vector<Joint>& joints, const Point& point1, const Point& point2,
                         const Vec3<double>& direction)
    : PointPair(joints, point1, point2), direction_(direction) {}

void Coincidence::evaluate(const Placement<double>& at, const double*, Order order, LocalTaylor<double>& out) const {
    evaluate_on(at, order, out);
}
void Coincidence::evaluate(const Placement<Dual<double>>& at, const Dual<double>*, Order order,
                           LocalTaylor<Dual<double>>& out) const {
    evaluate_on(at, order, out);
}

template <class T>
void Coincidence::evaluate_on(const Placement<T>& at, Order order, LocalTaylor<T>& out) const {
    const std::size_t m = support_.size();
    Difference<T> change;
    difference(at, order, change);
    out.value = dot(direction_, change.d);
    if constexpr (std::is_same_v<T, double>) out.scale = change.size;
    if (order == Order::value) return;

    out.gradient.resize(m);
    for (std::size_t i = 0; i < m; ++i) out.gradient[i] = dot(direction_, change.D[i]);
    if (order == Order::gradient) return;

    out.hessian.assign(m * m, T{});
    for (std::size_t j = 0; j < m; ++j) {
        const Vec3<T> carried = cross(direction_, at.twist[movers_[j].joint].w);
        for (std::size_t i = j; i < m; ++i) {
            const T value = above_[i * m + j] ? dot(change.D[i], carried) : T{};
            out.hessian[i * m + j] = value;
            out.hessian[j * m + i] = value;
        }
    }
}

}  // namespace leastaction
