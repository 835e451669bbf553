// The midpoint integrator over whole trajectories; one step is a trajectory of one step.

#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <array>
#include <chrono>
#include <optional>

#include "bindings/arrays.hpp"
#include "discrete/energy.hpp"
#include "discrete/layout.hpp"
#include "discrete/linearization.hpp"
#include "discrete/many.hpp"
#include "discrete/trajectory.hpp"

using namespace nanobind::literals;

namespace leastaction {

namespace {

// A roll-out, its arrays filled up to the step that failed.
struct RollOutResult {
    Out x, u, lam, energies;
    RollOut report;
    Out residual;  // of the step that failed: dynamics in the user's order, then constraints
};

struct ParameterDerivatives {
    Out x, lam;
    int steps;
};

std::size_t steps_of(const In<1>& t) {
    if (t.size() < 1) throw std::invalid_argument("t: at least one time is needed");
    return t.size() - 1;
}

std::size_t check(const Mechanism& m, const In<1>& t, const In<2>& x, const In<2>& u) {
    const std::size_t N = steps_of(t);
    expect(x.size(), (N + 1) * m.n_states(), "x");
    expect(u.size(), N * m.n_controls(), "u");
    return N;
}

// Ctrl-C: looked for by time, and what Python elements raised for it.
class Keyboard : public Interruption {
public:
    bool poll() override {
        const auto now = std::chrono::steady_clock::now();
        if (now - last_ < std::chrono::milliseconds(20)) return false;
        last_ = now;
        nb::gil_scoped_acquire acquire;
        if (PyErr_CheckSignals() == 0) return false;
        if (!PyErr_ExceptionMatches(PyExc_KeyboardInterrupt)) nb::raise_python_error();
        PyErr_Clear();
        return true;
    }
    bool caught() override {
        try {
            throw;
        } catch (nb::python_error& error) {
            nb::gil_scoped_acquire acquire;
            return error.matches(PyExc_KeyboardInterrupt);
        } catch (...) {
            return false;
        }
    }

private:
    std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

RollOutResult roll_out_from(const Midpoint& midpoint, const In<1>& t, const In<1>& x0, const std::optional<In<2>>& xbar,
                            const In<2>& ubar, const std::optional<In<3>>& K, double first_share, bool with_energies,
                            bool interruptible) {
    const Mechanism& m = midpoint.mechanism();
    const std::size_t N = steps_of(t), nx = m.n_states(), nu = m.n_controls(), nc = m.n_constraints();
    expect(x0.size(), nx, "x0");
    expect(ubar.size(), N * nu, "ubar");
    if (xbar) {
        expect(xbar->shape(0), N + 1, "xbar");
        expect(xbar->shape(1), nx, "state in xbar");
    }
    if (K) {
        if (!xbar) throw std::invalid_argument("feedback gains need a nominal trajectory xbar");
        expect(K->size(), N * nu * m.n_tangent(), "K");
    }
    Out X = new_array({N + 1, nx}), U = new_array({N, nu}), lam = new_array({N, nc});
    Out energies = new_array({with_energies ? N : 0, EnergyRows::width});
    std::copy_n(x0.data(), nx, X.data());
    auto workspace = midpoint.workspace();
    MidpointStep& step = workspace->step;
    RollOut result;
    Keyboard keyboard;
    {
        nb::gil_scoped_release release;
        result = roll_out(step, static_cast<int>(N), t.data(), xbar ? xbar->data() : nullptr, ubar.data(),
                          K ? K->data() : nullptr, first_share, X.data(), U.data(), lam.data(),
                          with_energies ? energies.data() : nullptr, interruptible ? &keyboard : nullptr);
    }
    std::vector<double> residual(m.n_dynamic + nc, 0.0);
    if (result.failure.status != StepStatus::converged) {
        for (int i = 0; i < m.n_dynamic; ++i) residual[m.external[i]] = step.residual[i];
        std::copy(step.residual.begin() + m.n_dynamic, step.residual.end(), residual.begin() + m.n_dynamic);
        workspace.discard();
    }
    if (result.interrupted) workspace.discard();
    return {X, U, lam, energies, result, copy_of(residual, {residual.size()})};
}

struct ManyRollOuts {
    Out x, lam;
    std::vector<OneOfMany> each;
};

ManyRollOuts roll_out_many_from(const Midpoint& midpoint, const In<1>& t, const In<2>& x0, const In<3>& u,
                                int threads) {
    const Mechanism& m = midpoint.mechanism();
    const std::size_t B = x0.shape(0), N = steps_of(t), nx = m.n_states(), nc = m.n_constraints();
    expect(x0.shape(1), nx, "x0");
    expect(u.shape(0), B, "u");
    expect(u.size(), B * N * m.n_controls(), "u");
    ManyRollOuts out{new_array({B, N + 1, nx}), new_array({B, N, nc}), {}};
    nb::gil_scoped_release release;
    std::fill_n(out.x.data(), out.x.size(), NAN);
    std::fill_n(out.lam.data(), out.lam.size(), NAN);
    for (std::size_t b = 0; b < B; ++b) std::copy_n(x0.data() + b * nx, nx, out.x.data() + b * (N + 1) * nx);
    out.each = roll_out_many(midpoint, static_cast<int>(B), static_cast<int>(N), t.data(), u.data(), threads,
                             out.x.data(), out.lam.data());
    return out;
}

nb::tuple linearize_many_of(const Midpoint& midpoint, const In<1>& t, const In<3>& x, const In<3>& u, int threads) {
    const Mechanism& m = midpoint.mechanism();
    const std::size_t B = x.shape(0), N = steps_of(t), n = m.n_tangent(), nu = m.n_controls();
    expect(x.size(), B * (N + 1) * m.n_states(), "x");
    expect(u.shape(0), B, "u");
    expect(u.size(), B * N * nu, "u");
    Out by_x = new_array({B, N, n, n}), by_u = new_array({B, N, n, nu});
    std::ptrdiff_t done = 0;
    {
        nb::gil_scoped_release release;
        done = linearize_many(midpoint, static_cast<int>(B), static_cast<int>(N), t.data(), x.data(), u.data(), threads,
                              by_x.data(), by_u.data());
    }
    return nb::make_tuple(by_x, by_u, done);
}

RollOutResult step_each_of(const Midpoint& midpoint, const In<1>& t, const In<2>& x, const In<2>& u, int threads,
                           double first_share) {
    const Mechanism& m = midpoint.mechanism();
    const std::size_t N = check(m, t, x, u), nx = m.n_states(), nu = m.n_controls(), nc = m.n_constraints();
    Out ends = new_array({N, nx}), U = new_array({N, nu}), lam = new_array({N, nc});
    std::copy_n(u.data(), N * nu, U.data());
    RollOut result;
    {
        nb::gil_scoped_release release;
        result = step_each(midpoint, static_cast<int>(N), t.data(), x.data(), u.data(), first_share, threads,
                           ends.data(), lam.data());
    }
    return {ends, U, lam, new_array({0, EnergyRows::width}), result, new_array({0})};
}

nb::tuple balance(const In<2>& rows) {
    expect(rows.shape(1), EnergyRows::width, "columns");
    const EnergyBalance found = balance_of(rows.data(), rows.shape(0));
    return nb::make_tuple(copy_of(found.residual, {found.residual.size()}), found.swing, found.kinetic, found.work,
                          found.size);
}

Out energies_of(const Midpoint& midpoint, const In<1>& t, const In<2>& x, const In<2>& u, const In<2>& lam,
                double first_share) {
    const Mechanism& m = midpoint.mechanism();
    const std::size_t N = check(m, t, x, u);
    expect(lam.size(), N * m.n_constraints(), "lam");
    Out rows = new_array({N, EnergyRows::width});
    nb::gil_scoped_release release;
    energies_along(midpoint, static_cast<int>(N), t.data(), x.data(), u.data(), lam.data(), first_share, rows.data());
    return rows;
}

int linearize(Linearization& out, const In<1>& t, const In<2>& x, const In<2>& u, int threads,
              const std::optional<In<2>>& ends, double first_share, const std::optional<Out>& by_time_step) {
    const std::size_t N = check(out.integrator()->mechanism(), t, x, u);
    expect(N, out.steps, "steps of the trajectory");
    if (ends) expect(ends->size(), N * out.nx, "ends");
    if (by_time_step) expect(by_time_step->size(), N * out.ny, "by_time_step");
    nb::gil_scoped_release release;
    return out.along(t.data(), x.data(), u.data(), first_share, threads, ends ? ends->data() : nullptr,
                     by_time_step ? by_time_step->data() : nullptr);
}

// A read-only array in memory of the core's.
using View = nb::ndarray<nb::numpy, const double, nb::c_contig>;

// The Hessians that make(weights) returns, as an array of this shape.
template <class Make>
View hessians(const Linearization& of, const In<2>& w, std::initializer_list<std::size_t> shape, const Make& make) {
    const std::size_t weights = w.shape(1);
    expect(w.shape(0), of.steps, "w");
    if (weights != static_cast<std::size_t>(of.ndx)) expect(weights, of.ndx + of.nc, "weights");
    using Memory = std::shared_ptr<const LargeArray>;
    std::unique_ptr<Memory> H;
    {
        nb::gil_scoped_release release;
        H = std::make_unique<Memory>(make(static_cast<int>(weights)));
    }
    const double* data = (*H)->data();
    nb::capsule owner(H.get(), [](void* p) noexcept { delete static_cast<Memory*>(p); });
    H.release();
    return View(data, shape, owner);
}

View curvature(const Linearization& of, const In<2>& w, bool multipliers, int threads) {
    const std::size_t N = of.steps, n = of.ndx + of.nu + (multipliers ? of.nc : 0);
    return hessians(of, w, {N, n, n},
                    [&](int weights) { return of.curvature(w.data(), weights, multipliers, threads); });
}

View packed_curvature(const Linearization& of, const In<2>& w, int threads) {
    const std::size_t N = of.steps;
    return hessians(of, w, {N, of.packed_size()},
                    [&](int weights) { return of.packed_curvature(w.data(), weights, threads); });
}

// directions (P, n_numbers) of the elements' numbers; inertias: (parameter, joint, 10 numbers m, m c, I in
// the joint's frame about its origin, xx yy zz xy xz yz); the parameter that is the time step, or none.
ParameterDerivatives by_parameters(const Midpoint& midpoint, const In<1>& t, const In<2>& x, const In<2>& u,
                                   const In<2>& directions,
                                   const std::vector<std::tuple<int, int, std::array<double, 10>>>& inertias,
                                   std::optional<int> time_step, std::optional<int> time, int threads,
                                   double first_share) {
    const Mechanism& m = midpoint.mechanism();
    const std::size_t N = check(m, t, x, u), P = directions.shape(0), n = m.numbers.size();
    const std::size_t nx = m.n_tangent(), nc = m.n_constraints();
    expect(directions.shape(1), n, "direction");
    std::vector<Parameter> parameters(P);
    for (std::size_t k = 0; k < P; ++k) {
        const double* row = directions.data() + k * n;
        if (std::any_of(row, row + n, [](double d) { return d != 0.0; })) parameters[k].numbers.assign(row, row + n);
    }
    for (const auto& [k, joint, i] : inertias) {
        if (k < 0 || k >= static_cast<int>(P) || joint < 0 || joint >= m.n_massive)
            throw std::invalid_argument("inertias: no such parameter, or no such joint with a mass");
        parameters[k].inertias.push_back({joint, inertia_of(i)});
    }
    if (time_step) parameters.at(*time_step).time_step = true;
    if (time) parameters.at(*time).time = 1;
    Out by_x = new_array({N, nx, P}), by_lam = new_array({N, nc, P});
    nb::gil_scoped_release release;
    const int done = differentiate_by_parameters(midpoint, static_cast<int>(N), t.data(), x.data(), u.data(),
                                                 parameters, first_share, threads, by_x.data(), by_lam.data());
    return {by_x, by_lam, done};
}

Out curvature_by_length(const Midpoint& midpoint, const In<1>& t, const In<2>& x, const In<2>& u, const In<2>& w,
                        bool multipliers, int threads, double first_share) {
    const Mechanism& m = midpoint.mechanism();
    const std::size_t N = check(m, t, x, u), nx = m.n_tangent(), weights = w.shape(1);
    expect(w.shape(0), N, "w");
    if (weights != nx) expect(weights, nx + m.n_constraints(), "weights");
    const std::size_t n = nx + m.n_controls() + (multipliers ? m.n_constraints() : 0) + 1;
    Out out = new_array({N, n, n});
    nb::gil_scoped_release release;
    const int done = curvature_by_time_step(midpoint, static_cast<int>(N), t.data(), x.data(), u.data(), w.data(),
                                            static_cast<int>(weights), multipliers, first_share, threads, out.data());
    if (done < static_cast<int>(N)) throw std::invalid_argument("x: this is no trajectory");
    return out;
}

Out curvature_by_directions(const Midpoint& midpoint, const In<1>& t, const In<2>& x, const In<2>& u, const In<2>& w,
                            const In<2>& directions, int threads, double first_share) {
    const Mechanism& m = midpoint.mechanism();
    const std::size_t N = check(m, t, x, u), nx = m.n_tangent(), weights = w.shape(1), P = directions.shape(0);
    expect(w.shape(0), N, "w");
    if (weights != nx) expect(weights, nx + m.n_constraints(), "weights");
    expect(directions.shape(1), m.numbers.size(), "direction");
    std::vector<Parameter> parameters(P);
    for (std::size_t k = 0; k < P; ++k) {
        const double* row = directions.data() + k * m.numbers.size();
        parameters[k].numbers.assign(row, row + m.numbers.size());
    }
    Out out = new_array({N, P, nx + m.n_controls() + P});
    nb::gil_scoped_release release;
    const int done = curvature_by_numbers(midpoint, static_cast<int>(N), t.data(), x.data(), u.data(), w.data(),
                                          static_cast<int>(weights), parameters, first_share, threads, out.data());
    if (done < static_cast<int>(N)) throw std::invalid_argument("x: this is no trajectory");
    return out;
}

nb::tuple momenta(const Midpoint& midpoint, const In<1>& q1, const In<1>& q2, const In<1>& u, double dt,
                  std::optional<double> share, double t) {
    const Mechanism& m = midpoint.mechanism();
    expect(u.size(), m.n_inputs, "u");
    auto workspace = midpoint.workspace();
    MidpointStep& step = workspace->step;
    step.t = t;
    step.q1 = configuration_of(m, q1, "q1");
    step.q2 = configuration_of(m, q2, "q2");
    for (const Ball& ball : m.balls)
        rotation_between(&step.q1[ball.quaternion], &step.q2[ball.quaternion], &step.q2[ball.variable]);
    step.u.assign(u.data(), u.data() + m.n_inputs);
    const std::size_t nq = m.n_variables();
    std::vector<double> start(nq), end(nq);
    step.momenta(dt, share.value_or(dt), start, end);
    Out p1 = new_array({nq}), p2 = new_array({nq});
    for (std::size_t i = 0; i < nq; ++i) {
        p1.data()[m.external[i]] = start[i];
        p2.data()[m.external[i]] = end[i];
    }
    return nb::make_tuple(p1, p2);
}

nb::list saved(nb::handle_t<Linearization> self) {
    nb::list out;
    for (const LargeArray* array : nb::cast<Linearization&>(self).memory()) {
        const std::size_t size = array->size();
        out.append(View(array->data(), 1, &size, self));
    }
    return out;
}

void restore(Linearization& to, const std::vector<In<1>>& arrays) {
    const auto memory = to.memory();
    expect(arrays.size(), memory.size(), "arrays");
    for (std::size_t i = 0; i < memory.size(); ++i) expect(arrays[i].size(), memory[i]->size(), "array");
    for (std::size_t i = 0; i < memory.size(); ++i) std::copy_n(arrays[i].data(), arrays[i].size(), memory[i]->data());
}

// A field of a linearisation, which lives as long as its views.
template <class Shape>
void view(nb::class_<Linearization>& type, const char* name, LargeArray Linearization::* array, const Shape& shape,
          const char* meaning) {
    type.def_prop_ro(
        name,
        [array, shape](nb::handle_t<Linearization> self) {
            const auto& of = nb::cast<const Linearization&>(self);
            const std::vector<std::size_t> sizes = shape(of);
            return View((of.*array).data(), sizes.size(), sizes.data(), self);
        },
        nb::rv_policy::automatic, meaning);
}

Out difference(const Mechanism& m, const In<2>& x, const In<2>& xbar) {
    const Layout at(m);
    const std::size_t N = x.shape(0), nx = at.nx, ndx = at.ndx;
    for (const In<2>* given : {&x, &xbar}) expect(given->size(), N * nx, "x and xbar");
    Out out = new_array({N, ndx});
    for (std::size_t k = 0; k < N; ++k) at.difference(x.data() + k * nx, xbar.data() + k * nx, out.data() + k * ndx);
    return out;
}

Out plus(const Mechanism& m, const In<2>& x, const In<2>& dx) {
    const Layout at(m);
    const std::size_t N = x.shape(0), nx = at.nx, ndx = at.ndx;
    expect(x.size(), N * nx, "x");
    expect(dx.size(), N * ndx, "dx");
    Out out = new_array({N, nx});
    for (std::size_t k = 0; k < N; ++k) at.plus(x.data() + k * nx, dx.data() + k * ndx, out.data() + k * nx);
    return out;
}

}  // namespace

void bind_step(nb::class_<Midpoint>& midpoint);

void bind_midpoint(nb::module_& module) {
    nb::enum_<Split>(module, "Split", "How a force acts on a step.")
        .value("symmetric", Split::symmetric)
        .value("left", Split::left);
    nb::enum_<Solver>(module, "Solver", "What eliminates the Newton matrix of a step.")
        .value("automatic", Solver::automatic)
        .value("dense", Solver::dense)
        .value("tree", Solver::tree)
        .value("loops", Solver::loops);
    nb::enum_<StepStatus>(module, "StepStatus", "How the solution of a step ended.")
        .value("converged", StepStatus::converged)
        .value("no_convergence", StepStatus::no_convergence)
        .value("not_finite", StepStatus::not_finite)
        .value("singular", StepStatus::singular)
        .value("too_coarse", StepStatus::too_coarse);
    using W = WorstStep;
    nb::class_<W>(module, "WorstStep", "The coarsest step of a roll-out.")
        .def_ro("k", &W::k, "Its number; -1: there was no step.")
        .def_ro("s", &W::s, "Determinant of its Newton matrix for dt -> 0 over that at its end.")
        .def_ro("angle", &W::angle, "Largest angle that it moved (rad).")
        .def_ro("variable", &W::variable, "Whose; -1: nothing turned.");
    using R = RollOutResult;
    nb::class_<R> rolled(module, "RollOut", "Steps one after the other, up to the first that failed.");
    array_field(rolled, "x", &R::x, "States (N+1, nx).");
    array_field(rolled, "u", &R::u, "Inputs that were applied (N, nu).");
    array_field(rolled, "lam", &R::lam, "Multipliers (N, nc).");
    array_field(rolled, "energies", &R::energies,
                "Kinetic and potential energy at the middle of each step, the work since that of the step before, and "
                "sizes of the terms of the latter and of the former (N, 5); none where they were not asked for.");
    array_field(rolled, "residual", &R::residual,
                "Of the step that failed (nd + nc): dynamics in the user's order, then constraints.");
    const auto report = [&](const char* name, auto field, const char* meaning) {
        rolled.def_prop_ro(name, [field](const R& r) { return r.report.*field; }, meaning);
    };
    report("steps", &RollOut::steps, "How many steps succeeded.");
    report("iterations", &RollOut::iterations, "Newton iterations of all steps.");
    report("factorizations", &RollOut::factorizations, "Newton matrices of all steps.");
    report("rank_deficient", &RollOut::rank_deficient, "Whether constraints were redundant somewhere.");
    report("worst", &RollOut::worst, "The coarsest step, which may be the one that failed.");
    report("interrupted", &RollOut::interrupted, "Whether Ctrl-C stopped it, where it was to keep what it had made.");
    report("followed", &RollOut::followed, "Steps whose solution was followed from dt -> 0.");
    rolled.def_prop_ro(
        "reached", [](const R& r) { return r.report.failure.reached; },
        "Of a step that is too coarse: the longest that could be followed (s).");
    rolled.def_prop_ro("status", [](const R& r) { return r.report.failure.status; }, "Of the last step.");
    rolled.def_prop_ro(
        "failed_iterations", [](const R& r) { return r.report.failure.iterations; },
        "Newton iterations of the step that failed.");
    using Many = ManyRollOuts;
    nb::class_<Many> many(module, "ManyRollOuts", "Roll-outs of one mechanism, each up to its first step that failed.");
    array_field(many, "x", &Many::x, "States (B, N+1, nx); not numbers behind a step that failed.");
    array_field(many, "lam", &Many::lam, "Multipliers (B, N, nc).");
    const auto of_each = [&](const char* name, auto field, const char* meaning) {
        many.def_prop_ro(
            name,
            [field](const Many& r) {
                std::vector<std::remove_cvref_t<decltype(OneOfMany{}.*field)>> out;
                for (const OneOfMany& one : r.each) out.push_back(one.*field);
                return out;
            },
            meaning);
    };
    of_each("steps", &OneOfMany::steps, "How many steps each made.");
    of_each("alone", &OneOfMany::alone, "How many of them not side by side with others.");
    of_each("status", &OneOfMany::status, "Of the last step of each.");
    using P = ParameterDerivatives;
    nb::class_<P> slopes(module, "ParameterDerivatives", "Derivatives of every step by parameters.");
    array_field(slopes, "x", &P::x, "Of the next states (N, nx, P).");
    array_field(slopes, "lam", &P::lam, "Of the multipliers (N, nc, P).");
    slopes.def_ro("steps", &P::steps, "The first step that is none, or N.");
    module.def("difference", &difference, "mechanism"_a, "x"_a, "xbar"_a,
               "Differences (N, ndx) of states (N, nx): of rotations the rotation vectors from those of xbar.");
    module.def("plus", &plus, "mechanism"_a, "x"_a, "dx"_a, "States (N, nx) that are dx (N, ndx) from x: its inverse.");
    module.def(
        "balance", &balance, "energies"_a,
        "Of `energies` of steps: energy less that of the first and less the work since (N), how much that swings, "
        "the largest kinetic energy, how much the work changes, and the size of all terms.");
    nb::class_<Midpoint> midpoint(module, "Midpoint",
                                  "Midpoint variational integrator of one mechanism, for any number of threads: "
                                  "settings, and memory to work in.");
    bind_step(midpoint);
    midpoint
        .def(
            "__init__",
            [](Midpoint* self, std::shared_ptr<Mechanism> mechanism, Split split, double tolerance, int max_iterations,
               Solver solver, const std::vector<int>& instants) {
                std::shared_ptr<const Mechanism> of = std::move(mechanism);
                new (self) Midpoint(instants.empty() ? of : at_instants(*of, instants),
                                    {split, tolerance, max_iterations, solver});
            },
            "mechanism"_a, "split"_a = Split::symmetric, "tolerance"_a = 1e-13, "max_iterations"_a = 50,
            "solver"_a = Solver::automatic, "at_instants"_a = std::vector<int>(),
            "at_instants: the inputs whose forces act at the instants. Where steps are asked for below, `first_share` "
            "is the part of the first one for which those forces act at its start.")
        .def("roll_out", &roll_out_from, "t"_a, "x0"_a, "xbar"_a.none(), "ubar"_a, "K"_a.none(), "first_share"_a = 1.0,
             "energies"_a = false, "interruptible"_a = false,
             "Steps from x0 over the times t under u = ubar - K (x - xbar).")
        .def(
            "roll_out_many", &roll_out_many_from, "t"_a, "x0"_a, "u"_a, "threads"_a = 0,
            "Steps from each of x0 (B, nx) over the times t under u (B, N, nu), each to the last bit what it is alone.")
        .def("linearize_many", &linearize_many_of, "t"_a, "x"_a, "u"_a, "threads"_a = 0,
             "(A, B) of the steps of motions x (B, N+1, nx) under u (B, N, nu), and the first step of all, counted "
             "through, at which there is none, or B N.")
        .def("step_each", &step_each_of, "t"_a, "x"_a, "u"_a, "threads"_a = 0, "first_share"_a = 1.0,
             "The steps of a curve, each from its own state: x (N, nx) of the result is where they lead to.")
        .def("energies", &energies_of, "t"_a, "x"_a, "u"_a, "lam"_a, "first_share"_a = 1.0,
             "Such `energies` as roll_out() has, of steps that are known.")
        .def("by_parameters", &by_parameters, "t"_a, "x"_a, "u"_a, "directions"_a, "inertias"_a,
             "time_step"_a.none() = nb::none(), "time"_a.none() = nb::none(), "threads"_a = 0, "first_share"_a = 1.0,
             "Derivatives of every step by directions of the elements' numbers and of inertias, by its length, and by "
             "the time at its start.")
        .def("curvature_by_time_step", &curvature_by_length, "t"_a, "x"_a, "u"_a, "w"_a, "multipliers"_a = false,
             "threads"_a = 0, "first_share"_a = 1.0,
             "Second derivatives (N, n, n), n = nx + nu + 1, of the next states weighted with w (N, nx), or of states "
             "and multipliers with w (N, nx + nc), by (states, u, the length of the step); with `multipliers` these "
             "stand after the states.")
        .def("curvature_by_numbers", &curvature_by_directions, "t"_a, "x"_a, "u"_a, "w"_a, "directions"_a,
             "threads"_a = 0, "first_share"_a = 1.0,
             "Such by directions (P, n_numbers) of the elements' numbers, none of gravity, and all: (N, P, nx + nu + "
             "P).")
        .def("momenta", &momenta, "q1"_a, "q2"_a, "u"_a, "dt"_a, "share"_a.none() = nb::none(), "t"_a = 0.0,
             "Momenta (p1, p2) of all variables at both ends of a segment, without constraint forces; share: for how "
             "long forces at the instants act at its start, dt by default.");
    module.attr("SAME_MOTION") = same_motion;
    using L = Linearization;
    using Sizes = std::vector<std::size_t>;
    const auto n = [](int size) { return static_cast<std::size_t>(size); };
    nb::class_<L> linearization(module, "Linearization",
                                "Derivatives of every step of a trajectory; owns its memory. With `multipliers` these "
                                "count as further states of the next instant: ny = nx + nc, else ny = nx.");
    linearization.def(nb::init<std::shared_ptr<Midpoint>, int, bool>(), "midpoint"_a, "steps"_a, "multipliers"_a)
        .def("along", &linearize, "t"_a, "x"_a, "u"_a, "threads"_a = 0, "ends"_a.none() = nb::none(),
             "first_share"_a = 1.0, "by_time_step"_a.none() = nb::none(),
             "Linearises along a trajectory, or a curve whose steps lead to `ends` (N, nx), over what was there, and "
             "writes derivatives by the length of every step to `by_time_step` (N, ny). "
             "Returns "
             "the first step at which it is none, or N.")
        .def("curvature", &curvature, "w"_a, "multipliers"_a = false, "threads"_a = 0,
             "Hessians by (states, u), of every step, of the next states weighted with w (N, nx), or of states and "
             "multipliers with w (N, nx + nc); with `multipliers` these have rows and columns of zeros.")
        .def("packed_curvature", &packed_curvature, "w"_a, "threads"_a = 0,
             "The same by those states and inputs that anything depends on: lower triangles (N, m (m + 1) / 2), by "
             "rows.");
    linearization.def("saved", &saved, "All that it holds, as flat arrays.")
        .def("restore", &restore, "arrays"_a, "Takes over what saved() gave.");
    view(
        linearization, "A", &L::A, [n](const L& of) { return Sizes{n(of.steps), n(of.ny), n(of.ny)}; },
        "Next states by states (N, ny, ny).");
    view(
        linearization, "B", &L::B, [n](const L& of) { return Sizes{n(of.steps), n(of.ny), n(of.nu)}; },
        "Next states by inputs (N, ny, nu).");
    view(
        linearization, "lam", &L::lam, [n](const L& of) { return Sizes{n(of.steps), n(of.nc)}; },
        "Multipliers (N, nc).");
    view(
        linearization, "defect", &L::defect, [n](const L& of) { return Sizes{n(of.steps)}; },
        "How far the dynamic configuration that each step leads to is from the given one (N).");
}

}  // namespace leastaction
