// Python access to the linear-quadratic recursion. Shapes are checked here once more, because a wrong
// one would read past the end of an array; meaning and defaults live in leastaction.optimal.

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "optimal/interior_program.hpp"
#include "optimal/linear_quadratic.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace leastaction {
namespace {

using Input = nb::ndarray<const double, nb::c_contig, nb::device::cpu>;
using Output = nb::ndarray<double, nb::c_contig, nb::device::cpu>;
using Pattern = nb::ndarray<const bool, nb::c_contig, nb::device::cpu>;
using MaybeInput = std::optional<Input>;
using MaybePlaces = std::optional<nb::ndarray<const std::int64_t, nb::c_contig, nb::device::cpu>>;
using MaybeOutput = std::optional<Output>;

void require(bool condition, const char* what) {
    if (!condition) throw std::invalid_argument(std::string("linear-quadratic problem: ") + what);
}

template <class Array>
bool has_shape(const Array& array, std::initializer_list<std::size_t> shape) {
    if (array.ndim() != shape.size()) return false;
    std::size_t axis = 0;
    for (std::size_t size : shape) {
        if (array.shape(axis++) != size) return false;
    }
    return true;
}

const double* checked(const MaybeInput& array, std::initializer_list<std::size_t> shape, const char* what) {
    if (!array) return nullptr;
    require(has_shape(*array, shape), what);
    return array->data();
}

HessianPart part_of(const MaybeInput& data, const MaybePlaces& columns, std::size_t N, std::size_t n) {
    static_assert(sizeof(std::int64_t) == sizeof(std::ptrdiff_t));
    require(data.has_value() == columns.has_value(), "part and part_columns go together");
    if (!data) return {};
    require(columns->ndim() == 1, "part_columns must have one axis");
    const std::size_t size = columns->shape(0);
    require(has_shape(*data, {N, size, size}), "part must have shape (N, n, n) for n part_columns");
    const auto* at = reinterpret_cast<const std::ptrdiff_t*>(columns->data());
    for (std::size_t i = 0; i < size; ++i) {
        const bool sound = at[i] >= 0 && at[i] < static_cast<std::ptrdiff_t>(n) && (i == 0 || at[i] > at[i - 1]);
        require(sound, "part_columns must be places in the state and the input, ascending");
    }
    return {data->data(), at, static_cast<std::ptrdiff_t>(size)};
}

// (rows,), (rows, cols), (N, rows) with per_stage, or (N, rows, cols).
HessianBlock block(const MaybeInput& array, std::size_t N, std::size_t rows, std::size_t cols, bool per_stage,
                   bool diagonal, const char* what) {
    if (!array) return {};
    require(!diagonal || rows == cols, what);
    bool fits = false;
    if (per_stage) {
        fits = diagonal ? has_shape(*array, {N, rows}) : has_shape(*array, {N, rows, cols});
    } else {
        fits = diagonal ? has_shape(*array, {rows}) : has_shape(*array, {rows, cols});
    }
    require(fits, what);
    const std::size_t stride = per_stage ? (diagonal ? rows : rows * cols) : 0;
    return {array->data(), static_cast<std::ptrdiff_t>(stride), diagonal};
}

// A weight: (n,), (n, n), or of every stage (N, n, 1), (N, n, n).
HessianBlock weight(const MaybeInput& array, std::size_t N, std::size_t n, const char* what) {
    if (!array) return {};
    const bool per_stage = array->ndim() == 3;
    const bool diagonal = array->ndim() == 1 || (per_stage && array->shape(2) == 1);
    require(has_shape(*array, {n}) || has_shape(*array, {n, n}) || has_shape(*array, {N, n, diagonal ? 1 : n}), what);
    return {array->data(), static_cast<std::ptrdiff_t>(per_stage ? (diagonal ? n : n * n) : 0), diagonal};
}

// The inputs and those states that have an entry in their column.
std::size_t used_columns(const Pattern& pattern, std::size_t nx) {
    const std::size_t n = pattern.shape(1);
    std::size_t count = n - nx;
    for (std::size_t j = 0; j < nx; ++j) {
        bool used = false;
        for (std::size_t i = 0; i < nx; ++i) used = used || pattern.data()[i * n + j];
        count += used ? 1 : 0;
    }
    return count;
}

struct Sizes {
    std::size_t N, nx, nu;
};

Sizes sizes(const Input& A, const Input& B) {
    require(A.ndim() == 3 && A.shape(1) == A.shape(2), "A must have shape (N, nx, nx)");
    require(B.ndim() == 3 && B.shape(0) == A.shape(0) && B.shape(1) == A.shape(1), "B must have shape (N, nx, nu)");
    return {A.shape(0), A.shape(1), B.shape(2)};
}

LinearQuadraticProblem dynamics(const Input& A, const Input& B) {
    const Sizes n = sizes(A, B);
    LinearQuadraticProblem problem;
    problem.horizon = static_cast<std::ptrdiff_t>(n.N);
    problem.nx = static_cast<std::ptrdiff_t>(n.nx);
    problem.nu = static_cast<std::ptrdiff_t>(n.nu);
    problem.A = A.data();
    problem.B = B.data();
    return problem;
}

void set_pattern(LinearQuadraticProblem& problem, const std::optional<Pattern>& pattern) {
    if (!pattern) return;
    const auto nx = static_cast<std::size_t>(problem.nx), nu = static_cast<std::size_t>(problem.nu);
    require(has_shape(*pattern, {nx, nx + nu}), "pattern must have shape (nx, nx + nu)");
    problem.pattern = pattern->data();
}

LinearQuadraticReport solve(const Input& A, const Input& B, const Output& K, const Output& C, const Output& b,
                            const Output& P0, const MaybeOutput& P_all, const MaybeOutput& L_all, const MaybeInput& Q,
                            const MaybeInput& R, const MaybeInput& S, const MaybeInput& H, double H_scale,
                            const MaybeInput& q, const MaybeInput& r, const MaybeInput& c, const MaybeInput& Q_final,
                            const MaybeInput& q_final, const MaybeInput& part, const MaybePlaces& part_columns,
                            bool regularize, bool use_structure, const std::optional<Pattern>& pattern) {
    const auto [N, nx, nu] = sizes(A, B);
    LinearQuadraticProblem problem = dynamics(A, B);
    problem.Q = weight(Q, N, nx, "Q must have shape (nx) or (nx, nx), or N of them");
    problem.R = weight(R, N, nu, "R must have shape (nu) or (nu, nu), or N of them");
    problem.S = block(S, N, nx, nu, S && S->ndim() == 3, false, "S must have shape (nx, nu), or N of them");
    if (H && H->ndim() == 2) {
        require(pattern && use_structure, "a packed H needs the pattern of [A B]");
        require(has_shape(*pattern, {nx, nx + nu}), "pattern must have shape (nx, nx + nu)");
        const std::size_t m = used_columns(*pattern, nx);
        problem.packed = true;
        problem.H = checked(H, {N, m * (m + 1) / 2}, "a packed H must have lower triangles of what is used, by rows");
    } else {
        problem.H = checked(H, {N, nx + nu, nx + nu}, "H must have shape (N, nx + nu, nx + nu)");
    }
    problem.H_scale = H_scale;
    problem.part = part_of(part, part_columns, N, nx + nu);
    problem.q = checked(q, {N, nx}, "q must have shape (N, nx)");
    problem.r = checked(r, {N, nu}, "r must have shape (N, nu)");
    problem.c = checked(c, {N, nx}, "c must have shape (N, nx)");
    problem.Q_final =
        block(Q_final, N, nx, nx, false, Q_final && Q_final->ndim() == 1, "Q_final must have shape (nx) or (nx, nx)");
    problem.q_final = checked(q_final, {nx}, "q_final must have shape (nx)");
    set_pattern(problem, pattern);

    require(has_shape(K, {N, nu, nx}), "K must have shape (N, nu, nx)");
    require(has_shape(C, {N, nu}), "C must have shape (N, nu)");
    require(has_shape(b, {N + 1, nx}), "b must have shape (N + 1, nx)");
    require(has_shape(P0, {nx, nx}), "P0 must have shape (nx, nx)");
    require(!P_all || has_shape(*P_all, {N + 1, nx, nx}), "P_all must have shape (N + 1, nx, nx)");
    require(!L_all || has_shape(*L_all, {N, nu, nu}), "L_all must have shape (N, nu, nu)");
    const LinearQuadraticOutput output{
        K.data(), C.data(), b.data(), P0.data(), P_all ? P_all->data() : nullptr, L_all ? L_all->data() : nullptr};
    const LinearQuadraticOptions options{regularize, use_structure};

    nb::gil_scoped_release release;
    return solve_linear_quadratic(problem, options, output);
}

void forward(const Input& A, const Input& B, const Input& K, const Input& C, const MaybeInput& c, const Output& dx,
             const Output& du, const std::optional<Pattern>& pattern) {
    const auto [N, nx, nu] = sizes(A, B);
    LinearQuadraticProblem problem = dynamics(A, B);
    set_pattern(problem, pattern);
    problem.c = checked(c, {N, nx}, "c must have shape (N, nx)");
    require(has_shape(K, {N, nu, nx}), "K must have shape (N, nu, nx)");
    require(has_shape(C, {N, nu}), "C must have shape (N, nu)");
    require(has_shape(dx, {N + 1, nx}), "dx must have shape (N + 1, nx)");
    require(has_shape(du, {N, nu}), "du must have shape (N, nu)");
    nb::gil_scoped_release release;
    sweep_forward(problem, K.data(), C.data(), dx.data(), du.data());
}

void drift(const Input& A, const Input& B, const Input& K, const Input& P, const Input& L, const Input& c,
           const Output& C, const std::optional<Pattern>& pattern) {
    const auto [N, nx, nu] = sizes(A, B);
    LinearQuadraticProblem problem = dynamics(A, B);
    set_pattern(problem, pattern);
    problem.c = checked(c, {N, nx}, "c must have shape (N, nx)");
    require(has_shape(K, {N, nu, nx}), "K must have shape (N, nu, nx)");
    require(has_shape(P, {N + 1, nx, nx}), "P must have shape (N + 1, nx, nx)");
    require(has_shape(L, {N, nu, nu}), "L must have shape (N, nu, nu)");
    require(has_shape(C, {N, nu}), "C must have shape (N, nu)");
    nb::gil_scoped_release release;
    sweep_drift(problem, K.data(), P.data(), L.data(), C.data());
}

void adjoint(const Input& A, const Input& B, const Input& K, const Input& q, const Input& r, const Input& q_final,
             const Output& z, const std::optional<Pattern>& pattern, const std::optional<Output>& h) {
    const auto [N, nx, nu] = sizes(A, B);
    LinearQuadraticProblem problem = dynamics(A, B);
    problem.q = checked(q, {N, nx}, "q must have shape (N, nx)");
    problem.r = checked(r, {N, nu}, "r must have shape (N, nu)");
    problem.q_final = checked(q_final, {nx}, "q_final must have shape (nx)");
    require(has_shape(K, {N, nu, nx}), "K must have shape (N, nu, nx)");
    require(has_shape(z, {N + 1, nx}), "z must have shape (N + 1, nx)");
    if (h) require(has_shape(*h, {N, nu}), "h must have shape (N, nu)");
    set_pattern(problem, pattern);
    nb::gil_scoped_release release;
    sweep_adjoint(problem, K.data(), z.data(), h ? h->data() : nullptr);
}

using Indices = nb::ndarray<const std::int64_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

void make_program(InteriorProgram* self, std::size_t N, std::size_t nx, std::size_t nu, const Indices& stage,
                  const Indices& begin, const Indices& column) {
    const auto list = [](const Indices& of) { return std::vector<std::ptrdiff_t>(of.data(), of.data() + of.shape(0)); };
    const std::size_t m = stage.shape(0), entries = column.shape(0);
    require(begin.shape(0) == m + 1 && begin.data()[0] == 0, "begin must have one entry more than there are rows");
    require(begin.data()[m] == static_cast<std::int64_t>(entries), "begin must end with the number of entries");
    for (std::size_t i = 0; i < m; ++i) {
        const std::int64_t k = stage.data()[i], n = k == static_cast<std::int64_t>(N) ? nx : 2 * nx + nu;
        require(k >= 0 && k <= static_cast<std::int64_t>(N), "stage: no such instant");
        require(begin.data()[i] <= begin.data()[i + 1], "begin must ascend");
        for (std::int64_t at = begin.data()[i]; at < begin.data()[i + 1]; ++at)
            require(column.data()[at] >= 0 && column.data()[at] < n, "column: no such entry");
    }
    new (self) InteriorProgram(N, nx, nu, list(stage), list(begin), list(column));
}

InteriorProgram::Report solve_program(InteriorProgram& self, const Input& A, const Input& B, const Input& values,
                                      double tolerance, double magnitude, int most, const MaybeInput& Q,
                                      const MaybeInput& R, const MaybeInput& S, const Input& q, const Input& r,
                                      const MaybeInput& Q_final, const Input& q_final, const MaybeInput& part,
                                      const MaybePlaces& part_columns, const std::optional<Pattern>& pattern) {
    const auto [N, nx, nu] = sizes(A, B);
    require(self.K.size() == N * nx * nu && self.dx.size() == (N + 1) * nx, "A and B must be of the program's sizes");
    LinearQuadraticProblem problem = dynamics(A, B);
    problem.Q = weight(Q, N, nx, "Q must have shape (nx) or (nx, nx), or N of them");
    problem.R = weight(R, N, nu, "R must have shape (nu) or (nu, nu), or N of them");
    problem.S = block(S, N, nx, nu, S && S->ndim() == 3, false, "S must have shape (nx, nu), or N of them");
    problem.part = part_of(part, part_columns, N, nx + nu);
    problem.q = checked(q, {N, nx}, "q must have shape (N, nx)");
    problem.r = checked(r, {N, nu}, "r must have shape (N, nu)");
    problem.Q_final =
        block(Q_final, N, nx, nx, false, Q_final && Q_final->ndim() == 1, "Q_final must have shape (nx) or (nx, nx)");
    problem.q_final = checked(q_final, {nx}, "q_final must have shape (nx)");
    set_pattern(problem, pattern);
    require(has_shape(values, {static_cast<std::size_t>(self.rows())}), "values must have one entry for each row");
    std::copy_n(values.data(), values.size(), self.values.begin());
    nb::gil_scoped_release release;
    return self.solve(problem, tolerance, magnitude, most);
}

// Memory of a program's, as an array that may be written to.
template <class Shape>
void program_field(nb::class_<InteriorProgram>& type, const char* name, std::vector<double> InteriorProgram::* field,
                   const Shape& shape, const char* meaning) {
    using View = nb::ndarray<nb::numpy, double, nb::c_contig>;
    type.def_prop_ro(
        name,
        [field, shape](nb::handle_t<InteriorProgram> self) {
            auto& of = nb::cast<InteriorProgram&>(self);
            const std::vector<std::size_t> sizes = shape(of);
            return View((of.*field).data(), sizes.size(), sizes.data(), self);
        },
        nb::rv_policy::automatic, meaning);
}

void bind_interior_program(nb::module_& m) {
    using P = InteriorProgram;
    using Sizes = std::vector<std::size_t>;
    nb::class_<P::Report>(m, "InteriorReport")
        .def_ro("solved", &P::Report::solved)
        .def_ro("iterations", &P::Report::iterations)
        .def_ro("converged", &P::Report::converged)
        .def_ro("excess", &P::Report::excess);
    nb::class_<P> program(m, "InteriorProgram",
                          "A quadratic problem along a motion with limits c + C (dx, du) >= 0, and its memory.");
    program
        .def("__init__", &make_program, "horizon"_a, "nx"_a, "nu"_a, "stage"_a, "begin"_a, "column"_a,
             "stage (m): of each row; begin (m + 1): of its entries in `column`, which are of [dx; du; dx of the next "
             "stage], and in `coefficients`.")
        .def("solve", &solve_program, "A"_a, "B"_a, "values"_a, "tolerance"_a, "magnitude"_a, "most"_a, nb::kw_only(),
             "Q"_a.none(), "R"_a.none(), "S"_a.none(), "q"_a, "r"_a, "Q_final"_a.none(), "q_final"_a, "part"_a.none(),
             "part_columns"_a.none(), "pattern"_a.none(), "Solves it for values c (m), in at most so many iterations.")
        .def_rw("kept", &P::kept, "Whether slacks and multipliers are of an instant before.");
    const auto entries = [](const P& of) { return Sizes{of.coefficients.size()}; };
    const auto rows = [](const P& of) { return Sizes{of.scales.size()}; };
    program_field(program, "coefficients", &P::coefficients, entries, "C, by its entries.");
    program_field(program, "scales", &P::scales, rows, "Of the rows.");
    program_field(program, "rho", &P::rho, rows, "Prices of an excess.");
    program_field(program, "s", &P::s, rows, "Slacks.");
    program_field(program, "e", &P::e, rows, "Excesses.");
    program_field(program, "y", &P::y, rows, "Multipliers.");
    const auto horizon = [](const P& of) { return static_cast<std::size_t>(of.horizon()); };
    program_field(
        program, "dx", &P::dx, [=](const P& of) { return Sizes{horizon(of) + 1, of.dx.size() / (horizon(of) + 1)}; },
        "Changes of the states (N+1, nx).");
    program_field(
        program, "du", &P::du, [=](const P& of) { return Sizes{horizon(of), of.du.size() / horizon(of)}; },
        "Changes of the inputs (N, nu).");
    program_field(
        program, "K", &P::K,
        [=](const P& of) { return Sizes{horizon(of), of.du.size() / horizon(of), of.dx.size() / (horizon(of) + 1)}; },
        "Gains of the last recursion (N, nu, nx).");
}

}  // namespace

