// The interfaces that every element of a mechanism fills.
//
// A potential V(q), a holonomic constraint h(q) = 0 and a coordinate s(q) that a force acts along are the same thing to the
// core: a scalar function of a few configuration variables (its support). It states its value, gradient and Hessian once,
// on the generic scalar; the third order along a direction comes from the dual scalar, the fourth along two from the
// hyper-dual one, and derivatives by its numbers in the same way, so a type with a missing order cannot exist. Lanes are
// several configurations at once.
#pragma once

#include <memory>
#include <optional>
#include <type_traits>
#include <utility>
#include <vector>

#include "kinematics/points.hpp"
#include "numerics/taylor.hpp"

namespace leastaction {

// A function of the difference of two points' places: its value, the size of its terms, and its slope by the difference.
struct SlopeByPoints {
    double value, scale;
    Vec3<double> slope;
};

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
    virtual void evaluate(const Placement<HyperDual>& at, const HyperDual* q, Order order,
                          LocalTaylor<HyperDual>& out) const = 0;
    virtual void evaluate(const Placement<Lanes>& at, const Lanes* q, Order order, LocalTaylor<Lanes>& out) const = 0;

    // Of a function of two points' places alone the points, and the function of them; else none.
    virtual std::optional<std::pair<int, int>> points() const { return std::nullopt; }
    virtual SlopeByPoints by_points(const Placement<double>&) const { return {}; }

protected:
    std::vector<int> support_, joints_;
};

// Lets a type state itself once, as a template evaluate_on().
template <class Type>
class OnAnyScalar : public ConfigurationFunction {
public:
    void evaluate(const Placement<double>& at, const double* q, Order order, LocalTaylor<double>& out) const final {
        static_cast<const Type&>(*this).evaluate_on(at, q, order, out);
    }
    void evaluate(const Placement<Dual<double>>& at, const Dual<double>* q, Order order,
                  LocalTaylor<Dual<double>>& out) const final {
        static_cast<const Type&>(*this).evaluate_on(at, q, order, out);
    }
    void evaluate(const Placement<HyperDual>& at, const HyperDual* q, Order order,
                  LocalTaylor<HyperDual>& out) const final {
        static_cast<const Type&>(*this).evaluate_on(at, q, order, out);
    }
    void evaluate(const Placement<Lanes>& at, const Lanes* q, Order order, LocalTaylor<Lanes>& out) const final {
        static_cast<const Type&>(*this).evaluate_on(at, q, order, out);
    }
};

// Put at the end of the file that defines evaluate_on().
#define LEASTACTION_ON_ANY_SCALAR(Type)                                                                            \
    template void Type::evaluate_on(const Placement<double>&, const double*, Order, LocalTaylor<double>&) const;   \
    template void Type::evaluate_on(const Placement<Dual<double>>&, const Dual<double>*, Order,                    \
                                    LocalTaylor<Dual<double>>&) const;                                             \
    template void Type::evaluate_on(const Placement<HyperDual>&, const HyperDual*, Order, LocalTaylor<HyperDual>&) \
        const;                                                                                                     \
    template void Type::evaluate_on(const Placement<Lanes>&, const Lanes*, Order, LocalTaylor<Lanes>&) const

// Evaluates a function, or one after the other, and hands on what it is made of by the variables that it belongs to:
// sink(i, slope) gets the gradient, sink(i, j, bend) the Hessian. `local` holds the rest, of the last one.
template <class T, class Sink>
void for_each_entry(const ConfigurationFunction& function, const Placement<T>& at, const T* q, LocalTaylor<T>& local,
                    const Sink& sink) {
    const std::vector<int>& support = function.support();
    const std::size_t n = support.size();
    constexpr bool second = std::is_invocable_v<Sink, int, int, const T&>;
    function.evaluate(at, q, second ? Order::hessian : Order::gradient, local);
    for (std::size_t i = 0; i < n; ++i) {
        if constexpr (second)
            for (std::size_t j = 0; j < n; ++j) sink(support[i], support[j], local.hessian[i * n + j]);
        else
            sink(support[i], local.gradient[i]);
    }
}
template <class T, class Sink>
void for_each_entry(const std::vector<std::shared_ptr<const ConfigurationFunction>>& functions, const Placement<T>& at,
                    const T* q, LocalTaylor<T>& local, const Sink& sink) {
    for (const auto& function : functions) for_each_entry(*function, at, q, local, sink);
}

// Where forces are evaluated. For their second derivatives, contracted with mu, the same configuration twice more on
// duals: along the velocity, and along mu.
template <class T>
struct ForcePoint {
    const Placement<T>& at;
    const T *q, *v, *u;
};
struct ForceDirections {
    const Placement<Dual<double>>&along_v, &along_mu;
    const Dual<double>*q_along_v, *q_along_mu;
    const double* mu;  // by variable; zero for kinematic ones
};

