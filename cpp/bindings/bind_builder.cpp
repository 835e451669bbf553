// The builder that descriptions are compiled with.

#include <nanobind/stl/array.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include "bindings/arrays.hpp"
#include "bindings/python_function.hpp"
#include "mechanism/mechanism.hpp"

using namespace nanobind::literals;

namespace leastaction {

namespace {

using Indices = std::vector<int>;

Pose<double> pose_of(const In<2>& a) {
    expect(a.size(), 16, "pose");
    const double* m = a.data();
    return {{{m[0], m[4], m[8]}, {m[1], m[5], m[9]}, {m[2], m[6], m[10]}}, {m[3], m[7], m[11]}};
}

Wrench::Kind wrench_kind(const std::string& kind) {
    if (kind == "spatial") return Wrench::Kind::spatial;
    if (kind == "body") return Wrench::Kind::body;
    if (kind == "hybrid") return Wrench::Kind::hybrid;
    throw std::invalid_argument("wrench: got '" + kind + "', expected 'spatial', 'body' or 'hybrid'");
}

void expect_inputs(const Tape& tape, std::size_t expected) {
    if (static_cast<std::size_t>(tape.n_inputs()) != expected)
        throw std::invalid_argument("the tape has " + std::to_string(tape.n_inputs()) + " inputs, expected " +
                                    std::to_string(expected));
}

void bind_coordinates(nb::class_<MechanismBuilder>& builder) {
    builder
        .def("variables_coordinate", &MechanismBuilder::combination, "variables"_a, "factors"_a,
             "Sum of variables times factors (slots).")
        .def("path_coordinate", &MechanismBuilder::path, "points"_a, "Length of a string over points.")
        .def("rotation_coordinate", &MechanismBuilder::rotation, "variable"_a,
             "Component of the rotation vector of a ball, by the variable of that axis.")
        .def("offset_coordinate", &MechanismBuilder::offset, "coordinate"_a, "slot"_a = -1, "variable"_a = -1,
             "A coordinate less a number, a variable, or both.")
        .def("sum_coordinate", &MechanismBuilder::sum, "coordinates"_a, "factors"_a,
             "Sum of coordinates times factors (slots).")
        .def("law_coordinate", &MechanismBuilder::law_of, "coordinate"_a, "law"_a, "law(coordinate).")
        .def(
            "component_coordinate",
            [](MechanismBuilder& b, int point1, int point2, int direction) {
                return b.local({point1, point2}, {direction}, {}, component_function());
            },
            "point1"_a, "point2"_a, "direction"_a, "e.(p1 - p2).")
        .def(
            "product_coordinate",
            [](MechanismBuilder& b, int direction1, int direction2) {
                return b.local({}, {direction1, direction2}, {}, product_function());
            },
            "direction1"_a, "direction2"_a, "d1.d2.")
        .def(
            "tape_coordinate",
            [](MechanismBuilder& b, const Indices& points, const Indices& directions, const Indices& variables,
               std::shared_ptr<Tape> tape, const Indices& slots) {
                expect_inputs(*tape, 3 * (points.size() + directions.size()) + variables.size() + slots.size());
                b.check_slots(slots);
                return b.local(points, directions, variables, tape_function(tape, slots));
            },
            "points"_a, "directions"_a, "variables"_a, "tape"_a, "slots"_a,
            "An expression in the components of points and directions, variables and numbers (slots).")
        .def(
            "python_coordinate",
            [](MechanismBuilder& b, const Indices& points, const Indices& directions, const Indices& variables,
               const nb::object& function) {
                return b.local(points, directions, variables, std::make_shared<PythonFunction>(function));
            },
            "points"_a, "directions"_a, "variables"_a, "function"_a,
            "function(z, order) -> (value, gradient, Hessian) in Python; z is complex for the third order.");
}

void bind_laws(nb::class_<MechanismBuilder>& builder) {
    builder
        .def(
            "law",
            [](MechanismBuilder& b, const std::string& kind, const Indices& slots) {
                b.check_slots(slots);
                return b.add_law(std::make_shared<Law>(kind, slots));
            },
            "kind"_a, "slots"_a, "A function of one number, by name.")
        .def(
            "piecewise_law",
            [](MechanismBuilder& b, const In<1>& breaks, const In<2>& coefficients, int scale) {
                return b.add_law(std::make_shared<Law>(
                    std::vector<double>(breaks.data(), breaks.data() + breaks.size()),
                    std::vector<double>(coefficients.data(), coefficients.data() + coefficients.size()),
                    b.check_slot(scale)));
            },
            "breaks"_a, "coefficients"_a, "scale"_a, "Polynomial pieces, ascending powers of x - breaks[i].")
        .def(
            "tape_law",
            [](MechanismBuilder& b, std::shared_ptr<Tape> tape, const Indices& slots) {
                b.check_slots(slots);
                return b.add_law(std::make_shared<Law>(tape, slots));
            },
            "tape"_a, "slots"_a, "An expression in one number, and slots.");
}

void bind_elements(nb::class_<MechanismBuilder>& builder) {
    builder.def("add_distance", &MechanismBuilder::add_distance, "point1"_a, "point2"_a, "length"_a, "variable"_a = -1)
        .def(
            "add_coincidence",
            [](MechanismBuilder& b, int point1, int point2, const In<1>& direction) {
                b.add_coincidence(point1, point2, vec3(direction));
            },
            "point1"_a, "point2"_a, "direction"_a)
        .def("add_constraint", &MechanismBuilder::add_constraint, "coordinate"_a, "slot"_a = -1, "variable"_a = -1,
             "h = coordinate - number - variable.")
        .def("add_potential", &MechanismBuilder::add_potential, "coordinate"_a, "law"_a = -1,
             "V = law(coordinate), or the coordinate.")
        .def("add_rotor", &MechanismBuilder::add_rotor, "variables"_a, "factors"_a, "inertia"_a,
             "T = J/2 (sum of variables' rates times factors)^2, by slots.")
        .def("add_damping", &MechanismBuilder::add_damping, "variable"_a, "coefficient"_a)
        .def("add_joint_force", &MechanismBuilder::add_joint_force, "variable"_a, "input"_a)
        .def(
            "add_force",
            [](MechanismBuilder& b, int coordinate, int gain, int input, int law_s, int law_v) {
                b.add_force({coordinate}, input < 0 ? Indices{} : Indices{input},
                            product_magnitude(b.check_slot(gain), input >= 0, b.law(law_s), b.law(law_v)));
            },
            "coordinate"_a, "gain"_a, "input"_a = -1, "law_s"_a = -1, "law_v"_a = -1,
            "A force gain * u * law_s(s) * law_v(rate of s) along a coordinate s.")
        .def(
            "add_tape_force",
            [](MechanismBuilder& b, const Indices& coordinates, const Indices& inputs, std::shared_ptr<Tape> tape,
               const Indices& slots) {
                expect_inputs(*tape, 2 * coordinates.size() + inputs.size() + slots.size());
                b.check_slots(slots);
                b.add_force(coordinates, inputs, tape_function(tape, slots));
            },
            "coordinates"_a, "inputs"_a, "tape"_a, "slots"_a,
            "A force along the first coordinate: an expression in all of them, their rates, inputs and numbers.")
        .def(
            "add_python_force",
            [](MechanismBuilder& b, const Indices& coordinates, const Indices& inputs, const nb::object& function,
               int gain) { b.add_force(coordinates, inputs, python_magnitude(function, b.check_slot(gain))); },
            "coordinates"_a, "inputs"_a, "function"_a, "gain"_a,
            "The same with function(y, order) -> (value, gradient, Hessian) in Python, times a number (slot).")
        .def("add_rate_force", &MechanismBuilder::add_rate_force, "variables"_a, "factors"_a, "gain"_a, "input"_a = -1,
             "law_v"_a = -1,
             "A force gain * u * law_v(s') along a sum s' of rates; those of balls are angular velocities.")
        .def(
            "add_wrench",
            [](MechanismBuilder& b, const std::string& kind, int joint, const In<2>& pose,
               const std::array<int, 6>& slots, const std::array<int, 6>& inputs) {
                b.add_wrench(wrench_kind(kind), joint, pose_of(pose), slots, inputs);
            },
            "kind"_a, "joint"_a, "pose"_a, "slots"_a, "inputs"_a,
            "A wrench [force; torque] on a frame; each component a number (slot), an input, or both multiplied.");
}

}  // namespace

void bind_builder(nb::module_& module) {
    nb::class_<MechanismBuilder> builder(module, "MechanismBuilder",
                                         "Collects joints, bodies and elements; build() compiles.");
    builder.def(nb::init<int, int, int>(), "n_dynamic"_a, "n_kinematic"_a, "n_inputs"_a)
        .def(
            "add_joint",
            [](MechanismBuilder& b, int parent, const In<2>& pose, const In<1>& twist, int variable, double factor,
               double offset) {
                expect(twist.size(), 6, "twist");
                const double* s = twist.data();
                return b.add_joint(parent, pose_of(pose), {{s[0], s[1], s[2]}, {s[3], s[4], s[5]}}, variable, factor,
                                   offset);
            },
            "parent"_a, "pose"_a, "twist"_a, "variable"_a, "factor"_a = 1.0, "offset"_a = 0.0)
        .def("couple_joint", &MechanismBuilder::couple_joint, "joint"_a, "variable"_a, "factor"_a,
             "Adds a term to the coordinate of a joint.")
        .def("add_ball", &MechanismBuilder::add_ball, "joint"_a,
             "Makes this joint and the next two, rx, ry and rz, a ball whose rotation is a unit quaternion.")
        .def(
            "add_body",
            [](MechanismBuilder& b, int joint, double mass, const In<1>& com, const In<2>& inertia) {
                b.add_body(joint, body_of(mass, com, inertia));
            },
            "joint"_a, "mass"_a, "com"_a, "inertia"_a)
        .def(
            "add_point",
            [](MechanismBuilder& b, int joint, const In<1>& offset) { return b.add_point(joint, vec3(offset)); },
            "joint"_a, "offset"_a)
        .def(
            "add_direction",
            [](MechanismBuilder& b, int joint, const In<1>& direction) {
                return b.add_direction(joint, vec3(direction));
            },
            "joint"_a, "direction"_a)
        .def("add_number", &MechanismBuilder::add_number, "value"_a)
        .def("time", &MechanismBuilder::time, "Slot of the number that is the time.")
        .def("set_number", &MechanismBuilder::set_number, "slot"_a, "value"_a)
        .def(
            "set_gravity", [](MechanismBuilder& b, const In<1>& g) { return b.set_gravity(vec3(g)); }, "g"_a,
            "Returns the slot of its first component.")
        .def("counts", &MechanismBuilder::counts, "Of the elements that have been added so far.")
        .def("build", [](const MechanismBuilder& b) { return std::const_pointer_cast<Mechanism>(b.build()); })
        .def(
            "build_like",
            [](const MechanismBuilder& b, const Mechanism& other) {
                return std::const_pointer_cast<Mechanism>(b.build_like(other));
            },
            "mechanism"_a, "A mechanism of the same structure with this builder's numbers.");
    bind_coordinates(builder);
    bind_laws(builder);
    bind_elements(builder);
}

}  // namespace leastaction
