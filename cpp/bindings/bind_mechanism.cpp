// The mechanism and what can be asked of it at one point.

#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/tuple.h>

#include <numeric>

#include "arrays.hpp"
#include "lagrangian.hpp"

using namespace nanobind::literals;

namespace leastaction {

namespace {

Vec3<double> vec3(const In<1>& a) {
    expect(a.size(), 3, "vector");
    return {a.data()[0], a.data()[1], a.data()[2]};
}

Pose<double> pose_of(const In<2>& a) {
    expect(a.size(), 16, "pose");
    const double* m = a.data();
    return {{{m[0], m[4], m[8]}, {m[1], m[5], m[9]}, {m[2], m[6], m[10]}}, {m[3], m[7], m[11]}};
}

Lagrangian<double> kernel_at(const Mechanism& m, const In<1>& q, const In<1>& v) {
    expect(q.size(), m.n_variables(), "q");
    expect(v.size(), m.n_variables(), "v");
    Lagrangian<double> kernel(m);
    kernel.gradient(to_internal(m, q.data(), m.n_variables()).data(), to_internal(m, v.data(), m.n_variables()).data());
    return kernel;
}

Out by_variable(const Mechanism& m, const std::vector<double>& internal) {
    Out out = new_array({static_cast<std::size_t>(m.n_variables())});
    for (int i = 0; i < m.n_variables(); ++i) out.data()[m.external[i]] = internal[i];
    return out;
}

// A pair plane as a full matrix in the user's order: row from `lower` for (i, j), from `upper` for (j, i).
Out pair_matrix(const Mechanism& m, const PairDerivatives& d, const std::vector<double>& lower,
                const std::vector<double>& upper) {
    const std::size_t n = m.n_variables();
    Out out = new_array({n, n});
    std::fill_n(out.data(), n * n, 0.0);
    for (int joint = 0; joint < m.n_massive; ++joint)
        for (const int ancestor : m.path[joint]) {
            const std::size_t i = m.external[m.joints[joint].variable], j = m.external[m.joints[ancestor].variable];
            const std::size_t at = joint * d.stride + ancestor;
            out.data()[i * n + j] = lower[at];
            if (i != j) out.data()[j * n + i] = upper[at];
        }
    return out;
}

struct ConstraintRows {
    std::vector<double> h, C;  // C over the user's order of variables
};

ConstraintRows constraints_at(const Mechanism& m, const In<1>& q) {
    expect(q.size(), m.n_variables(), "q");
    const int nq = m.n_variables(), nc = m.n_constraints();
    const std::vector<double> internal = to_internal(m, q.data(), nq);
    Placement<double> at(m.joints.size());
    place(m.joints, m.constraint_joints, internal.data(), at);
    ConstraintRows out{std::vector<double>(nc), std::vector<double>(static_cast<std::size_t>(nc) * nq)};
    LocalTaylor<double> local;
    for (int c = 0; c < nc; ++c) {
        m.constraints[c]->evaluate(at, internal.data(), Order::gradient, local);
        out.h[c] = local.value;
        const auto& support = m.constraints[c]->support();
        for (std::size_t i = 0; i < support.size(); ++i) out.C[c * nq + m.external[support[i]]] += local.gradient[i];
    }
    return out;
}

Out joint_poses(const Mechanism& m, const In<2>& q) {
    const std::size_t count = q.shape(0), nj = m.joints.size(), nq = m.n_variables();
    expect(q.shape(1), nq, "q");
    Out out = new_array({count, nj, 4, 4});
    Placement<double> at(nj);
    std::vector<int> all(nj);
    std::iota(all.begin(), all.end(), 0);
    for (std::size_t k = 0; k < count; ++k) {
        place(m.joints, all, to_internal(m, q.data() + k * nq, static_cast<int>(nq)).data(), at);
        for (std::size_t j = 0; j < nj; ++j) {
            const Pose<double>& pose = at.pose[m.joint_of_builder[j]];
            const Mat3<double>& R = pose.R;
            const double rows[16] = {R.c0.x, R.c1.x, R.c2.x, pose.p.x, R.c0.y, R.c1.y, R.c2.y, pose.p.y,
                                     R.c0.z, R.c1.z, R.c2.z, pose.p.z, 0,      0,      0,      1};
            std::copy(rows, rows + 16, out.data() + (k * nj + j) * 16);
        }
    }
    return out;
}

}  // namespace

void bind_mechanism(nb::module_& module) {
    nb::class_<Mechanism>(module, "Mechanism", "A compiled, immutable mechanism. Arrays are in the user's order.")
        .def_ro("n_dynamic", &Mechanism::n_dynamic)
        .def_ro("n_kinematic", &Mechanism::n_kinematic)
        .def_ro("n_inputs", &Mechanism::n_inputs)
        .def_prop_ro("n_constraints", &Mechanism::n_constraints)
        .def_prop_ro("n_joints", [](const Mechanism& m) { return m.joints.size(); })
        .def("joint_poses", &joint_poses, "q"_a, "Poses (N, n_joints, 4, 4) of the joints' moved frames at q (N, nq).")
        .def(
            "kinetic_energy",
            [](const Mechanism& m, const In<1>& q, const In<1>& v) { return kernel_at(m, q, v).kinetic_energy(); },
            "q"_a, "v"_a, "Kinetic energy in joules.")
        .def(
            "potential_energy",
            [](const Mechanism& m, const In<1>& q) { return kernel_at(m, q, q).potential_energy(); }, "q"_a,
            "Potential energy in joules.")
        .def(
            "gradient",
            [](const Mechanism& m, const In<1>& q, const In<1>& v) {
                const auto kernel = kernel_at(m, q, v);
                return std::tuple(by_variable(m, kernel.L_q), by_variable(m, kernel.L_v));
            },
            "q"_a, "v"_a, "Gradient of the Lagrangian: (L_q, L_v), each (nq,).")
        .def(
            "hessian",
            [](const Mechanism& m, const In<1>& q, const In<1>& v) {
                auto kernel = kernel_at(m, q, v);
                kernel.hessian();
                const auto& d = kernel.pairs;
                return std::tuple(pair_matrix(m, d, d.qq, d.qq), pair_matrix(m, d, d.v_q, d.q_v),
                                  pair_matrix(m, d, d.vv, d.vv));
            },
            "q"_a, "v"_a, "Hessian of the Lagrangian: (L_qq, L_vq, L_vv), L_vq[i, j] = d2L/dv_i dq_j.")
        .def(
            "third",
            [](const Mechanism& m, const In<1>& q, const In<1>& v, const In<1>& dq, const In<1>& dv) {
                const int n = m.n_variables();
                for (const auto* a : {&q, &v, &dq, &dv}) expect(a->size(), n, "argument");
                Lagrangian<Dual<double>> kernel(m);
                std::vector<Dual<double>> Q(n), V(n);
                for (int i = 0; i < n; ++i) {
                    Q[i] = {q.data()[m.external[i]], dq.data()[m.external[i]]};
                    V[i] = {v.data()[m.external[i]], dv.data()[m.external[i]]};
                }
                kernel.gradient(Q.data(), V.data());
                kernel.hessian();
                const auto& d = kernel.pairs;
                return std::tuple(pair_matrix(m, d, d.qq, d.qq), pair_matrix(m, d, d.v_q, d.q_v),
                                  pair_matrix(m, d, d.vv, d.vv));
            },
            "q"_a, "v"_a, "dq"_a, "dv"_a, "Derivative of hessian() along (dq, dv).")
        .def(
            "constraints",
            [](const Mechanism& m, const In<1>& q) {
                return copy_of(constraints_at(m, q).h, {static_cast<std::size_t>(m.n_constraints())});
            },
            "q"_a, "Constraint residuals h(q), (nc,).")
        .def(
            "constraint_jacobian",
            [](const Mechanism& m, const In<1>& q) {
                return copy_of(constraints_at(m, q).C, {static_cast<std::size_t>(m.n_constraints()),
                                                        static_cast<std::size_t>(m.n_variables())});
            },
            "q"_a, "Constraint Jacobian Dh(q), (nc, nq).");

    nb::class_<MechanismBuilder>(module, "MechanismBuilder", "Collects joints, bodies and elements; build() compiles.")
        .def(nb::init<int, int, int>(), "n_dynamic"_a, "n_kinematic"_a, "n_inputs"_a)
        .def(
            "add_joint",
            [](MechanismBuilder& b, int parent, const In<2>& pose, const In<1>& twist, int variable) {
                expect(twist.size(), 6, "twist");
                const double* s = twist.data();
                return b.add_joint(parent, pose_of(pose), {{s[0], s[1], s[2]}, {s[3], s[4], s[5]}}, variable);
            },
            "parent"_a, "pose"_a, "twist"_a, "variable"_a)
        .def(
            "add_body",
            [](MechanismBuilder& b, int joint, double mass, const In<1>& com, const In<2>& inertia) {
                expect(inertia.size(), 9, "inertia");
                const double* I = inertia.data();
                b.add_body(joint, {mass, vec3(com), {I[0], I[4], I[8], I[1], I[2], I[5]}});
            },
            "joint"_a, "mass"_a, "com"_a, "inertia"_a)
        .def(
            "add_point",
            [](MechanismBuilder& b, int joint, const In<1>& offset) { return b.add_point(joint, vec3(offset)); },
            "joint"_a, "offset"_a)
        .def(
            "set_gravity", [](MechanismBuilder& b, const In<1>& g) { b.set_gravity(vec3(g)); }, "g"_a)
        .def("add_distance", &MechanismBuilder::add_distance, "point1"_a, "point2"_a, "length"_a, "variable"_a = -1)
        .def(
            "add_coincidence",
            [](MechanismBuilder& b, int point1, int point2, const In<1>& direction) {
                b.add_coincidence(point1, point2, vec3(direction));
            },
            "point1"_a, "point2"_a, "direction"_a)
        .def("add_damping", &MechanismBuilder::add_damping, "variable"_a, "coefficient"_a)
        .def("add_joint_force", &MechanismBuilder::add_joint_force, "variable"_a, "input"_a)
        .def("build", [](const MechanismBuilder& b) { return std::const_pointer_cast<Mechanism>(b.build()); });
}

}  // namespace leastaction
