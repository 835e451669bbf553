// Tapes: scalar functions y = f(z) of the user's own, as a short list of instructions.
//
// A tape is what an expression is compiled to. It evaluates itself on double and on Dual<double>, and it differentiates
// itself: one sweep forward for the value, one back for the gradient, and the derivatives of both sweeps by every
// input for the Hessian. The third order along a direction comes from the dual scalar, as everywhere.
//
// Values are numbered: the inputs first, then the constants, then the results of the instructions in their order. The
// last of all is the result. An instruction uses values before its own only, so a tape cannot loop.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "numerics/dual.hpp"
#include "numerics/taylor.hpp"

namespace leastaction {

enum class Operation : std::int32_t {
    add,  // a + b
    subtract,
    multiply,
    divide,
    negate,
    power,  // a^b, b a constant; a > 0 unless b is a whole number
    square_root,
    exponential,
    logarithm,
    sine,
    cosine,
    tangent,
    arcsine,
    arccosine,
    arctangent,
    arctangent2,  // of a = y and b = x, smooth but on the half line y = 0, x <= 0
    hyperbolic_sine,
    hyperbolic_cosine,
    hyperbolic_tangent,
    inverse_hyperbolic_sine,
    inverse_hyperbolic_cosine,
    inverse_hyperbolic_tangent,
    absolute,  // smooth away from zero only, where its slope is taken as zero
};
inline constexpr int n_operations = static_cast<int>(Operation::absolute) + 1;

// The name as descriptions write it, such as "add" or "atan2".
const char* name_of(Operation operation);
// Whether it has one operand; the second is then ignored.
bool is_unary(Operation operation);

struct Instruction {
    Operation operation;
    std::int32_t a, b;
};

// Derivatives of one instruction by its operands; which are set depends on the operation and the order.
template <class T>
struct Partials {
    T a, b, aa, ab, bb;
};

// Work space of evaluate(); it grows to what a tape needs and then stays, so keep one for each thread.
template <class T>
struct TapeWork {
    std::vector<T> values, adjoints, tangents, adjoint_tangents;
    std::vector<Partials<T>> partials;
};

class Tape {
public:
    // Throws std::invalid_argument, saying which instruction is wrong, if an operation is unknown, an operand is not
    // before its instruction, an exponent is no constant, or there is no result.
    Tape(int n_inputs, std::vector<Instruction> instructions, std::vector<double> constants);

    int n_inputs() const { return n_inputs_; }
    const std::vector<Instruction>& instructions() const { return instructions_; }
    const std::vector<double>& constants() const { return constants_; }

    // Value at z (n_inputs), and its gradient (m) and Hessian (m x m, row-major, exactly symmetric) by the first m
    // inputs, as far as the order asks; what it does not ask for is not touched. Results that are not finite are passed
    // on.
    template <class T>
    void evaluate(const T* z, int m, Order order, T& value, T* gradient, T* hessian, TapeWork<T>& work) const;

    // Size of the terms that cancel in the value, for relative tolerances: the largest |value * its derivative| on the
    // way to the result, rounding of which the result carries. Of the last evaluate() with this work space, which must
    // have asked for the gradient at least.
    template <class T>
    double scale(const TapeWork<T>& work) const {
        double out = 0;
        for (int k = 0; k < n_values(); ++k)
            out = std::max(out, std::abs(value_of(work.adjoints[k]) * value_of(work.values[k])));
        return out;
    }

private:
    int n_values() const { return static_cast<int>(first_input_.size()); }
    template <class T>
    void forward(const T* z, int m, Order order, TapeWork<T>& work) const;
    template <class T>
    void forward_tangents(int m, TapeWork<T>& work) const;
    template <class T>
    void reverse(int m, bool bends, TapeWork<T>& work) const;

    int n_inputs_;
    std::vector<Instruction> instructions_;
    std::vector<double> constants_;
    // By value: the first input that it depends on. Only values with one below m have derivatives.
    std::vector<int> first_input_;
};

extern template void Tape::evaluate(const double*, int, Order, double&, double*, double*, TapeWork<double>&) const;
extern template void Tape::evaluate(const Dual<double>*, int, Order, Dual<double>&, Dual<double>*, Dual<double>*,
                                    TapeWork<Dual<double>>&) const;
extern template void Tape::evaluate(const HyperDual*, int, Order, HyperDual&, HyperDual*, HyperDual*,
                                    TapeWork<HyperDual>&) const;

}  // namespace leastaction
