// Functions of a mechanism at one point, with derivatives along directions.

#include <nanobind/stl/array.h>
#include <nanobind/stl/tuple.h>

#include "bindings/arrays.hpp"
#include "dynamics/queries.hpp"
#include "kinematics/moved_point.hpp"

using namespace nanobind::literals;

namespace leastaction {

namespace {

// Rows of directions, by the user's order of variables.
std::vector<std::vector<double>> directions_of(const Mechanism& m, const In<2>& rows, const char* what) {
    expect(rows.shape(1), m.n_variables(), what);
    std::vector<std::vector<double>> out;
    for (std::size_t k = 0; k < rows.shape(0); ++k) out.push_back(to_internal(m, rows.data() + k * rows.shape(1)));
    return out;
}

nb::tuple arrays_of(const FunctionDerivatives& d) {
    const std::size_t count = d.value.size(), n = count ? d.gradient.size() / count : 0;
    return nb::make_tuple(copy_of(d.value, {count}), copy_of(d.gradient, {count, n}),
                          copy_of(d.hessian, {d.hessian.size()}));
}

nb::tuple functions_at(const Mechanism& m, const Functions& functions, int first, int last, const In<1>& mu,
                       const In<1>& q, const In<2>& dq) {
    if (first < 0 || first > last || last > static_cast<int>(functions.size()))
        throw std::invalid_argument("no such elements: " + std::to_string(first) + " to " + std::to_string(last));
    expect(mu.size(), last - first, "mu");
    return arrays_of(functions_of_configuration(m, functions, first, last, mu.data(), to_internal(m, q, "q"),
                                                {directions_of(m, dq, "dq"), {}}));
}

MovedPoint point_behind(const Mechanism& m, int joint, const std::array<double, 3>& offset) {
    if (joint < -1 || joint >= static_cast<int>(m.joints.size()))
        throw std::invalid_argument("no such joint: " + std::to_string(joint));
    return {m, joint, {offset[0], offset[1], offset[2]}, m.external};
}

Out point_places(const Mechanism& m, const In<2>& q, int joint, const std::array<double, 3>& offset) {
    const std::size_t n = m.n_variables();
    expect(q.shape(1), n, "q");
    MovedPoint point = point_behind(m, joint, offset);
    Out out = new_array({q.shape(0), 3});
    for (std::size_t k = 0; k < q.shape(0); ++k) {
        point.place_at(to_internal(m, q.data() + k * n).data());
        const auto [x, y, z] = point.position();
        const double row[3] = {x, y, z};
        std::copy(row, row + 3, out.data() + 3 * k);
    }
    return out;
}

Out point_jacobians(const Mechanism& m, const In<2>& q, int joint, const std::array<double, 3>& offset) {
    const std::size_t n = m.n_variables();
    expect(q.shape(1), n, "q");
    MovedPoint point = point_behind(m, joint, offset);
    Out out = new_array({q.shape(0), 3, n});
    for (std::size_t k = 0; k < q.shape(0); ++k) {
        point.place_at(to_internal(m, q.data() + k * n).data());
        point.jacobian(out.data() + 3 * n * k);
    }
    return out;
}

Out point_bent(const Mechanism& m, const In<2>& q, int joint, const std::array<double, 3>& offset, const In<2>& force) {
    const std::size_t n = m.n_variables();
    expect(q.shape(1), n, "q");
    expect(force.shape(0), q.shape(0), "force");
    expect(force.shape(1), 3, "force");
    MovedPoint point = point_behind(m, joint, offset);
    Out out = new_array({q.shape(0), n, n});
    for (std::size_t k = 0; k < q.shape(0); ++k) {
        const double* f = force.data() + 3 * k;
        point.place_at(to_internal(m, q.data() + k * n).data());
        point.bent({f[0], f[1], f[2]}, out.data() + n * n * k);
    }
    return out;
}

}  // namespace

void bind_queries(nb::class_<Mechanism>& mechanism) {
    mechanism
        .def(
            "lagrangian_of_bodies",
            [](const Mechanism& m, const In<1>& q, const In<1>& v, const In<2>& dq, const In<2>& dv) {
                expect(dv.shape(0), dq.shape(0), "dv");
                return arrays_of(lagrangian_of_bodies(m, to_internal(m, q, "q"), to_internal(m, v, "v"),
                                                      {directions_of(m, dq, "dq"), directions_of(m, dv, "dv")}));
            },
            "q"_a, "v"_a, "dq"_a, "dv"_a,
            "The Lagrangian without the potentials of elements: value (1,), gradient (1, n) and Hessian (n * n,) by "
            "[q; v], or their derivatives along the directions dq, dv (2 rows at most).")
        .def(
            "potentials",
            [](const Mechanism& m, int first, int last, const In<1>& mu, const In<1>& q, const In<2>& dq) {
                return functions_at(m, m.potentials, first, last, mu, q, dq);
            },
            "first"_a, "last"_a, "mu"_a, "q"_a, "dq"_a,
            "Potentials first .. last-1 of elements by q: values (n,), gradients (n, nq) and the Hessian (nq * nq,) of "
            "mu.V, or their derivatives along the directions dq (2 rows at most).")
        .def(
            "constraint_functions",
            [](const Mechanism& m, int first, int last, const In<1>& mu, const In<1>& q, const In<2>& dq) {
                return functions_at(m, m.constraints, first, last, mu, q, dq);
            },
            "first"_a, "last"_a, "mu"_a, "q"_a, "dq"_a, "The same of constraints first .. last-1.")
        .def(
            "forces_along",
            [](const Mechanism& m, const In<1>& mu, const In<1>& q, const In<1>& v, const In<1>& u, const In<1>& dq,
               const In<1>& dv, const In<1>& du, const ElementParts& parts) {
                expect(mu.size(), m.n_variables(), "mu");
                const auto given = [&](const In<1>& inputs, const char* what) {
                    expect(inputs.size(), m.n_inputs, what);
                    return std::vector<double>(inputs.data(), inputs.data() + inputs.size());
                };
                const ForceDerivatives d = forces_along(
                    m, some_of(m.forces, parts, &ElementCounts::forces), {mu.data(), mu.data() + mu.size()},
                    {to_internal(m, q, "q"), to_internal(m, v, "v"), given(u, "u")},
                    {to_internal(m, dq, "dq"), to_internal(m, dv, "dv"), given(du, "du")});
                const std::size_t n = m.n_variables();
                return nb::make_tuple(copy_of(d.jacobian, {n, 2 * n + m.n_inputs}),
                                      copy_of(d.hessian, {d.hessian.size()}));
            },
            "mu"_a, "q"_a, "v"_a, "u"_a, "dq"_a, "dv"_a, "du"_a, "parts"_a,
            "Derivatives of forces by [q; v; u] along a direction, without joint damping and joint forces, which are "
            "linear: gradients (nq, n) and the Hessian (n * n,) of mu.f.")
        .def("point_places", &point_places, "q"_a, "joint"_a, "offset"_a,
             "Where a point behind a joint is (-1: of the world) at q (N, nq), (N, 3).")
        .def("point_jacobians", &point_jacobians, "q"_a, "joint"_a, "offset"_a,
             "Its derivatives (N, 3, nq) by the configuration.")
        .def("point_bent", &point_bent, "q"_a, "joint"_a, "offset"_a, "force"_a,
             "Its second derivatives along forces (N, 3), (N, nq, nq).");
}

}  // namespace leastaction
