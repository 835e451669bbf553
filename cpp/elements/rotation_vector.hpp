// One component of the rotation vector of a ball joint: the place s that potentials and constraints of its turns have.
//
// With the unit quaternion p = Q rx(a) ry(b) rz(c) of the chart about Q, scalar w >= 0 and vector v (else -p is taken),
//   s = 2 A(w) v_i,   A(w) = acos(w)/sqrt(1 - w^2),
// smooth below half a turn. A is analytic at w = 1: A = sum a_n (1 - w)^n, a_0 = 1, a_n+1 = a_n (n + 1)/(2n + 3), and
//   (1 - w^2) A' = w A - 1,   (1 - w^2) A'' = 3 w A' + A,   (1 - w^2) A''' = 5 w A'' + 4 A', ...
#pragma once

#include "elements/elements.hpp"

namespace leastaction {

class RotationVector final : public OnAnyScalar<RotationVector> {
public:
    // `variable` is the first of the three of the ball, `quaternion` where its numbers stand in q, `axis` the component.
    RotationVector(int variable, int quaternion, int axis);

    template <class T>
    void evaluate_on(const Placement<T>& at, const T* q, Order order, LocalTaylor<T>& out) const;

private:
    template <class T>
    void evaluate_at(const T* quaternion, const T* theta, Order order, LocalTaylor<T>& out) const;

    int variable_, quaternion_, axis_;
};

}  // namespace leastaction
