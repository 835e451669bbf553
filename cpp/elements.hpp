// The interfaces that every element of a mechanism fills.
//
// A potential V(q) and a holonomic constraint h(q) = 0 are the same thing to the core: a scalar function of a few
// configuration variables (its support). It states its value, gradient and Hessian once, on the generic scalar; the
// third order along a direction comes from the dual scalar, so a type with a missing order cannot exist.
// A force is a map f(q, v, u) onto a few dynamic variables, with its Jacobians. All forces so far are affine in
// (q, v, u); the first one that is not brings its contracted Hessian into this interface.
#pragma once

#include <vector>

#include "points.hpp"

namespace leastaction {

// Value, gradient and Hessian of a scalar function over its support (m variables); Hessian row-major m x m.
template <class T>
struct LocalTaylor {
    T value{};
    double scale = 0;  // size of the terms that cancel in the value, for relative tolerances
    std::vector<T> gradient;
    std::vector<T> hessian;
};

enum class Order { value, gradient, hessian };

class ConfigurationFunction {
public:
    virtual ~ConfigurationFunction() = default;

    // The configuration variables it depends on (internal order), and the joints that must be placed to evaluate it.
    const std::vector<int>& support() const { return support_; }
    const std::vector<int>& joints() const { return joints_; }

    virtual void evaluate(const Placement<double>& at, const double* q, Order order,
                          LocalTaylor<double>& out) const = 0;
    virtual void evaluate(const Placement<Dual<double>>& at, const Dual<double>* q, Order order,
                          LocalTaylor<Dual<double>>& out) const = 0;

protected:
    std::vector<int> support_, joints_;
};

// Generalized force on dynamic variables: f_i(q, v, u). Arrays are in internal variable order and are added to.
// Jacobians are row-major: f_q and f_v are n_dynamic x n_variables, f_u is n_dynamic x n_inputs.
class GeneralizedForce {
public:
    virtual ~GeneralizedForce() = default;

    virtual void add_force(const double* q, const double* v, const double* u, double* f) const = 0;
    virtual void add_jacobians(const double* q, const double* v, const double* u, double* f_q, double* f_v,
                               double* f_u) const = 0;
    // The diagonals of f_q and f_v alone (n_dynamic each): all that a force without couplings adds to a Newton matrix.
    virtual void add_diagonals(const double* q, const double* v, const double* u, double* f_q, double* f_v) const = 0;
    // Pairs of dynamic variables that f_q or f_v couples (the pattern of the Newton matrix).
    virtual std::vector<std::pair<int, int>> couplings() const = 0;
};

}  // namespace leastaction
