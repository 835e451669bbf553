// What is asked of single states, in one call each: Python's share of a step is longer than the step.
//
// What does not fit, such as a number that is not finite, makes these return nothing; Python then looks for what it was.

#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>
#include <optional>

#include "bindings/arrays.hpp"
#include "discrete/layout.hpp"
#include "discrete/trajectory.hpp"
#include "dynamics/lagrangian.hpp"
#include "mechanism/time_slopes.hpp"

using namespace nanobind::literals;

namespace leastaction {

namespace {

// A pivot of the mass matrix below this part of the inertia that it was is rounding.
constexpr double lost_inertia = 1e-14;

template <int n>
using Written = nb::ndarray<double, nb::ndim<n>, nb::c_contig, nb::device::cpu>;

bool all_finite(const double* values, std::size_t n) {
    return std::all_of(values, values + n, [](double x) { return std::isfinite(x); });
}

// Whether constraints are met, each to a part of max(1, |Dh|, |Dh|^2 / 4), and kept by a velocity, to a part of the size of
// the terms of its rate (at least 1).
bool is_consistent(const Mechanism& m, const std::vector<double>& q, const std::vector<double>& v, double t,
                   double tolerance, double rate_tolerance) {
    Placement<double> at(m);
    at.time = t;
    std::vector<double> by_time(m.n_constraints());
    if (m.time_slot >= 0) TimeSlopes(m).constraints(t, q.data(), [&](int c, double slope) { by_time[c] = slope; });
    place(m.constraint_joints, q.data(), at);
    LocalTaylor<double> local;
    std::vector<double> row(m.n_variables());
    for (std::size_t c = 0; c < by_time.size(); ++c) {
        const auto& constraint = m.constraints[c];
        std::fill(row.begin(), row.end(), 0.0);
        for_each_entry(*constraint, at, q.data(), local, [&](int i, double slope) { row[i] += slope; });
        double square = 0, rate = by_time[c], size = std::abs(rate);
        for (std::size_t i = 0; i < row.size(); ++i) {
            square += row[i] * row[i];
            rate += row[i] * v[i];
            size += std::abs(row[i] * v[i]);
        }
        const double scale = std::max({1.0, std::sqrt(square), square / 4});
        if (!(std::abs(local.value) <= tolerance * scale) || !std::isfinite(square)) return false;
        if (!(std::abs(rate) <= rate_tolerance * std::max(1.0, size))) return false;
    }
    return true;
}

// Writes the state [q; rho; p; v_rho] at a configuration and a velocity; false where it is not finite or not consistent.
bool start(const Mechanism& m, const In<1>& q, const std::optional<In<1>>& v, double t, double tolerance,
           double rate_tolerance, const Written<1>& x) {
    const Layout at(m);
    expect(x.size(), at.nx, "x");
    const std::vector<double> place = configuration_of(m, q, "q");
    const std::vector<double> speed = v ? to_internal(m, *v, "v") : std::vector<double>(at.nq);
    Lagrangian<double> lagrangian(m);
    lagrangian.gradient(place.data(), speed.data());
    std::copy_n(q.data(), at.nqx, x.data());
    for (int i = 0; i < at.nd; ++i) x.data()[at.nqx + m.external[i]] = lagrangian.L_v[i];
    for (int i = at.nd; i < at.nq; ++i) x.data()[at.nqx + m.external[i]] = speed[i];
    return all_finite(x.data(), at.nx) && is_consistent(m, place, speed, t, tolerance, rate_tolerance);
}

// Momenta p (N, nd) of configurations and velocities.
void momenta_along(const Mechanism& m, const In<2>& q, const In<2>& v, const Written<2>& p) {
    const std::size_t N = q.shape(0), nq = m.n_configuration(), nv = m.n_variables(), nd = m.n_dynamic;
    expect(q.size(), N * nq, "q");
    expect(v.size(), N * nv, "v");
    expect(p.size(), N * nd, "p");
    Lagrangian<double> lagrangian(m);
    std::vector<double> place;
    for (std::size_t k = 0; k < N; ++k) {
        write_configuration(m, q.data() + k * nq, place);
        lagrangian.gradient(place.data(), to_internal(m, v.data() + k * nv).data());
        for (std::size_t i = 0; i < nd; ++i) p.data()[k * nd + m.external[i]] = lagrangian.L_v[i];
    }
}

// Velocities v (N, nv) of momenta: v_d = M_dd^-1 (p - M_dk v_rho), then v_rho; false where M_dd is singular.
bool velocities_along(const Mechanism& m, const In<2>& q, const In<2>& p, const std::optional<In<2>>& v_rho,
                      const Written<2>& v) {
    const std::size_t N = q.shape(0), nq = m.n_configuration(), nv = m.n_variables();
    const std::size_t nd = m.n_dynamic, nk = m.n_kinematic;
    expect(q.size(), N * nq, "q");
    expect(p.size(), N * nd, "p");
    expect(v.size(), N * nv, "v");
    if (v_rho) expect(v_rho->size(), N * nk, "v_rho");
    Lagrangian<double> lagrangian(m);
    const std::vector<double> still(nv);
    std::vector<double> place, speed(nv);
    Eigen::MatrixXd mass(nv, nv);
    Eigen::VectorXd right(nd);
    Eigen::LLT<Eigen::MatrixXd> factor(static_cast<Eigen::Index>(nd));
    for (std::size_t k = 0; k < N; ++k) {
        write_configuration(m, q.data() + k * nq, place);
        lagrangian.gradient(place.data(), still.data());
        lagrangian.hessian();
        mass.setZero();
        const PairDerivatives& d = lagrangian.pairs;
        each_pair(m, d.stride, [&](int i, int j, std::size_t at, auto weight, bool mirrored) {
            mass(i, j) += weight * d.vv[at];
            if (mirrored) mass(j, i) += weight * d.vv[at];
        });
        for (std::size_t i = 0; i < nk; ++i)
            speed[nd + i] = v_rho ? v_rho->data()[k * nk + m.external[nd + i] - nd] : 0;
        for (std::size_t i = 0; i < nd; ++i) {
            right[i] = p.data()[k * nd + m.external[i]];
            for (std::size_t j = nd; j < nv; ++j) right[i] -= mass(i, j) * speed[j];
        }
        factor.compute(mass.topLeftCorner(nd, nd));
        if (factor.info() == Eigen::Success) {
            for (std::size_t i = 0; i < nd; ++i)
                if (!(std::pow(factor.matrixLLT()(i, i), 2) > lost_inertia * mass(i, i))) return false;
            factor.solveInPlace(right);
        } else {
            Eigen::FullPivLU<Eigen::MatrixXd> lu(mass.topLeftCorner(nd, nd));
            lu.setThreshold(lost_inertia);
            if (!lu.isInvertible()) return false;
            right = lu.solve(right).eval();
        }
        std::copy_n(right.data(), nd, speed.begin());
        for (std::size_t i = 0; i < nv; ++i) v.data()[k * nv + m.external[i]] = speed[i];
    }
    return true;
}

// What is told of a step: s, the largest angle that it moved, whose (-1: nothing turned), and its iterations.
using Told = std::tuple<double, double, int, long>;

// The step from a state by the inputs u (none: zero) to rho (none: where it is), into x and lam; nothing where it fails, or
// where something that was given is not finite.
std::optional<Told> step(const Midpoint& midpoint, double t, double dt, const In<1>& q, const In<1>& p,
                         const In<1>& v_rho, const std::optional<In<1>>& u, const std::optional<In<1>>& rho,
                         const Written<1>& x, const Written<1>& lam) {
    const Mechanism& m = midpoint.mechanism();
    const std::size_t nq = m.n_configuration(), nd = m.n_dynamic, nk = m.n_kinematic, ni = m.n_inputs;
    const std::size_t nx = m.n_states(), nc = m.n_constraints();
    expect(x.size(), nx, "x");
    expect(lam.size(), nc, "lam");
    if (q.size() != nq || p.size() != nd || v_rho.size() != nk) return std::nullopt;
    if (u) expect(u->size(), ni, "u");
    if (rho) expect(rho->size(), nk, "rho");
    std::vector<double> states(2 * nx), controls(2 * (ni + nk));
    double *given = states.data(), *wanted = controls.data();
    std::copy_n(q.data(), nq, given);
    std::copy_n(p.data(), nd, given + nq);
    std::copy_n(v_rho.data(), nk, given + nq + nd);
    if (u) std::copy_n(u->data(), ni, wanted);
    std::copy_n(rho ? rho->data() : q.data() + (nq - nk), nk, wanted + ni);
    if (!all_finite(given, nx) || !all_finite(wanted, ni + nk)) return std::nullopt;
    const double times[2] = {t, t + dt};
    auto workspace = midpoint.workspace();
    RollOut made;
    {
        nb::gil_scoped_release release;
        made = roll_out(workspace->step, 1, times, nullptr, wanted, nullptr, 1.0, given, wanted + ni + nk, lam.data());
    }
    if (made.failure.status != StepStatus::converged || made.steps < 1) {
        workspace.discard();
        return std::nullopt;
    }
    std::copy_n(given + nx, nx, x.data());
    return Told{made.worst.s, made.worst.angle, made.worst.variable, made.iterations};
}

}  // namespace

void bind_states(nb::class_<Mechanism>& mechanism) {
    mechanism
        .def("start", &start, "q"_a, "v"_a.none(), "t"_a, "tolerance"_a, "rate_tolerance"_a, "x"_a,
             "Writes the state x (nx,) at a configuration and a velocity, None for rest; False where it is not finite "
             "or violates the constraints: each to a part of max(1, |Dh|, |Dh|^2 / 4), its rate of the size of its "
             "terms, at least 1.")
        .def("momenta", &momenta_along, "q"_a, "v"_a, "p"_a, "Writes the momenta p (N, nd).")
        .def("velocities", &velocities_along, "q"_a, "p"_a, "v_rho"_a.none(), "v"_a,
             "Writes the velocities v (N, nv) of momenta, with those of the kinematic variables, None for rest; False "
             "where a mass matrix is singular.");
}

void bind_step(nb::class_<Midpoint>& midpoint) {
    midpoint.def("step", &step, "t"_a, "dt"_a, "q"_a, "p"_a, "v_rho"_a, "u"_a.none(), "rho"_a.none(), "x"_a, "lam"_a,
                 "Writes the state x and the multipliers of one step; returns s, the largest angle that it moved, "
                 "whose, and its iterations. None where it failed or what was given is not finite.");
}

}  // namespace leastaction
