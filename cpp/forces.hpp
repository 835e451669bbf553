// Generalized forces: inputs and damping at joints.
#pragma once

#include "elements.hpp"

namespace leastaction {

// An input straight onto a dynamic variable: f_i = u_a.
class JointForce final : public GeneralizedForce {
public:
    JointForce(int variable, int input, int n_inputs) : variable_(variable), input_(input), n_inputs_(n_inputs) {}

    void add_force(const double*, const double*, const double* u, double* f) const override {
        f[variable_] += u[input_];
    }
    void add_jacobians(const double*, const double*, const double*, double*, double*, double* f_u) const override {
        f_u[variable_ * n_inputs_ + input_] += 1.0;
    }
    void add_diagonals(const double*, const double*, const double*, double*, double*) const override {}
    std::vector<std::pair<int, int>> couplings() const override { return {}; }

private:
    int variable_, input_, n_inputs_;
};

// Viscous damping at joints: f_i = -c_i v_i.
class JointDamping final : public GeneralizedForce {
public:
    JointDamping(std::vector<double> coefficients, int n_variables)
        : coefficients_(std::move(coefficients)), n_variables_(n_variables) {}

    void add_force(const double*, const double* v, const double*, double* f) const override {
        for (std::size_t i = 0; i < coefficients_.size(); ++i) f[i] -= coefficients_[i] * v[i];
    }
    void add_jacobians(const double*, const double*, const double*, double*, double* f_v, double*) const override {
        for (std::size_t i = 0; i < coefficients_.size(); ++i) f_v[i * n_variables_ + i] -= coefficients_[i];
    }
    void add_diagonals(const double*, const double*, const double*, double*, double* f_v) const override {
        for (std::size_t i = 0; i < coefficients_.size(); ++i) f_v[i] -= coefficients_[i];
    }
    std::vector<std::pair<int, int>> couplings() const override { return {}; }

private:
    std::vector<double> coefficients_;  // by dynamic variable, internal order
    int n_variables_;
};

}  // namespace leastaction
