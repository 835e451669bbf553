// Python access to quadratic costs; leastaction.optimal.discrete.cost says what the arguments mean.

#include <nanobind/nanobind.h>

#include <algorithm>
#include <tuple>

#include "arrays.hpp"
#include "optimal/quadratic_cost.hpp"

using namespace nanobind::literals;

namespace leastaction {
namespace {

using Wanted = nb::ndarray<const double, nb::device::cpu>;
using Weight = nb::ndarray<const double, nb::c_contig, nb::device::cpu>;
using Rows = nb::ndarray<double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Row = nb::ndarray<double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

// Rows, and what is wanted: (n,), or (rows, n) whose rows may all be one in memory.
Deviations deviations_of(const In<2>& values, const Wanted& wanted, const char* what) {
    const std::size_t rows = values.shape(0), n = values.shape(1);
    if (wanted.ndim() != 1 && wanted.ndim() != 2) throw std::invalid_argument(std::string(what) + ": too many axes");
    const bool same = wanted.ndim() == 1;
    expect(wanted.shape(same ? 0 : 1), n, what);
    if (!same) expect(wanted.shape(0), rows, what);
    if (n > 1 && wanted.stride(same ? 0 : 1) != 1) throw std::invalid_argument(std::string(what) + ": not by rows");
    return {rows, n, values.data(), wanted.data(), same ? 0 : static_cast<std::ptrdiff_t>(wanted.stride(0))};
}

// A weight (n,), (n, n), (rows, n, 1) or (rows, n, n).
RowWeights weights_of(const Weight& weight, std::size_t rows, std::size_t n, const char* what) {
    const bool by_rows = weight.ndim() == 3;
    const bool diagonal = weight.ndim() == 1 || (by_rows && weight.shape(2) == 1);
    if (by_rows) expect(weight.shape(0), rows, what);
    expect(weight.size(), (by_rows ? rows : 1) * (diagonal ? n : n * n), what);
    return {weight.data(), diagonal, by_rows ? static_cast<std::ptrdiff_t>(diagonal ? n : n * n) : 0};
}

void stages_of(const In<2>& x, const Wanted& x_wanted, const Weight& Q, const In<2>& u, const Wanted& u_wanted,
               const Weight& R, const Row& out) {
    std::fill_n(out.data(), out.size(), 0.0);
    for (const auto& [values, wanted, weight] : {std::tie(x, x_wanted, Q), std::tie(u, u_wanted, R)}) {
        const Deviations off = deviations_of(values, wanted, "wanted");
        expect(out.size(), off.rows, "out");
        add_half_squares(off, weights_of(weight, off.rows, off.n, "weight"), out.data());
    }
}

double final_of(const In<1>& x, const In<1>& wanted, const Weight& weight) {
    const Deviations off{1, x.size(), x.data(), wanted.data(), 0};
    expect(wanted.size(), off.n, "wanted");
    double value = 0.0;
    add_half_squares(off, weights_of(weight, 1, off.n, "weight"), &value);
    return value;
}

// Of the first rows of values, as many as there are of the derivatives.
void weigh_first(Deviations off, const Weight& weight, const Rows& out) {
    off.rows = std::min(off.rows, out.shape(0));
    expect(out.shape(0), off.rows, "out");
    expect(out.shape(1), off.n, "out");
    weigh_rows(off, weights_of(weight, off.rows, off.n, "weight"), out.data());
}

void gradient_of(const In<2>& x, const Wanted& x_wanted, const Weight& Q, const Weight& Q_final, const In<2>& u,
                 const Wanted& u_wanted, const Weight& R, const Rows& q, const Rows& r, const Row& q_final) {
    const Deviations states = deviations_of(x, x_wanted, "x_wanted");
    weigh_first(states, Q, q);
    weigh_first(deviations_of(u, u_wanted, "u_wanted"), R, r);
    const std::size_t last = states.rows - 1;
    expect(last, q.shape(0), "q");
    expect(q_final.size(), states.n, "q_final");
    weigh_rows({1, states.n, states.values + last * states.n,
                states.wanted + static_cast<std::ptrdiff_t>(last) * states.wanted_stride, 0},
               weights_of(Q_final, 1, states.n, "Q_final"), q_final.data());
}

}  // namespace

void bind_quadratic_cost(nb::module_& m) {
    m.def("quadratic_stages", &stages_of, "x"_a, "x_wanted"_a, "Q"_a, "u"_a, "u_wanted"_a, "R"_a, "out"_a,
          "Writes half the weighted squares of what the states and inputs of each stage are off by.");
    m.def("quadratic_final", &final_of, "x"_a, "wanted"_a, "weight"_a,
          "Half the weighted square of what a state is off by.");
    m.def("quadratic_gradient", &gradient_of, "x"_a, "x_wanted"_a, "Q"_a, "Q_final"_a, "u"_a, "u_wanted"_a, "R"_a,
          "q"_a, "r"_a, "q_final"_a, "Writes the derivatives of all stages, and of the last state.");
}

}  // namespace leastaction
