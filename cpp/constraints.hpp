// Holonomic constraints h(q) = 0.
#pragma once

#include "elements.hpp"

namespace leastaction {

class Mechanism;

// Two points at a distance: h = |p1 - p2|^2 - L^2, where L is a constant or a configuration variable (a string that is
// reeled). With d = p1 - p2 and D_i = dd/dq_i:
//   dh/dq_i = 2 d.D_i,   d2h/dq_i dq_j = 2 D_i.(D_j + d x w_j)  where j is an ancestor of i or i itself,
//                        d2h/dq_i dq_j = 2 D_i.D_j              where i and j are on different branches.
// With the multiplier lam (an impulse per length^2) the tension of the string is 2 L lam / dt.
class Distance final : public ConfigurationFunction {
public:
    Distance(const std::vector<Joint>& joints, const Point& point1, const Point& point2, double length,
             int length_variable);

    void evaluate(const Placement<double>& at, const double* q, Order order, LocalTaylor<double>& out) const override;
    void evaluate(const Placement<Dual<double>>& at, const Dual<double>* q, Order order,
                  LocalTaylor<Dual<double>>& out) const override;

private:
    template <class T>
    void evaluate_on(const Placement<T>& at, const T* q, Order order, LocalTaylor<T>& out) const;

    struct Mover {  // a joint that moves one of the points, or both
        int joint;
        bool moves1, moves2;
    };
    Point point1_, point2_;
    double length_;
    int length_variable_;        // -1: constant
    std::vector<Mover> movers_;  // support_[i] is the variable of movers_[i]; then the length variable
    std::vector<char> above_;    // above_[i * movers + j]: j is i or an ancestor of i
    static constexpr int max_stack = 64;
};

}  // namespace leastaction
