// Functions of the user's own, written in Python. They take the interpreter's lock for each call.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/stl/complex.h>

#include <complex>

#include "bindings/arrays.hpp"
#include "elements/local_function.hpp"

namespace leastaction {

// function(z, order) -> (value, gradient, Hessian), with z an array of floats; of complex numbers where the derivative
// along a direction is asked for, which then is the imaginary part of a complex step.
class PythonFunction final : public LocalFunction {
public:
    explicit PythonFunction(nb::object function);
    ~PythonFunction() override;
    PythonFunction(const PythonFunction&) = delete;
    PythonFunction& operator=(const PythonFunction&) = delete;

    void evaluate(const LocalCall<double>& call) const override;
    void evaluate(const LocalCall<Dual<double>>& call) const override;
    // A complex step gives one direction only: throws std::domain_error.
    void evaluate(const LocalCall<HyperDual>& call) const override;

private:
    // Value, gradient (n) and Hessian (n x n) in a row, as far as the order asks.
    template <class Number>
    std::vector<Number> ask(std::vector<Number> z, Order order) const;

    static constexpr double step = 1e-30;  // complex: no difference is taken, so it may be as small as it likes
    nb::object function_;
};

inline PythonFunction::PythonFunction(nb::object function) : function_(std::move(function)) {}

inline PythonFunction::~PythonFunction() {
    // The last owner may be a thread without the lock.
    nb::gil_scoped_acquire acquire;
    function_.reset();
}

template <class Number>
std::vector<Number> PythonFunction::ask(std::vector<Number> z, Order order) const {
    using Argument = nb::ndarray<nb::numpy, Number, nb::ndim<1>, nb::c_contig>;
    using Result = nb::ndarray<const Number, nb::c_contig, nb::device::cpu>;
    nb::gil_scoped_acquire acquire;
    const std::size_t n = z.size();
    // A copy of its own for each call: what Python is given it may keep.
    auto* data = new std::vector<Number>(std::move(z));
    const nb::capsule owner(data, [](void* p) noexcept { delete static_cast<std::vector<Number>*>(p); });
    const nb::object returned = function_(nb::cast(Argument(data->data(), {n}, owner)), static_cast<int>(order));
    const nb::tuple parts = nb::cast<nb::tuple>(returned);
    expect(parts.size(), 3, "what a function in Python returned");
    std::vector<Number> out{nb::cast<Number>(parts[0])};
    const auto append = [&](const nb::handle& part, std::size_t size, const char* what) {
        const auto values = nb::cast<Result>(part);
        expect(values.size(), size, what);
        out.insert(out.end(), values.data(), values.data() + size);
    };
    if (order != Order::value) append(parts[1], n, "gradient of a function in Python");
    if (order == Order::hessian) append(parts[2], n * n, "Hessian of a function in Python");
    return out;
}

inline void PythonFunction::evaluate(const LocalCall<double>& call) const {
    const std::vector<double> out = ask(std::vector<double>(call.z, call.z + call.n), call.order);
    call.value = out[0];
    if (call.order != Order::value) std::copy_n(out.begin() + 1, call.n, call.gradient);
    if (call.order == Order::hessian) std::copy_n(out.begin() + 1 + call.n, call.n * call.n, call.hessian);
}

inline void PythonFunction::evaluate(const LocalCall<Dual<double>>& call) const {
    const int n = call.n;
    std::vector<std::complex<double>> complex(n);
    for (int i = 0; i < n; ++i) complex[i] = {call.z[i].v, step * call.z[i].d};
    const auto out = ask(std::move(complex), call.order);
    const auto dual = [](const std::complex<double>& x) { return Dual<double>(x.real(), x.imag() / step); };
    call.value = dual(out[0]);
    for (int i = 0; i < n && call.order != Order::value; ++i) call.gradient[i] = dual(out[1 + i]);
    for (int i = 0; i < n * n && call.order == Order::hessian; ++i) call.hessian[i] = dual(out[1 + n + i]);
}

inline void PythonFunction::evaluate(const LocalCall<HyperDual>&) const {
    throw std::domain_error(
        "second derivatives in continuous time need the fourth order of every constraint, which a function in Python "
        "does not give; state the constraint as an expression, or use first derivatives only");
}

// The magnitude of a force in Python, times a number of the mechanism.
struct PythonMagnitude {
    std::shared_ptr<const PythonFunction> function;
    int gain_slot;

    template <class T>
    void on(const LocalCall<T>& call) const {
        function->evaluate(call);
        const int n = call.n;
        const T gain = call.at.number(gain_slot);
        call.value = gain * call.value;
        for (int i = 0; i < n && call.order != Order::value; ++i) call.gradient[i] = gain * call.gradient[i];
        for (int i = 0; i < n * n && call.order == Order::hessian; ++i) call.hessian[i] = gain * call.hessian[i];
    }
};
inline std::shared_ptr<const LocalFunction> python_magnitude(nb::object function, int gain_slot) {
    return std::make_shared<OnAnyCall<PythonMagnitude>>(
        PythonMagnitude{std::make_shared<PythonFunction>(std::move(function)), gain_slot});
}

}  // namespace leastaction
