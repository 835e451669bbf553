// Functions of a mechanism at one point, with derivatives along directions; of balls in their charts rx ry rz.

#include <nanobind/stl/array.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include "bindings/arrays.hpp"
#include "dynamics/queries.hpp"
#include "kinematics/moved_points.hpp"

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
    return arrays_of(functions_of_configuration(m, functions, first, last, mu.data(), configuration_of(m, q, "q"),
                                                {directions_of(m, dq, "dq"), {}}));
}

// Points behind joints, at offsets (P, 3) in their axes.
MovedPoints points_behind(const Mechanism& m, const std::vector<int>& joints, const In<2>& offsets) {
    expect(offsets.shape(0), joints.size(), "offsets");
    expect(offsets.shape(1), 3, "offsets");
    std::vector<Point> points;
    for (std::size_t i = 0; i < joints.size(); ++i) {
        if (joints[i] < -1 || joints[i] >= static_cast<int>(m.joints.size()))
            throw std::invalid_argument("no such joint: " + std::to_string(joints[i]));
        const double* at = offsets.data() + 3 * i;
        points.push_back({joints[i], {at[0], at[1], at[2]}});
    }
    return {m, points, m.external};
}

Vec3<double> vector_at(const double* at) { return {at[0], at[1], at[2]}; }

Out point_places(const Mechanism& m, const In<2>& q, const std::vector<int>& joints, const In<2>& offsets) {
    expect(q.shape(1), m.n_configuration(), "q");
    MovedPoints points = points_behind(m, joints, offsets);
    std::vector<double> at_k;
    Out out = new_array({q.shape(0), joints.size(), 3});
    double* to = out.data();
    for (std::size_t k = 0; k < q.shape(0); ++k) {
        write_configuration(m, q.data() + k * q.shape(1), at_k);
        points.place_at(at_k.data());
        for (std::size_t i = 0; i < joints.size(); ++i) {
            const auto [x, y, z] = points.position(i);
            for (const double each : {x, y, z}) *to++ = each;
        }
    }
    return out;
}

Out point_slopes(const Mechanism& m, const In<2>& q, const std::vector<int>& joints, const In<2>& offsets,
                 const std::vector<int>& of, const In<3>& along) {
    const std::size_t n = m.n_variables(), rows = of.size();
    expect(q.shape(1), m.n_configuration(), "q");
    if (along.shape(0) != 1) expect(along.shape(0), q.shape(0), "along");
    expect(along.shape(1), rows, "along");
    expect(along.shape(2), 3, "along");
    for (const int point : of)
        if (point < 0 || point >= static_cast<int>(joints.size())) throw std::invalid_argument("of: no such point");
    MovedPoints points = points_behind(m, joints, offsets);
    std::vector<double> at_k;
    Out out = new_array({q.shape(0), rows, n});
    for (std::size_t k = 0; k < q.shape(0); ++k) {
        write_configuration(m, q.data() + k * q.shape(1), at_k);
        points.place_at(at_k.data());
        const double* at = along.data() + (along.shape(0) == 1 ? 0 : 3 * rows * k);
        for (std::size_t i = 0; i < rows; ++i)
            points.slope(of[i], vector_at(at + 3 * i), out.data() + (k * rows + i) * n);
    }
    return out;
}

Out point_bent(const Mechanism& m, const In<2>& q, const std::vector<int>& joints, const In<2>& offsets,
               const In<3>& force, const In<2>& weight) {
    const std::size_t n = m.n_variables(), count = joints.size();
    expect(q.shape(1), m.n_configuration(), "q");
    for (const std::size_t given : {force.shape(0), weight.shape(0)}) expect(given, q.shape(0), "force and weight");
    for (const std::size_t given : {force.shape(1), weight.shape(1)}) expect(given, count, "force and weight");
    expect(force.shape(2), 3, "force");
    MovedPoints points = points_behind(m, joints, offsets);
    std::vector<double> at_k;
    Out out = zeros({q.shape(0), n, n});
    for (std::size_t k = 0; k < q.shape(0); ++k) {
        write_configuration(m, q.data() + k * q.shape(1), at_k);
        points.place_at(at_k.data());
        for (std::size_t i = 0; i < count; ++i) {
            const std::size_t at = k * count + i;
            points.add_bent(i, vector_at(force.data() + 3 * at), weight.data()[at], out.data() + n * n * k);
        }
    }
    return out;
}

Out point_apart_bent(const Mechanism& m, const In<2>& q, const std::vector<int>& joints, const In<2>& offsets,
                     const In<3>& along, const In<2>& stiff, const In<2>& weight) {
    const std::size_t n = m.n_variables(), pairs = joints.size() / 2;
    expect(q.shape(1), m.n_configuration(), "q");
    expect(joints.size(), 2 * pairs, "joints");
    for (const std::size_t given : {along.shape(0), stiff.shape(0), weight.shape(0)})
        expect(given, q.shape(0), "along, stiff and weight");
    for (const std::size_t given : {along.shape(1), stiff.shape(1), weight.shape(1)})
        expect(given, pairs, "along, stiff and weight");
    expect(along.shape(2), 3, "along");
    MovedPoints points = points_behind(m, joints, offsets);
    std::vector<double> at_k;
    Out out = zeros({q.shape(0), n, n});
    for (std::size_t k = 0; k < q.shape(0); ++k) {
        write_configuration(m, q.data() + k * q.shape(1), at_k);
        points.place_at(at_k.data());
        for (std::size_t i = 0; i < pairs; ++i) {
            const std::size_t at = k * pairs + i;
            points.add_apart(i, pairs + i, vector_at(along.data() + 3 * at), stiff.data()[at], weight.data()[at],
                             out.data() + n * n * k);
        }
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
                return arrays_of(lagrangian_of_bodies(m, configuration_of(m, q, "q"), to_internal(m, v, "v"),
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
                    {configuration_of(m, q, "q"), to_internal(m, v, "v"), given(u, "u")},
                    {to_internal(m, dq, "dq"), to_internal(m, dv, "dv"), given(du, "du")});
                const std::size_t n = m.n_variables();
                return nb::make_tuple(copy_of(d.jacobian, {n, 2 * n + m.n_inputs}),
                                      copy_of(d.hessian, {d.hessian.size()}));
            },
            "mu"_a, "q"_a, "v"_a, "u"_a, "dq"_a, "dv"_a, "du"_a, "parts"_a,
            "Derivatives of forces by [q; v; u] along a direction, without joint damping and joint forces, which are "
            "linear: gradients (nq, n) and the Hessian (n * n,) of mu.f.")
        .def("point_places", &point_places, "q"_a, "joints"_a, "offsets"_a,
             "Where P points behind joints are (-1: of the world) at q (N, nq), (N, P, 3).")
        .def("point_slopes", &point_slopes, "q"_a, "joints"_a, "offsets"_a, "of"_a, "along"_a,
             "How they move along R vectors (N, R, 3), or (1, R, 3), each of one point, by q: (N, R, nq).")
        .def("point_bent", &point_bent, "q"_a, "joints"_a, "offsets"_a, "force"_a, "weight"_a,
             "The sum of their second derivatives along forces (N, P, 3), and of weights (N, P) times the products of "
             "their first ones, (N, nq, nq).")
        .def(
            "point_apart_bent", &point_apart_bent, "q"_a, "joints"_a, "offsets"_a, "along"_a, "stiff"_a, "weight"_a,
            "The sum over pairs of points, i and P + i of 2 P, of how far apart they move: products of the derivatives "
            "along vectors (N, P, 3) times stiff (N, P), and of those of all components times weights (N, P).");
}

}  // namespace leastaction
