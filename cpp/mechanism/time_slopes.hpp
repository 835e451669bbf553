// What changes with the time where nothing moves: dV/dt and dh/dt at a configuration, by duals in the direction of the time.
#pragma once

#include <algorithm>
#include <vector>

#include "mechanism/mechanism.hpp"

namespace leastaction {

// With its work space; one object per thread. Configurations in internal order.
class TimeSlopes {
public:
    explicit TimeSlopes(const Mechanism& m) : m_(m), at_(m), q_(m.n_coordinates()) {}

    // Of the sum of all potentials but the weight (W).
    double potentials(double t, const double* q) {
        double out = 0;
        each(m_.potentials, m_.element_joints, t, q, Order::value,
             [&](const auto&, int, const LocalTaylor<Dual<double>>& local) { out += local.value.d; });
        return out;
    }
    // Calls sink(c, dh_c/dt) for every constraint.
    template <class Sink>
    void constraints(double t, const double* q, const Sink& sink) {
        each(m_.constraints, m_.constraint_joints, t, q, Order::value,
             [&](const auto&, int c, const LocalTaylor<Dual<double>>& local) { sink(c, local.value.d); });
    }
    // And by_variable(c, i, slope) with the slopes of these by the variables.
    template <class Sink, class ByVariable>
    void constraints(double t, const double* q, const Sink& sink, const ByVariable& by_variable) {
        each(m_.constraints, m_.constraint_joints, t, q, Order::gradient,
             [&](const ConfigurationFunction& of, int c, const LocalTaylor<Dual<double>>& local) {
                 sink(c, local.value.d);
                 for (std::size_t i = 0; i < of.support().size(); ++i)
                     by_variable(c, of.support()[i], local.gradient[i].d);
             });
    }

private:
    template <class Functions, class Sink>
    void each(const Functions& functions, const std::vector<int>& joints, double t, const double* q, Order order,
              const Sink& sink) {
        if (functions.empty()) return;
        at_.time = {t, 1.0};
        std::copy_n(q, q_.size(), q_.begin());
        place(joints, q_.data(), at_);
        for (std::size_t k = 0; k < functions.size(); ++k) {
            functions[k]->evaluate(at_, q_.data(), order, local_);
            sink(*functions[k], static_cast<int>(k), local_);
        }
    }

    const Mechanism& m_;
    Placement<Dual<double>> at_;
    std::vector<Dual<double>> q_;
    LocalTaylor<Dual<double>> local_;
};

}  // namespace leastaction
