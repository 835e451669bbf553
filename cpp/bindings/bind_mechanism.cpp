// The mechanism and what can be asked of it at one point.

#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <numeric>
#include <tuple>

#include "bindings/arrays.hpp"
#include "dynamics/lagrangian.hpp"
#include "mechanism/time_slopes.hpp"

using namespace nanobind::literals;

namespace leastaction {

namespace {

// A time (s), or none: the mechanism's own.
using Time = std::optional<double>;

// The whole Lagrangian at one point, all joints placed: the kernel, and the potentials that it does not know.
template <class T>
class WholeLagrangian : public Lagrangian<T> {
public:
    WholeLagrangian(const Mechanism& m, std::vector<T> q, const std::vector<T>& v, Time t = {})
        : Lagrangian<T>(m), q(std::move(q)), mechanism_(m) {
        if (t) this->at.time = *t;
        this->gradient(this->q.data(), v.data());
        place(m.massless_joints_seen, this->q.data(), this->at);
        for (const auto& potential : m.potentials) {
            for_each_entry(*potential, this->at, this->q.data(), local_,
                           [&](int i, const T& slope) { this->L_q[i] -= slope; });
            stored_ += local_.value;
        }
    }
    T potential_energy() const { return Lagrangian<T>::potential_energy() + stored_; }
    // Hessian by (q, v) in the user's order, for duals its derivative: (L_qq, L_vq, L_vv).
    nb::tuple second() {
        const Mechanism& m = mechanism_;
        this->hessian();
        const std::size_t n = m.n_variables();
        const Out qq = zeros({n, n}), vq = zeros({n, n}), vv = zeros({n, n});
        const auto add = [&](const Out& out, int i, int j, double x) {
            out.data()[m.external[i] * n + m.external[j]] += x;
        };
        const PairDerivatives& d = this->pairs;
        each_pair(m, d.stride, [&](int i, int j, std::size_t at, auto weight, bool mirrored) {
            add(qq, i, j, weight * d.qq[at]);
            add(vq, i, j, weight * d.v_q[at]);
            add(vv, i, j, weight * d.vv[at]);
            if (!mirrored) return;
            add(qq, j, i, weight * d.qq[at]);
            add(vq, j, i, weight * d.q_v[at]);
            add(vv, j, i, weight * d.vv[at]);
        });
        for_each_entry(m.potentials, this->at, q.data(), local_,
                       [&](int i, int j, const T& bend) { add(qq, i, j, -highest(bend)); });
        return nb::make_tuple(qq, vq, vv);
    }

    std::vector<T> q;

private:
    static double highest(double x) { return x; }
    static double highest(const Dual<double>& x) { return x.d; }

