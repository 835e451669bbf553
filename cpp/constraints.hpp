// Holonomic constraints h(q) = 0.
#pragma once

#include "elements.hpp"

namespace leastaction {

// Two points and the joints that move them: the difference d = p1 - p2, its change D_i = dd/dq_i by each such joint, and
// d2d/dq_i dq_j = w_j x D_i where j is an ancestor of i or i itself, zero where they are on different branches.
class PointPair : public ConfigurationFunction {
protected:
    PointPair(const std::vector<Joint>& joints, const Point& point1, const Point& point2);

    // D for all movers; the buffer is used unless there are too many of them.
    static constexpr int max_stack = 64;
    template <class T>
    struct Difference {
        Vec3<T> d;
        const Vec3<T>* D;
        double size;  // of the places and of their changes: what rounding goes with
        Vec3<T> on_stack[max_stack];
        std::vector<Vec3<T>> on_heap;
    };
    template <class T>
    void difference(const Placement<T>& at, Order order, Difference<T>& out) const;

    struct Mover {  // a joint that moves one of the points, or both
        int joint;
        bool moves1, moves2;
    };
    std::vector<Mover> movers_;  // support_[i] is the variable of movers_[i]
    std::vector<char> above_;    // above_[i * movers + j]: j is i or an ancestor of i

private:
    Point point1_, point2_;
};

// Two points at a distance: h = |p1 - p2|^2 - L^2, where L is a constant or a configuration variable (a string that is
// reeled).
//   dh/dq_i = 2 d.D_i,   d2h/dq_i dq_j = 2 D_i.(D_j + d x w_j)  where j is an ancestor of i or i itself,
//                        d2h/dq_i dq_j = 2 D_i.D_j              where i and j are on different branches.
// With the multiplier lam (an impulse per length^2) the tension of the string is 2 L lam / dt.
class Distance final : public PointPair {
public:
    Distance(const std::vector<Joint>& joints, const Point& point1, const Point& point2, double length,
             int length_variable);

    void evaluate(const Placement<double>& at, const double* q, Order order, LocalTaylor<double>& out) const override;
    void evaluate(const Placement<Dual<double>>& at, const Dual<double>* q, Order order,
                  LocalTaylor<Dual<double>>& out) const override;

private:
    template <class T>
    void evaluate_on(const Placement<T>& at, const T* q, Order order, LocalTaylor<T>& out) const;

    double length_;
    int length_variable_;  // -1: constant; else the last of the support
};

// Two points that coincide along a direction e of the world: h = e.(p1 - p2).
//   dh/dq_i = e.D_i,   d2h/dq_i dq_j = e.(w_j x D_i)  where j is an ancestor of i or i itself, else zero.
// The multiplier is the impulse along e.
class Coincidence final : public PointPair {
public:
    Coincidence(const std::vector<Joint>& joints, const Point& point1, const Point& point2,
                const Vec3<double>& direction);

    void evaluate(const Placement<double>& at, const double* q, Order order, LocalTaylor<double>& out) const override;
    void evaluate(const Placement<Dual<double>>& at, const Dual<double>* q, Order order,
                  LocalTaylor<Dual<double>>& out) const override;

private:
    template <class T>
    void evaluate_on(const Placement<T>& at, Order order, LocalTaylor<T>& out) const;

    Vec3<double> direction_;
};

}  // namespace leastaction
