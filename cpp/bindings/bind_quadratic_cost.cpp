// Python access to quadratic costs; leastaction.optimal.discrete.cost says what the arguments mean.

#include <nanobind/nanobind.h>

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

void add_half_squares_of(const In<2>& values, const Wanted& wanted, const Weight& weight, const Row& out) {
    const Deviations off = deviations_of(values, wanted, "wanted");
    expect(out.size(), off.rows, "out");
    add_half_squares(off, weights_of(weight, off.rows, off.n, "weight"), out.data());
}

void weigh_rows_of(const In<2>& values, const Wanted& wanted, const Weight& weight, const Rows& out) {
    const Deviations off = deviations_of(values, wanted, "wanted");
    expect(out.shape(0), off.rows, "out");
    expect(out.shape(1), off.n, "out");
    weigh_rows(off, weights_of(weight, off.rows, off.n, "weight"), out.data());
}

}  // namespace

void bind_quadratic_cost(nb::module_& m) {
    m.def("add_half_squares", &add_half_squares_of, "values"_a, "wanted"_a, "weight"_a, "out"_a,
          "Adds half the weighted square of what each row of values is off by.");
    m.def("weigh_rows", &weigh_rows_of, "values"_a, "wanted"_a, "weight"_a, "out"_a,
          "Writes a weight times what each row of values is off by.");
}

}  // namespace leastaction
