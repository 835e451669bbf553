// What a mechanism is asked at one point: functions of it with their gradient and Hessian, or the derivatives of all three
// along directions, none, one or two. So the Hessian goes to the third order contracted with one direction, and to the fourth
// contracted with two, by dual and hyper-dual numbers.
//
// Configurations, velocities and directions in internal order, results in the user's. Balls have the coordinates of their charts.
#pragma once

#include <vector>

#include "mechanism/mechanism.hpp"

namespace leastaction {

// Of m functions of n variables: values (m), gradients (m x n), and the Hessian (n x n) of their sum with weights.
struct FunctionDerivatives {
    std::vector<double> value, gradient, hessian;
};

// Directions that derivatives are taken along: the changes of q, and of v where the function knows a velocity.
struct Directions {
    std::vector<std::vector<double>> dq, dv;
};

// The Lagrangian of the bodies, uniform gravity included, without the other potentials, by [q; v].
FunctionDerivatives lagrangian_of_bodies(const Mechanism& m, const std::vector<double>& q, const std::vector<double>& v,
                                         const Directions& along);

// Potentials or constraints first .. last-1, by q, with a weight for each.
using Functions = std::vector<std::shared_ptr<const ConfigurationFunction>>;
FunctionDerivatives functions_of_configuration(const Mechanism& m, const Functions& functions, int first, int last,
                                               const double* weights, const std::vector<double>& q,
                                               const Directions& along);

// A state with inputs, or a direction of one.
struct StateAndInputs {
    std::vector<double> q, v, u;
};
// Derivatives along a direction of forces by [q; v; u], one for each variable: their Jacobian (by dual numbers), and the
// Hessian of their sum with weights (by hyper-dual ones, along the direction and each unit vector).
struct ForceDerivatives {
    std::vector<double> jacobian, hessian;
};
using Forces = std::vector<std::shared_ptr<const GeneralizedForce>>;
ForceDerivatives forces_along(const Mechanism& m, const Forces& forces, const std::vector<double>& weights,
                              const StateAndInputs& point, const StateAndInputs& along);

}  // namespace leastaction
