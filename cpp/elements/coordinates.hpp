// Scalar coordinates s(q) that potentials, constraints and forces are made of.
#pragma once

#include <memory>

#include "elements/elements.hpp"
#include "elements/local_function.hpp"
#include "kinematics/support_joints.hpp"

namespace leastaction {

// A linear function of configuration variables: s = sum factor_k q[variable_k], the factors in the mechanism's numbers.
class Combination final : public OnAnyScalar<Combination> {
public:
    Combination(std::vector<int> variables, std::vector<int> factor_slots);

    template <class T>
    void evaluate_on(const Placement<T>& at, const T* q, Order order, LocalTaylor<T>& out) const;

private:
    std::vector<int> slots_;
};

// The length of a string over points. With d = p_k - p_k+1, l = |d|, n = d/l of each piece, D_i = dd/dq_i by the joints that
// move one of its ends, and j above i or i itself (else without its last term):
//   dl/dq_i = n.D_i,   d2l/dq_i dq_j = (D_i.D_j - (n.D_i)(n.D_j))/l + n.(w_j x D_i).
class PathLength final : public OnAnyScalar<PathLength> {
public:
    PathLength(const Constants& constants, std::vector<int> points);

    template <class T>
    void evaluate_on(const Placement<T>& at, const T* q, Order order, LocalTaylor<T>& out) const;

private:
    struct End {           // a joint that moves one end of a piece
        int index, joint;  // its place in the support
        bool first;
    };
    std::vector<int> points_;
    SupportJoints support_joints_;
    std::vector<std::vector<End>> pieces_;
};

// A coordinate less a number and the value of a variable: s(q) - number - q[variable]; either may be missing (-1). A constraint
// that holds a coordinate, or the stretch of a spring whose rest is a variable.
class OffsetCoordinate final : public OnAnyScalar<OffsetCoordinate> {
public:
    OffsetCoordinate(std::shared_ptr<const ConfigurationFunction> coordinate, int slot, int variable);

    template <class T>
    void evaluate_on(const Placement<T>& at, const T* q, Order order, LocalTaylor<T>& out) const;

private:
    std::shared_ptr<const ConfigurationFunction> coordinate_;
    int slot_, variable_;
    int index_;  // of the variable in the support
};

// A sum of coordinates by factors, which are the mechanism's numbers.
class SumOfCoordinates final : public OnAnyScalar<SumOfCoordinates> {
public:
    SumOfCoordinates(std::vector<std::shared_ptr<const ConfigurationFunction>> coordinates,
                     std::vector<int> factor_slots);

    template <class T>
    void evaluate_on(const Placement<T>& at, const T* q, Order order, LocalTaylor<T>& out) const;

private:
    std::vector<std::shared_ptr<const ConfigurationFunction>> coordinates_;
    std::vector<int> slots_;
    std::vector<std::vector<int>> index_;  // by coordinate: its support in that of the sum
};

// A function of places and directions in the world and of configuration variables, z = [points | directions | variables]: the
// function states value, gradient and Hessian by z; the chain rule is done here.
class LocalCoordinate final : public OnAnyScalar<LocalCoordinate> {
public:
    LocalCoordinate(const Constants& constants, std::vector<int> points, std::vector<int> directions,
                    std::vector<int> variables, std::shared_ptr<const LocalFunction> function);

    template <class T>
    void evaluate_on(const Placement<T>& at, const T* q, Order order, LocalTaylor<T>& out) const;

private:
    std::vector<int> points_, directions_, variables_;
    std::shared_ptr<const LocalFunction> function_;
    SupportJoints support_joints_;
    std::vector<char> moves_;  // by joint and by point, then direction
};

// z = [p1 | p2 | e]: e.(p1 - p2); z = [d | e]: d.e.
std::shared_ptr<const LocalFunction> component_function();
std::shared_ptr<const LocalFunction> product_function();

}  // namespace leastaction