void bind_linear_quadratic(nb::module_& m) {
    using Report = LinearQuadraticReport;
    nb::enum_<Report::Status>(m, "LinearQuadraticStatus")
        .value("solved", Report::Status::solved)
        .value("indefinite", Report::Status::indefinite)
        .value("not_finite", Report::Status::not_finite);
    nb::class_<Report>(m, "LinearQuadraticReport")
        .def_ro("status", &Report::status)
        .def_ro("stage", &Report::stage)
        .def_ro("smallest_eigenvalue", &Report::smallest_eigenvalue)
        .def_ro("regularized_stages", &Report::regularized_stages)
        .def_ro("largest_change", &Report::largest_change)
        .def_ro("constant", &Report::constant)
        .def_ro("structured_stages", &Report::structured_stages);

    m.def("solve_linear_quadratic", &solve, "A"_a, "B"_a, "K"_a, "C"_a, "b"_a, "P0"_a, "P_all"_a.none(),
          "L_all"_a.none(), nb::kw_only(), "Q"_a.none() = nb::none(), "R"_a.none() = nb::none(),
          "S"_a.none() = nb::none(), "H"_a.none() = nb::none(), "H_scale"_a = 1.0, "q"_a.none() = nb::none(),
          "r"_a.none() = nb::none(), "c"_a.none() = nb::none(), "Q_final"_a.none() = nb::none(),
          "q_final"_a.none() = nb::none(), "part"_a.none() = nb::none(), "part_columns"_a.none() = nb::none(),
          "regularize"_a = false, "use_structure"_a = true, "pattern"_a.none() = nb::none(),
          "Backward recursion of the affine LQ problem; writes K, C, b, P0 and, if given, P_all and L_all.");
    m.def("sweep_forward", &forward, "A"_a, "B"_a, "K"_a, "C"_a, "c"_a.none(), "dx"_a, "du"_a,
          "pattern"_a.none() = nb::none(), "Closed-loop linear roll-out from dx[0]; writes dx[1:] and du.");
    m.def("sweep_drift", &drift, "A"_a, "B"_a, "K"_a, "P"_a, "L"_a, "c"_a, "C"_a, "pattern"_a.none() = nb::none(),
          "What a drift adds to the feedforward of a problem that was solved; writes C.");
    m.def("sweep_adjoint", &adjoint, "A"_a, "B"_a, "K"_a, "q"_a, "r"_a, "q_final"_a, "z"_a,
          "pattern"_a.none() = nb::none(), "h"_a.none() = nb::none(),
          "Adjoint of the closed-loop linearisation; writes z and, if given, h = r + B'z, the derivative by inputs.");
    bind_interior_program(m);
}

}  // namespace leastaction
