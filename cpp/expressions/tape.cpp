#include "expressions/tape.hpp"

#include <algorithm>
#include <array>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

#include "numerics/dual_functions.hpp"

namespace leastaction {

namespace {

constexpr std::array<const char*, n_operations> names = {
    "add",  "sub",  "mul",  "div",   "neg",  "pow",  "sqrt", "exp",   "log",   "sin",   "cos", "tan",
    "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh", "abs"};

[[noreturn]] void refuse(std::size_t at, const std::string& what) {
    throw std::invalid_argument("instruction " + std::to_string(at) + " of the tape: " + what);
}

// How the second derivatives of an operation look, so that the sweeps leave out what is always zero.
enum class Bend { none, product, one_operand, full };

Bend bend_of(Operation operation) {
    switch (operation) {
        case Operation::add:
        case Operation::subtract:
        case Operation::negate:
        case Operation::absolute:
            return Bend::none;
        case Operation::multiply:
            return Bend::product;
        case Operation::divide:
        case Operation::arctangent2:
            return Bend::full;
        default:
            return Bend::one_operand;
    }
}

// Value of an instruction, and its derivatives by its operands as far as the order asks and they are not always zero.
template <class T>
T apply(Operation operation, const T& a, const T& b, Order order, Partials<T>& d) {
    using std::abs, std::acos, std::acosh, std::asin, std::asinh, std::atan, std::atan2, std::atanh, std::cos,
        std::cosh, std::exp, std::log, std::pow, std::sin, std::sinh, std::sqrt, std::tan, std::tanh;
    const bool first = order != Order::value, second = order == Order::hessian;
    T value{};
    switch (operation) {
        case Operation::add:
            d.a = d.b = 1.0;
            return a + b;
        case Operation::subtract:
            d.a = 1.0;
            d.b = -1.0;
            return a - b;
        case Operation::multiply:
            d.a = b;
            d.b = a;
            return a * b;
        case Operation::negate:
            d.a = -1.0;
            return -a;
        case Operation::divide:
            value = a / b;
            if (first) {
                d.a = 1.0 / b;
                d.b = -(value * d.a);
            }
            if (second) {
                d.aa = 0.0;
                d.ab = -(d.a * d.a);
                d.bb = -2.0 * (d.b * d.a);
            }
            return value;
        case Operation::power: {
            const double p = value_of(b);
            if (first) d.a = p * pow(a, p - 1.0);
            if (second) d.aa = p * (p - 1.0) * pow(a, p - 2.0);
            return pow(a, p);
        }
        case Operation::square_root:
            value = sqrt(a);
            if (first) d.a = 0.5 / value;
            if (second) d.aa = -0.5 * (d.a / a);
            return value;
        case Operation::exponential:
            value = exp(a);
            if (first) d.a = value;
            if (second) d.aa = value;
            return value;
        case Operation::logarithm:
            if (first) d.a = 1.0 / a;
            if (second) d.aa = -(d.a * d.a);
            return log(a);
        case Operation::sine:
            value = sin(a);
            if (first) d.a = cos(a);
            if (second) d.aa = -value;
            return value;
        case Operation::cosine:
            value = cos(a);
            if (first) d.a = -sin(a);
            if (second) d.aa = -value;
            return value;
        case Operation::tangent:
            value = tan(a);
            if (first) d.a = 1.0 + value * value;
            if (second) d.aa = 2.0 * (value * d.a);
            return value;
        case Operation::arcsine:
            if (first) d.a = 1.0 / sqrt((1.0 - a) * (1.0 + a));
            if (second) d.aa = a * (d.a * d.a * d.a);
            return asin(a);
        case Operation::arccosine:
            if (first) d.a = -1.0 / sqrt((1.0 - a) * (1.0 + a));
            if (second) d.aa = a * (d.a * d.a * d.a);
            return acos(a);
        case Operation::arctangent:
            if (first) d.a = 1.0 / (1.0 + a * a);
            if (second) d.aa = -2.0 * (a * (d.a * d.a));
            return atan(a);
        case Operation::arctangent2:
            if (first) {
                const T square = a * a + b * b;
                d.a = b / square;
                d.b = -a / square;
            }
            if (second) {
                d.aa = 2.0 * (d.a * d.b);
                d.ab = d.b * d.b - d.a * d.a;
                d.bb = -d.aa;
            }
            return atan2(a, b);
        case Operation::hyperbolic_sine:
            value = sinh(a);
            if (first) d.a = cosh(a);
            if (second) d.aa = value;
            return value;
        case Operation::hyperbolic_cosine:
            value = cosh(a);
            if (first) d.a = sinh(a);
            if (second) d.aa = value;
            return value;
        case Operation::hyperbolic_tangent:
            value = tanh(a);
            if (first) d.a = 1.0 - value * value;
            if (second) d.aa = -2.0 * (value * d.a);
            return value;
        case Operation::inverse_hyperbolic_sine:
            if (first) d.a = 1.0 / sqrt(1.0 + a * a);
            if (second) d.aa = -(a * (d.a * d.a * d.a));
            return asinh(a);
        case Operation::inverse_hyperbolic_cosine:
            if (first) d.a = 1.0 / sqrt((a - 1.0) * (a + 1.0));
            if (second) d.aa = -(a * (d.a * d.a * d.a));
            return acosh(a);
        case Operation::inverse_hyperbolic_tangent:
            if (first) d.a = 1.0 / ((1.0 - a) * (1.0 + a));
            if (second) d.aa = 2.0 * (a * (d.a * d.a));
            return atanh(a);
        case Operation::absolute:
            if (first) d.a = sign_of(a);
            return abs(a);
    }
    return value;
}

template <class T>
void at_least(std::vector<T>& space, std::size_t size) {
    if (space.size() < size) space.resize(size);
}

}  // namespace

const char* name_of(Operation operation) { return names.at(static_cast<std::size_t>(operation)); }

bool is_unary(Operation operation) {
    switch (operation) {
        case Operation::add:
        case Operation::subtract:
        case Operation::multiply:
        case Operation::divide:
        case Operation::power:
        case Operation::arctangent2:
            return false;
        default:
            return true;
    }
}

Tape::Tape(int n_inputs, std::vector<Instruction> instructions, std::vector<double> constants)
    : n_inputs_(n_inputs), instructions_(std::move(instructions)), constants_(std::move(constants)) {
    if (n_inputs_ < 0) throw std::invalid_argument("tape: the number of inputs is negative");
    const int first_constant = n_inputs_, first_result = n_inputs_ + static_cast<int>(constants_.size());
    constexpr int none = std::numeric_limits<int>::max();
    for (int i = 0; i < n_inputs_; ++i) first_input_.push_back(i);
    first_input_.resize(first_result, none);
    for (std::size_t i = 0; i < instructions_.size(); ++i) {
        auto& [operation, a, b] = instructions_[i];
        const int code = static_cast<int>(operation), here = first_result + static_cast<int>(i);
        if (code < 0 || code >= n_operations)
            refuse(i,
                   "unknown operation " + std::to_string(code) + "; expected 0 to " + std::to_string(n_operations - 1));
        if (is_unary(operation)) b = a;
        for (const int operand : {a, b})
            if (operand < 0 || operand >= here)
                refuse(i, std::string(name_of(operation)) + " of value " + std::to_string(operand) +
                              "; expected a value before its own, 0 to " + std::to_string(here - 1));
        if (operation == Operation::power && (b < first_constant || b >= first_result))
            refuse(i, "the exponent of pow is value " + std::to_string(b) + ", which is no constant; those are " +
                          std::to_string(first_constant) + " to " + std::to_string(first_result - 1));
        first_input_.push_back(std::min(first_input_[a], first_input_[b]));
    }
    if (first_input_.empty()) throw std::invalid_argument("tape: no input, constant or instruction, so no result");
}

template <class T>
void Tape::forward(const T* z, int m, Order order, TapeWork<T>& work) const {
    const int first_result = n_inputs_ + static_cast<int>(constants_.size());
    T* values = work.values.data();
    std::copy_n(z, n_inputs_, values);
    std::copy(constants_.begin(), constants_.end(), values + n_inputs_);
    for (std::size_t i = 0; i < instructions_.size(); ++i) {
        const auto [operation, a, b] = instructions_[i];
        const int here = first_result + static_cast<int>(i);
        const Order needed = first_input_[here] < m ? order : Order::value;
        values[here] = apply(operation, values[a], values[b], needed, work.partials[i]);
    }
}

// Derivatives of every value by every input: all m of them in the inner loops.
template <class T>
void Tape::forward_tangents(int m, TapeWork<T>& work) const {
    const int first_result = n_inputs_ + static_cast<int>(constants_.size());
    T* tangents = work.tangents.data();
    std::fill_n(tangents, m * m, T{});
    for (int i = 0; i < m; ++i) tangents[i * m + i] = 1.0;
    for (std::size_t i = 0; i < instructions_.size(); ++i) {
        const auto [operation, a, b] = instructions_[i];
        const int here = first_result + static_cast<int>(i);
        if (first_input_[here] >= m) continue;
        const Partials<T>& d = work.partials[i];
        const T *dot_a = tangents + a * m, *dot_b = tangents + b * m;
        T* out = tangents + here * m;
        if (is_unary(operation) || first_input_[b] >= m)
            for (int k = 0; k < m; ++k) out[k] = d.a * dot_a[k];
        else if (first_input_[a] >= m)
            for (int k = 0; k < m; ++k) out[k] = d.b * dot_b[k];
        else
            for (int k = 0; k < m; ++k) out[k] = d.a * dot_a[k] + d.b * dot_b[k];
    }
}

// Derivatives of the result by every value; with `bends`, also the derivatives of those by every input.
template <class T>
void Tape::reverse(int m, bool bends, TapeWork<T>& work) const {
    const int first_result = n_inputs_ + static_cast<int>(constants_.size());
    T* adjoints = work.adjoints.data();
    const T* tangents = work.tangents.data();
    T* adjoint_tangents = work.adjoint_tangents.data();
    std::fill_n(adjoints, n_values(), T{});
    if (bends) std::fill_n(adjoint_tangents, n_values() * m, T{});
    adjoints[n_values() - 1] = 1.0;
    // Adds what operand x gets: slope dx, second derivatives xx and (if there is another operand y) xy.
    const auto pass = [&](int here, int x, const T& dx, const T* xx, int y, const T* xy) {
        const T adjoint = adjoints[here];
        adjoints[x] += adjoint * dx;
        if (!bends) return;
        const T* from = adjoint_tangents + here * m;
        T* to = adjoint_tangents + x * m;
        for (int k = 0; k < m; ++k) to[k] += dx * from[k];
        if (xx) {
            const T bend = adjoint * *xx;
            const T* dot = tangents + x * m;
            for (int k = 0; k < m; ++k) to[k] += bend * dot[k];
        }
        if (xy && first_input_[y] < m) {
            const T bend = adjoint * *xy;
            const T* dot = tangents + y * m;
            for (int k = 0; k < m; ++k) to[k] += bend * dot[k];
        }
    };
    const T one(1.0);
    for (std::size_t i = instructions_.size(); i-- > 0;) {
        const auto [operation, a, b] = instructions_[i];
        const int here = first_result + static_cast<int>(i);
        if (first_input_[here] >= m) continue;
        const Partials<T>& d = work.partials[i];
        const Bend bend = bend_of(operation);
        const bool full = bend == Bend::full, product = bend == Bend::product;
        const T* ab = full ? &d.ab : product ? &one : nullptr;
        if (first_input_[a] < m) pass(here, a, d.a, full || bend == Bend::one_operand ? &d.aa : nullptr, b, ab);
        if (!is_unary(operation) && first_input_[b] < m) pass(here, b, d.b, full ? &d.bb : nullptr, a, ab);
    }
}

template <class T>
void Tape::evaluate(const T* z, int m, Order order, T& value, T* gradient, T* hessian, TapeWork<T>& work) const {
    const std::size_t n = n_values();
    const bool bends = order == Order::hessian;
    at_least(work.values, n);
    at_least(work.partials, instructions_.size());
    if (order != Order::value) at_least(work.adjoints, n);
    if (bends) {
        at_least(work.tangents, n * m);
        at_least(work.adjoint_tangents, n * m);
    }
    forward(z, m, order, work);
    value = work.values[n - 1];
    if (order == Order::value) return;
    if (bends) forward_tangents(m, work);
    reverse(m, bends, work);
    std::copy_n(work.adjoints.begin(), m, gradient);
    if (!bends) return;
    // Both halves are the same but for rounding; one is taken for both, so that sums of such matrices stay symmetric.
    for (int i = 0; i < m; ++i)
        for (int j = 0; j <= i; ++j) hessian[i * m + j] = hessian[j * m + i] = work.adjoint_tangents[i * m + j];
}

template void Tape::evaluate(const double*, int, Order, double&, double*, double*, TapeWork<double>&) const;
template void Tape::evaluate(const Dual<double>*, int, Order, Dual<double>&, Dual<double>*, Dual<double>*,
                             TapeWork<Dual<double>>&) const;
template void Tape::evaluate(const HyperDual*, int, Order, HyperDual&, HyperDual*, HyperDual*,
                             TapeWork<HyperDual>&) const;

}  // namespace leastaction