    const Mechanism& mechanism_;
    LocalTaylor<T> local_;
    T stored_{};
};

WholeLagrangian<double> point_at(const Mechanism& m, const In<1>& q, const In<1>& v, Time t = {}) {
    return {m, configuration_of(m, q, "q"), to_internal(m, v, "v"), t};
}
WholeLagrangian<double> at_rest(const Mechanism& m, const In<1>& q, Time t = {}) {
    return {m, configuration_of(m, q, "q"), std::vector<double>(m.n_variables()), t};
}

// What stands behind the variables, quaternions, stays.
std::vector<Dual<double>> duals(const std::vector<double>& x, const std::vector<double>& dx) {
    std::vector<Dual<double>> out(x.begin(), x.end());
    for (std::size_t i = 0; i < dx.size(); ++i) out[i].d = dx[i];
    return out;
}

Out by_variable(const Mechanism& m, const std::vector<double>& internal) {
    Out out = new_array({static_cast<std::size_t>(m.n_variables())});
    for (int i = 0; i < m.n_variables(); ++i) out.data()[m.external[i]] = internal[i];
    return out;
}

struct ConstraintRows {
    std::vector<double> h, C;  // C over the user's order of variables
};

ConstraintRows constraints_at(const Mechanism& m, const In<1>& q, Time t) {
    const int nq = m.n_variables(), nc = m.n_constraints();
    const std::vector<double> internal = configuration_of(m, q, "q");
    Placement<double> at(m);
    if (t) at.time = *t;
    place(m.constraint_joints, internal.data(), at);
    ConstraintRows out{std::vector<double>(nc), std::vector<double>(static_cast<std::size_t>(nc) * nq)};
    LocalTaylor<double> local;
    for (int c = 0; c < nc; ++c) {
        for_each_entry(*m.constraints[c], at, internal.data(), local,
                       [&](int i, double slope) { out.C[c * nq + m.external[i]] += slope; });
        out.h[c] = local.value;
    }
    return out;
}

// `write(out, joint)` for every joint of every configuration; `size` doubles each.
template <class Write>
void at_every_joint(const Mechanism& m, const In<2>& q, std::size_t size, double* out, const Write& write) {
    const std::size_t nj = m.joints.size(), nq = m.n_configuration();
    expect(q.shape(1), nq, "q");
    Placement<double> at(m);
    std::vector<int> all(nj);
    std::iota(all.begin(), all.end(), 0);
    std::vector<double> q_k;
    for (std::size_t k = 0; k < q.shape(0); ++k) {
        write_configuration(m, q.data() + k * nq, q_k);
        place(all, q_k.data(), at);
        for (std::size_t j = 0; j < nj; ++j, out += size) write(out, at, static_cast<int>(j));
    }
}

Out joint_poses(const Mechanism& m, const In<2>& q) {
    Out out = new_array({q.shape(0), m.joints.size(), 4, 4});
    at_every_joint(m, q, 16, out.data(), [](double* to, const Placement<double>& at, int joint) {
        const auto& [R, p] = at.pose[joint];
        const double rows[16] = {R.c0.x, R.c1.x, R.c2.x, p.x, R.c0.y, R.c1.y, R.c2.y, p.y,
                                 R.c0.z, R.c1.z, R.c2.z, p.z, 0,      0,      0,      1};
        std::copy(rows, rows + 16, to);
    });
    return out;
}

Out joint_twists(const Mechanism& m, const In<2>& q) {
    Out out = new_array({q.shape(0), m.joints.size(), 6});
    at_every_joint(m, q, 6, out.data(), [](double* to, const Placement<double>& at, int joint) {
        const auto& [v, w] = at.twist[joint];
        const double row[6] = {v.x, v.y, v.z, w.x, w.y, w.z};
        std::copy(row, row + 6, to);
    });
    return out;
}

// Of h by the time alone: h_t (nc), and its slope by q (nc, nv).
nb::tuple constraint_drift(const Mechanism& m, const In<1>& q, Time t) {
    const std::size_t nv = m.n_variables(), nc = m.n_constraints();
    const std::vector<double> internal = configuration_of(m, q, "q");
    const Out rates = zeros({nc}), slopes = zeros({nc, nv});
    if (m.time_slot >= 0)
        TimeSlopes(m).constraints(
            t.value_or(m.own_time()), internal.data(), [&](int c, double rate) { rates.data()[c] = rate; },
            [&](int c, int i, double slope) { slopes.data()[c * nv + m.external[i]] += slope; });
    return nb::make_tuple(rates, slopes);
}

Out constraint_hessian(const Mechanism& m, const In<1>& q, const In<1>& lam) {
    expect(lam.size(), m.n_constraints(), "lam");
    const std::size_t n = m.n_variables();
    const std::vector<double> internal = configuration_of(m, q, "q");
    Placement<double> at(m);
    place(m.constraint_joints, internal.data(), at);
    Out out = zeros({n, n});
    LocalTaylor<double> local;
    for (int c = 0; c < m.n_constraints(); ++c) {
        for_each_entry(*m.constraints[c], at, internal.data(), local, [&](int i, int j, double bend) {
            out.data()[m.external[i] * n + m.external[j]] += lam.data()[c] * bend;
        });
    }
    return out;
}

// Forces at one point: f (nq), of kinematic variables too; by_q and by_v (nq x nq), by_u (nq x inputs).
struct Forces {
    Forces(const Mechanism& m, const In<1>& q, const In<1>& v, const In<1>& u, Order order,
           const std::optional<ElementParts>& parts, Time t = {})
        : m(m), n(m.n_variables()) {
        const std::vector<double> Q = configuration_of(m, q, "q"), V = to_internal(m, v, "v");
        expect(u.size(), m.n_inputs, "u");
        const std::size_t r = m.n_inputs;
        f = zeros({n});
        if (order != Order::value) {
            by_q = zeros({n, n});
            by_v = zeros({n, n});
            by_u = zeros({n, r});
        }
        for (const auto& [variable, slot] : some_of(m.damping, parts, &ElementCounts::damping)) {
            const std::size_t i = m.external[variable];
            f.data()[i] -= m.numbers[slot] * v.data()[i];
            if (order != Order::value) by_v.data()[i * n + i] -= m.numbers[slot];
        }
        for (const auto& [variable, input] : some_of(m.joint_forces, parts, &ElementCounts::joint_forces)) {
            f.data()[m.external[variable]] += u.data()[input];
            if (order != Order::value) by_u.data()[m.external[variable] * r + input] += 1.0;
        }
        Placement<double> at(m);
        if (t) at.time = *t;
        place(m.force_joints, Q.data(), at);
        LocalForce<double> local;
        const ForcePoint<double> point{at, Q.data(), V.data(), u.data()};
        const auto forces = some_of(m.forces, parts, &ElementCounts::forces);
        for_each_entry(forces, point, local, [&](int i, double force) { f.data()[m.external[i]] += force; });
        if (order == Order::value) return;
        const auto by_variable = [&](int i, int j, double f_q, double f_v) {
            by_q.data()[m.external[i] * n + m.external[j]] += f_q;
            by_v.data()[m.external[i] * n + m.external[j]] += f_v;
        };
        for_each_entry(forces, point, local, by_variable,
                       [&](int i, int input, double f_u) { by_u.data()[m.external[i] * r + input] += f_u; });
    }
    const Mechanism& m;
    const std::size_t n;
    Out f, by_q, by_v, by_u;
};

Out force_curvature(const Mechanism& m, const In<1>& q, const In<1>& v, const In<1>& u, const In<1>& mu,
                    const std::optional<ElementParts>& parts) {
    const std::size_t n = m.n_variables(), r = m.n_inputs, size = 2 * n + r;
    expect(u.size(), r, "u");
    const std::vector<double> Q = configuration_of(m, q, "q"), V = to_internal(m, v, "v"),
                              MU = to_internal(m, mu, "mu");
    const auto along_v = duals(Q, V), along_mu = duals(Q, MU);
    Placement<double> at(m);
    Placement<Dual<double>> at_v(m), at_mu(m);
    place(m.force_joints, Q.data(), at);
    place(m.force_joints, along_v.data(), at_v);
    place(m.force_joints, along_mu.data(), at_mu);
    Out out = zeros({size, size});
    LocalForce<double> local;
    for (const auto& force : some_of(m.forces, parts, &ElementCounts::forces)) {
        force->curvature({at, Q.data(), V.data(), u.data()}, {at_v, at_mu, along_v.data(), along_mu.data(), MU.data()},
                         local);
        std::vector<std::size_t> to;
        for (const int i : force->support()) to.push_back(m.external[i]);
        for (const int i : force->support()) to.push_back(n + m.external[i]);
        for (const int a : force->inputs()) to.push_back(2 * n + a);
        for (std::size_t a = 0; a < to.size(); ++a)
            for (std::size_t b = 0; b < to.size(); ++b)
                out.data()[to[a] * size + to[b]] += local.second[a * to.size() + b];
    }
    return out;
}

}  // namespace

void bind_queries(nb::class_<Mechanism>& mechanism);
void bind_states(nb::class_<Mechanism>& mechanism);

void bind_mechanism(nb::module_& module) {
    using Counts = std::array<int, 5>;
    nb::class_<ElementCounts>(module, "ElementCounts", "How many parts of each kind elements came to.")
        .def(nb::init<>())
        .def("__getstate__",
             [](const ElementCounts& c) {
                 return Counts{c.potentials, c.constraints, c.forces, c.damping, c.joint_forces};
             })
        .def("__setstate__",
             [](ElementCounts& c, const Counts& s) { new (&c) ElementCounts{s[0], s[1], s[2], s[3], s[4]}; })
        .def_ro("potentials", &ElementCounts::potentials)
        .def_ro("constraints", &ElementCounts::constraints);
    nb::class_<ElementParts>(module, "ElementParts", "The parts that one element came to.")
        .def(nb::init<ElementCounts, ElementCounts>(), "first"_a, "last"_a);
    nb::class_<Mechanism> mechanism(module, "Mechanism",
                                    "A compiled, immutable mechanism. Arrays are in the user's order.");
    mechanism.def_ro("n_dynamic", &Mechanism::n_dynamic)
        .def_ro("n_kinematic", &Mechanism::n_kinematic)
        .def_ro("n_inputs", &Mechanism::n_inputs)
        .def_ro("gravity_slot", &Mechanism::gravity_slot, "Where its three numbers are; -1: there is none.")
        .def(
            "with_numbers",
            [](const Mechanism& m, const In<1>& numbers) {
                return std::const_pointer_cast<Mechanism>(
                    with_numbers(m, {numbers.data(), numbers.data() + numbers.size()}));
            },
            "numbers"_a, "The same mechanism with other numbers of its elements, but for those of gravity.")
        .def(
            "with_bodies",
            [](const Mechanism& m, const std::vector<std::tuple<int, double, In<1>, In<2>>>& given) {
                std::vector<std::pair<int, Body>> bodies;
                for (const auto& [joint, mass, com, inertia] : given)
                    bodies.push_back({joint, body_of(mass, com, inertia)});
                return std::const_pointer_cast<Mechanism>(with_bodies(m, bodies));
            },
            "bodies"_a, "The same mechanism with other bodies at the same joints: (joint, mass, com, inertia) of each.")
        .def_prop_ro(
            "timed", [](const Mechanism& m) { return m.time_slot >= 0; }, "Whether an element changes with the time.")
        .def(
            "at_time",
            [](const Mechanism& m, double t) {
                std::vector<double> numbers = m.numbers;
                if (m.time_slot >= 0) numbers[m.time_slot] = t;
                return std::const_pointer_cast<Mechanism>(with_numbers(m, std::move(numbers)));
            },
            "t"_a, "The same mechanism with another time (s) of its own, which holds where no other is told.")
        .def_prop_ro("n_constraints", &Mechanism::n_constraints)
        .def_prop_ro("n_configuration", &Mechanism::n_configuration)
        .def_prop_ro("n_joints", [](const Mechanism& m) { return m.joints.size(); })
        .def("joint_poses", &joint_poses, "q"_a, "Poses (N, n_joints, 4, 4) of the joints' moved frames at q (N, nq).")
        .def("joint_twists", &joint_twists, "q"_a,
             "Twists [v; w] (N, n_joints, 6) of the joints in the world, at the world origin.")
        .def(
            "kinetic_energy",
            [](const Mechanism& m, const In<1>& q, const In<1>& v) { return point_at(m, q, v).kinetic_energy(); },
            "q"_a, "v"_a, "Kinetic energy in joules.")
        .def(
            "potential_energy",
            [](const Mechanism& m, const In<1>& q, Time t) { return at_rest(m, q, t).potential_energy(); }, "q"_a,
            "t"_a.none() = nb::none(), "Potential energy in joules, of gravity and all other potentials.")
        .def(
            "gradient",
            [](const Mechanism& m, const In<1>& q, const In<1>& v, Time t) {
                const auto point = point_at(m, q, v, t);
                return std::tuple(by_variable(m, point.L_q), by_variable(m, point.L_v));
            },
            "q"_a, "v"_a, "t"_a.none() = nb::none(), "Gradient of the Lagrangian: (L_q, L_v), each (nq,).")
        .def(
            "hessian", [](const Mechanism& m, const In<1>& q, const In<1>& v) { return point_at(m, q, v).second(); },
            "q"_a, "v"_a, "Hessian of the Lagrangian: (L_qq, L_vq, L_vv), L_vq[i, j] = d2L/dv_i dq_j.")
        .def(
            "inertias",
            [](const Mechanism& m, const In<1>& q) {
                WholeLagrangian<double> point = at_rest(m, q);
                std::vector<double> inertias(m.n_variables());
                point.composites();
                point.inertias(inertias.data());
                return by_variable(m, inertias);
            },
            "q"_a, "The inertia that each variable moves: the diagonal of L_vv, (nq,).")
        .def(
            "third",
            [](const Mechanism& m, const In<1>& q, const In<1>& v, const In<1>& dq, const In<1>& dv) {
                const auto along_q = duals(configuration_of(m, q, "q"), to_internal(m, dq, "dq"));
                const auto along_v = duals(to_internal(m, v, "v"), to_internal(m, dv, "dv"));
                return WholeLagrangian<Dual<double>>(m, along_q, along_v).second();
            },
            "q"_a, "v"_a, "dq"_a, "dv"_a, "Derivative of hessian() along (dq, dv).")
        .def(
            "inertia_slope",
            [](const Mechanism& m, const In<1>& q, const In<1>& v, int joint, const std::array<double, 10>& i) {
                if (joint < 0 || joint >= m.n_massive) throw std::invalid_argument("no such joint with a mass");
                std::vector<double> L_q(m.n_variables()), L_v(m.n_variables());
                point_at(m, q, v).add_inertia_slope(joint, inertia_of(i), L_q, L_v);
                return std::tuple(by_variable(m, L_q), by_variable(m, L_v));
            },
            "q"_a, "v"_a, "joint"_a, "inertia"_a,
            "What gradient() changes by where the body of a joint gets more inertia: mass, "
            "first "
            "moment and rotational inertia xx yy zz xy xz yz about the origin of the joint's frame.")
        .def("constraint_hessian", &constraint_hessian, "q"_a, "lam"_a,
             "Second derivatives (nv, nv) of lam.h(q); of balls in their charts rx ry rz.")
        .def(
            "force",
            [](const Mechanism& m, const In<1>& q, const In<1>& v, const In<1>& u,
               const std::optional<ElementParts>& parts,
               Time t) { return Forces(m, q, v, u, Order::value, parts, t).f; },
            "q"_a, "v"_a, "u"_a, "parts"_a.none() = nb::none(), "t"_a.none() = nb::none(),
            "Generalized forces f(q, v, u), (nq,): of all elements, or the parts of one.")
        .def(
            "force_jacobians",
            [](const Mechanism& m, const In<1>& q, const In<1>& v, const In<1>& u,
               const std::optional<ElementParts>& parts) {
                const Forces forces(m, q, v, u, Order::gradient, parts);
                return std::tuple(forces.by_q, forces.by_v, forces.by_u);
            },
            "q"_a, "v"_a, "u"_a, "parts"_a.none() = nb::none(),
            "Their derivatives by q, v and u: (nq, nq), (nq, nq) and (nq, n_inputs).")
        .def("force_curvature", &force_curvature, "q"_a, "v"_a, "u"_a, "mu"_a, "parts"_a.none() = nb::none(),
             "Second derivatives of mu.f by [q; v; u].")
        .def_prop_ro(
            "numbers", [](const Mechanism& m) { return copy_of(m.numbers, {m.numbers.size()}); }, nb::rv_policy::move,
            "Numbers of the elements, by slot.")
        .def(
            "constraints",
            [](const Mechanism& m, const In<1>& q, Time t) {
                return copy_of(constraints_at(m, q, t).h, {static_cast<std::size_t>(m.n_constraints())});
            },
            "q"_a, "t"_a.none() = nb::none(),
            "Constraint residuals h(q), (nc,); at the mechanism's own time if no other.")
        .def(
            "constraint_jacobian",
            [](const Mechanism& m, const In<1>& q, Time t) {
                return copy_of(constraints_at(m, q, t).C, {static_cast<std::size_t>(m.n_constraints()),
                                                           static_cast<std::size_t>(m.n_variables())});
            },
            "q"_a, "t"_a.none() = nb::none(), "Constraint Jacobian Dh(q), (nc, nq).")
        .def("constraint_drift", &constraint_drift, "q"_a, "t"_a.none() = nb::none(),
             "What constraints change by in a second where nothing moves, dh/dt (nc,), and its derivatives by q (nc, "
             "nv).");
    bind_queries(mechanism);
    bind_states(mechanism);
}

}  // namespace leastaction