// A force over its support (m variables) and its inputs (r): f (m), f_q and f_v (m x m), f_u (m x r), row-major.
template <class T>
struct LocalForce {
    std::vector<T> f, f_q, f_v, f_u;
    std::vector<double> second;  // Hessian of mu.f by [q; v; u], (2m + r) squared
    std::vector<LocalTaylor<T>> coordinates;
    std::vector<LocalTaylor<Dual<double>>> along_v, along_mu;
    LocalTaylor<T> law;
    std::vector<T> work;
};

// Generalized force f_i(q, v, u) on configuration variables. Orders: value f, gradient its Jacobians too. On duals they come
// along a direction, of the state or of the numbers of the element; on hyper-duals along two.
class GeneralizedForce {
public:
    virtual ~GeneralizedForce() = default;

    const std::vector<int>& support() const { return support_; }
    const std::vector<int>& joints() const { return joints_; }
    const std::vector<int>& inputs() const { return inputs_; }

    virtual void evaluate(const ForcePoint<double>& point, Order order, LocalForce<double>& out) const = 0;
    virtual void evaluate(const ForcePoint<Dual<double>>& point, Order order, LocalForce<Dual<double>>& out) const = 0;
    virtual void evaluate(const ForcePoint<HyperDual>& point, Order order, LocalForce<HyperDual>& out) const = 0;
    virtual void evaluate(const ForcePoint<Lanes>& point, Order order, LocalForce<Lanes>& out) const = 0;
    // `second` of mu.f.
    virtual void curvature(const ForcePoint<double>& point, const ForceDirections& directions,
                           LocalForce<double>& out) const = 0;

protected:
    std::vector<int> support_, joints_, inputs_;
};

// Lets a force state itself once, as a template evaluate_on().
template <class Type>
class ForceOnAnyScalar : public GeneralizedForce {
public:
    void evaluate(const ForcePoint<double>& point, Order order, LocalForce<double>& out) const final {
        static_cast<const Type&>(*this).evaluate_on(point, order, out);
    }
    void evaluate(const ForcePoint<Dual<double>>& point, Order order, LocalForce<Dual<double>>& out) const final {
        static_cast<const Type&>(*this).evaluate_on(point, order, out);
    }
    void evaluate(const ForcePoint<HyperDual>& point, Order order, LocalForce<HyperDual>& out) const final {
        static_cast<const Type&>(*this).evaluate_on(point, order, out);
    }
    void evaluate(const ForcePoint<Lanes>& point, Order order, LocalForce<Lanes>& out) const final {
        static_cast<const Type&>(*this).evaluate_on(point, order, out);
    }
};

// Put at the end of the file that defines evaluate_on().
#define LEASTACTION_FORCE_ON_ANY_SCALAR(Type)                                                                 \
    template void Type::evaluate_on(const ForcePoint<double>&, Order, LocalForce<double>&) const;             \
    template void Type::evaluate_on(const ForcePoint<Dual<double>>&, Order, LocalForce<Dual<double>>&) const; \
    template void Type::evaluate_on(const ForcePoint<HyperDual>&, Order, LocalForce<HyperDual>&) const;       \
    template void Type::evaluate_on(const ForcePoint<Lanes>&, Order, LocalForce<Lanes>&) const

// The same for forces: sink(i, f) alone, or the Jacobians by by_variable(i, j, f_q, f_v) and by_input(i, a, f_u).
template <class T, class Sink>
void for_each_entry(const std::vector<std::shared_ptr<const GeneralizedForce>>& forces, const ForcePoint<T>& point,
                    LocalForce<T>& local, const Sink& sink) {
    for (const auto& force : forces) {
        force->evaluate(point, Order::value, local);
        for (std::size_t i = 0; i < force->support().size(); ++i) sink(force->support()[i], local.f[i]);
    }
}
template <class T, class ByVariable, class ByInput>
void for_each_entry(const std::vector<std::shared_ptr<const GeneralizedForce>>& forces, const ForcePoint<T>& point,
                    LocalForce<T>& local, const ByVariable& by_variable, const ByInput& by_input) {
    for (const auto& force : forces) {
        const std::vector<int>&support = force->support(), &inputs = force->inputs();
        const std::size_t n = support.size(), r = inputs.size();
        force->evaluate(point, Order::gradient, local);
        for (std::size_t i = 0; i < n; ++i) {
            for (std::size_t j = 0; j < n; ++j)
                by_variable(support[i], support[j], local.f_q[i * n + j], local.f_v[i * n + j]);
            for (std::size_t a = 0; a < r; ++a) by_input(support[i], inputs[a], local.f_u[i * r + a]);
        }
    }
}

}  // namespace leastaction
