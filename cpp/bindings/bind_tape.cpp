// Tapes: the compiled form of the user's expressions.

#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <cstdint>
#include <limits>

#include "bindings/arrays.hpp"
#include "expressions/tape.hpp"

using namespace nanobind::literals;

namespace leastaction {

namespace {

using Rows = nb::ndarray<const std::int64_t, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

Tape tape_of(int n_inputs, const Rows& rows, const In<1>& constants) {
    expect(rows.shape(1), 3, "an instruction");
    std::vector<Instruction> instructions;
    for (std::size_t i = 0; i < rows.shape(0); ++i) {
        const std::int64_t* row = rows.data() + 3 * i;
        for (int j = 0; j < 3; ++j)
            if (row[j] < std::numeric_limits<std::int32_t>::min() || row[j] > std::numeric_limits<std::int32_t>::max())
                throw std::invalid_argument("instruction " + std::to_string(i) + " of the tape: " +
                                            std::to_string(row[j]) + " is no operation and no value");
        instructions.push_back(
            {static_cast<Operation>(row[0]), static_cast<std::int32_t>(row[1]), static_cast<std::int32_t>(row[2])});
    }
    return Tape(n_inputs, std::move(instructions), {constants.data(), constants.data() + constants.size()});
}

void expect_inputs(const Tape& tape, std::size_t got, int m) {
    expect(got, tape.n_inputs(), "z");
    if (m < 0 || m > tape.n_inputs())
        throw std::invalid_argument("m: got " + std::to_string(m) + ", expected 0 to " +
                                    std::to_string(tape.n_inputs()));
}

}  // namespace

void bind_tape(nb::module_& module) {
    nb::class_<Tape>(module, "Tape",
                     "A scalar function of n inputs as instructions (n, 3) [operation, a, b] on numbered values: the "
                     "inputs, the constants, the results in order; the last is the result.")
        .def(
            "__init__",
            [](Tape* self, int n_inputs, const Rows& instructions, const In<1>& constants) {
                new (self) Tape(tape_of(n_inputs, instructions, constants));
            },
            "n_inputs"_a, "instructions"_a, "constants"_a)
        .def_prop_ro_static(
            "operations",
            [](nb::handle) {
                std::vector<std::string> names;
                for (int code = 0; code < n_operations; ++code)
                    names.emplace_back(name_of(static_cast<Operation>(code)));
                return names;
            },
            "Names of the operations; the place in the list is the code.")
        .def_prop_ro("n_inputs", &Tape::n_inputs)
        .def(
            "evaluate",
            [](const Tape& tape, const In<1>& z, int m, int order) {
                expect_inputs(tape, z.size(), m);
                if (order < 0 || order > 2)
                    throw std::invalid_argument("order: got " + std::to_string(order) + ", expected 0, 1 or 2");
                const std::size_t n = m;
                Out gradient = zeros({n}), hessian = zeros({n, n});
                double value = 0.0;
                TapeWork<double> work;
                tape.evaluate(z.data(), m, static_cast<Order>(order), value, gradient.data(), hessian.data(), work);
                return std::tuple(value, gradient, hessian);
            },
            "z"_a, "m"_a, "order"_a = 2,
            "Value, and up to the order (0, 1, 2) gradient (m,) and Hessian (m, m) by the first m inputs; zeros above.")
        .def(
            "scale",
            [](const Tape& tape, const In<1>& z, int m) {
                expect_inputs(tape, z.size(), m);
                std::vector<double> gradient(m);
                double value = 0.0;
                TapeWork<double> work;
                tape.evaluate<double>(z.data(), m, Order::gradient, value, gradient.data(), nullptr, work);
                return tape.scale(work);
            },
            "z"_a, "m"_a, "Size of the terms that cancel in the value, as far as they depend on the first m inputs.")
        .def(
            "third",
            [](const Tape& tape, const In<1>& z, const In<1>& dz, int m) {
                expect_inputs(tape, z.size(), m);
                expect_inputs(tape, dz.size(), m);
                const std::size_t n = m;
                std::vector<Dual<double>> at, g(n), H(n * n);
                for (std::size_t i = 0; i < z.size(); ++i) at.emplace_back(z.data()[i], dz.data()[i]);
                Dual<double> value;
                TapeWork<Dual<double>> work;
                tape.evaluate(at.data(), m, Order::hessian, value, g.data(), H.data(), work);
                Out gradient = new_array({n}), hessian = new_array({n, n});
                for (std::size_t i = 0; i < n; ++i) gradient.data()[i] = g[i].d;
                for (std::size_t i = 0; i < n * n; ++i) hessian.data()[i] = H[i].d;
                return std::tuple(value.d, gradient, hessian);
            },
            "z"_a, "dz"_a, "m"_a, "Derivative of value, gradient and Hessian along dz.");
}

}  // namespace leastaction
