// Generalized forces f(q, v, u).
//
// All but wrenches act along a scalar coordinate s: f_i = F ds/dq_i, where the magnitude F depends on a few coordinates c_k
// (the first of which is s), on their rates and on inputs. Joint damping and joint forces are so common that the mechanism
// keeps them as plain lists.
#pragma once

#include <memory>

#include "elements/elements.hpp"
#include "elements/laws.hpp"

namespace leastaction {

// F(y) with y = [c (n) | their rates (n) | inputs (r)], its gradient, and its Hessian.
template <class T>
struct MagnitudeCall {
    const Placement<T>& at;
    const T* y;
    int size;
    Order order;
    T &value, *gradient, *hessian;
};
class Magnitude {
public:
    virtual ~Magnitude() = default;
    virtual void evaluate(const MagnitudeCall<double>& call) const = 0;
    virtual void evaluate(const MagnitudeCall<Dual<double>>& call) const = 0;
    virtual void evaluate(const MagnitudeCall<HyperDual>& call) const = 0;
};

// F = gain * u * by_place(c) * by_rate(rate of c) of one coordinate; without an input, or a law, its factor is 1.
std::shared_ptr<const Magnitude> product_magnitude(int gain_slot, bool has_input, std::shared_ptr<const Law> by_place,
                                                   std::shared_ptr<const Law> by_rate);
// F from a recorded expression.
std::shared_ptr<const Magnitude> tape_magnitude(std::shared_ptr<const Tape> tape, std::vector<int> slots);

class CoordinateForce final : public GeneralizedForce {
public:
    CoordinateForce(std::vector<std::shared_ptr<const ConfigurationFunction>> coordinates, std::vector<int> inputs,
                    std::shared_ptr<const Magnitude> magnitude);
    void evaluate(const ForcePoint<double>& point, Order order, LocalForce<double>& out) const override {
        evaluate_on(point, order, out);
    }
    void evaluate(const ForcePoint<Dual<double>>& point, Order order, LocalForce<Dual<double>>& out) const override {
        evaluate_on(point, order, out);
    }
    void evaluate(const ForcePoint<HyperDual>& point, Order order, LocalForce<HyperDual>& out) const override {
        evaluate_on(point, order, out);
    }
    void curvature(const ForcePoint<double>& point, const ForceDirections& directions,
                   LocalForce<double>& out) const override;

private:
    template <class T>
    void evaluate_on(const ForcePoint<T>& point, Order order, LocalForce<T>& out) const;
    // Coordinates and their rates at the point, into out.coordinates and the y of the magnitude.
    template <class T>
    void measure(const ForcePoint<T>& point, Order order, LocalForce<T>& out) const;
    template <class T>
    struct Workspace;  // how the work space is divided

    std::vector<std::shared_ptr<const ConfigurationFunction>> coordinates_;
    std::vector<std::vector<int>> index_;  // by coordinate: its support in that of the force
    std::shared_ptr<const Magnitude> magnitude_;
};

}  // namespace leastaction
