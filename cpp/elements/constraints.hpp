// Holonomic constraints h(q) = 0.
#pragma once

#include <memory>

#include "elements/elements.hpp"
#include "kinematics/support_joints.hpp"

namespace leastaction {

// Two points and the joints that move them: the difference d = p1 - p2, its change D_i = dd/dq_i by each such joint, and
// d2d/dq_i dq_j = w_j x D_i where j is an ancestor of i or i itself, zero where they are on different branches.
class PointPair {
public:
    // `support`: of the two points, or a part of them.
    PointPair(const std::vector<Joint>& joints, int joint1, int joint2, int point1, int point2,
              const SupportJoints& support);

    // D for all joints of the support; the buffer is used unless there are too many of them.
    static constexpr int max_stack = 64;
    template <class T>
    struct Difference {
        Vec3<T> p1, p2, d;
        const Vec3<T>* D;
        T on_stack[3 * max_stack];  // as numbers, which nobody sets to zero first
        std::vector<Vec3<T>> on_heap;
    };
    template <class T>
    void difference(const Placement<T>& at, Order order, Difference<T>& out) const;
    std::pair<int, int> points() const { return {point1_, point2_}; }

private:
    struct PairJoint {
        int joint;
        bool moves1, moves2;
    };
    std::vector<PairJoint> support_joints_;
    int point1_, point2_;
};

// Two points at a distance: h = |p1 - p2|^2 - L^2, where L is a number or a configuration variable (a string that is
// reeled). Joints that move both points alike change nothing and are left out.
//   dh/dq_i = 2 d.D_i,   d2h/dq_i dq_j = 2 D_i.(D_j + d x w_j)  where j is an ancestor of i or i itself,
//                        d2h/dq_i dq_j = 2 D_i.D_j              where i and j are on different branches.
// With the multiplier lam (an impulse per length^2) the tension of the string is 2 L lam / dt.
class Distance final : public OnAnyScalar<Distance> {
public:
    Distance(const Constants& constants, int point1, int point2, int length_slot, int length_variable);

    template <class T>
    void evaluate_on(const Placement<T>& at, const T* q, Order order, LocalTaylor<T>& out) const;
    std::optional<std::pair<int, int>> points() const override;
    SlopeByPoints by_points(const Placement<double>& at) const override;

private:
    SupportJoints support_joints_;
    PointPair pair_;
    int length_slot_;
    int length_variable_;  // -1: the number; else the last before folding
};

// Two points that coincide along a direction e of the world: h = e.(p1 - p2).
//   dh/dq_i = e.D_i,   d2h/dq_i dq_j = e.(w_j x D_i)  where j is an ancestor of i or i itself, else zero.
// The multiplier is the impulse along e.
class Coincidence final : public OnAnyScalar<Coincidence> {
public:
    Coincidence(const Constants& constants, int point1, int point2, const Vec3<double>& direction);

    template <class T>
    void evaluate_on(const Placement<T>& at, const T* q, Order order, LocalTaylor<T>& out) const;
    std::optional<std::pair<int, int>> points() const override { return pair_.points(); }
    SlopeByPoints by_points(const Placement<double>& at) const override;

private:
    SupportJoints support_joints_;
    PointPair pair_;
    Vec3<double> direction_;
};

}  // namespace leastaction
