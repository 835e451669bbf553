// A scalar function of a few variables and its derivatives there, as elements and tapes state them.
#pragma once

#include <vector>

#include "numerics/lanes.hpp"

namespace leastaction {

enum class Order { value, gradient, hessian };

// Value, gradient and Hessian of a scalar function over its support (m variables); Hessian row-major m x m.
template <class T>
struct LocalTaylor {
    T value{};
    SizeOf<T> scale{};  // size of the terms that cancel in the value, for relative tolerances
    std::vector<T> gradient;
    std::vector<T> hessian;
    std::vector<T> work, by_joint;   // room that evaluations need
    std::vector<LocalTaylor> inner;  // and those of what the function is made of
};

}  // namespace leastaction
