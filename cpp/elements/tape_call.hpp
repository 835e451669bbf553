// Evaluating a tape whose last inputs are numbers of the mechanism.
#pragma once

#include <algorithm>

#include "expressions/tape.hpp"

namespace leastaction {

// z: the first n inputs, by which gradient (n) and Hessian (n x n) are taken; the numbers of the slots follow them.
// `scale`: the size of the terms that cancel in the value, where asked for and the order is not that of the value alone.
template <class T>
void evaluate_tape(const Tape& tape, const std::vector<int>& slots, const Numbers<T>& at, const T* z, int n,
                   Order order, T& value, T* gradient, T* hessian, double* scale = nullptr) {
    thread_local TapeWork<T> work;  // grows to what the largest tape needs and stays
    thread_local std::vector<T> inputs;
    inputs.resize(n + slots.size());
    std::copy(z, z + n, inputs.begin());
    for (std::size_t k = 0; k < slots.size(); ++k) inputs[n + k] = at.number(slots[k]);
    tape.evaluate(inputs.data(), n, order, value, gradient, hessian, work);
    if (scale && order != Order::value) *scale = std::max(*scale, tape.scale(work));
}

}  // namespace leastaction
