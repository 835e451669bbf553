// Generalized forces f(q, v, u).
//
// All but wrenches act along a scalar coordinate s: f_i = F ds/dq_i, where the magnitude F depends on a few coordinates c_k
// (the first of which is s), on their rates and on inputs. Joint damping and joint forces are so common that the mechanism
// keeps them as plain lists.
#pragma once

#include <memory>

#include "elements/laws.hpp"
#include "elements/local_function.hpp"

namespace leastaction {

// The magnitude F(y), y = [c (n) | their rates (n) | inputs (r)], is a local function. This one is
// F = gain * u * by_place(c) * by_rate(rate of c) of one coordinate; without an input, or a law, its factor is 1.
std::shared_ptr<const LocalFunction> product_magnitude(int gain_slot, bool has_input,
                                                       std::shared_ptr<const Law> by_place,
                                                       std::shared_ptr<const Law> by_rate);

class CoordinateForce final : public ForceOnAnyScalar<CoordinateForce> {
public:
    CoordinateForce(std::vector<std::shared_ptr<const ConfigurationFunction>> coordinates, std::vector<int> inputs,
                    std::shared_ptr<const LocalFunction> magnitude);
    void curvature(const ForcePoint<double>& point, const ForceDirections& directions,
                   LocalForce<double>& out) const override;

    template <class T>
    void evaluate_on(const ForcePoint<T>& point, Order order, LocalForce<T>& out) const;

private:
    // Coordinates and their rates at the point, into out.coordinates and the y of the magnitude.
    template <class T>
    void measure(const ForcePoint<T>& point, Order order, LocalForce<T>& out) const;
    template <class T>
    struct Workspace;  // how the work space is divided

    std::vector<std::shared_ptr<const ConfigurationFunction>> coordinates_;
    std::vector<std::vector<int>> index_;  // by coordinate: its support in that of the force
    std::shared_ptr<const LocalFunction> magnitude_;
};

}  // namespace leastaction
