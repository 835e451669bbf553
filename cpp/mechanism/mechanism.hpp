// The compiled, immutable mechanism: joints, bodies and elements in the order that the sweeps want.
//
// Joints, in the order in which they are given: first those that carry mass somewhere behind them ("massive"), in depth-first
// preorder, so that a parent stands before its children and a loop over joints is a sweep over the tree; then the massless
// ones (the upper end of a string, say), which only move points.
// Variables: internally the dynamic ones in the order of their joints, then the kinematic ones. This is the elimination
// order of the Newton matrix: eliminating from last to first fills nothing in where a tree is all that couples them.
// `external` maps back to the user's order.
#pragma once

#include <array>
#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include "elements/coordinates.hpp"
#include "elements/forces.hpp"
#include "elements/laws.hpp"
#include "elements/rate_force.hpp"
#include "elements/rotation_vector.hpp"
#include "elements/wrench.hpp"
#include "kinematics/shared_lists.hpp"

namespace leastaction {

// Mass, first moment and rotational inertia (about the centre of mass) of all that is fixed behind a joint.
struct Body {
    double mass = 0;
    Vec3<double> com;
    Sym3<double> inertia;

    bool is_empty() const { return mass == 0 && inertia.xx == 0 && inertia.yy == 0 && inertia.zz == 0; }
};

// A rotor that is geared to variables: T = J/2 (sum factor_k v[variable_k])^2, J and the factors in the mechanism's numbers.
struct Rotor {
    int inertia;                              // slot of J
    std::vector<std::pair<int, int>> geared;  // variable, slot of its factor

    // Calls f(i, dT/dv_i) at velocities v; `at` has the numbers.
    template <class At, class T, class F>
    void each_momentum(const At& at, const T* v, const F& f) const {
        auto rate = at.number(geared[0].second) * v[geared[0].first];
        for (std::size_t k = 1; k < geared.size(); ++k) rate += at.number(geared[k].second) * v[geared[k].first];
        const auto momentum = at.number(inertia) * rate;
        for (const auto& [variable, factor] : geared) f(variable, at.number(factor) * momentum);
    }
};

// A ball joint whose rotation is a unit quaternion: three joints rx, ry, rz in one frame whose variables are the coordinates
// of a chart about that rotation. They are zero wherever it is evaluated; their rates are the body's angular velocity.
struct Ball {
    int variable;     // the first of three, internal
    int quaternion;   // where its four numbers stand in q, behind the variables; internal
    int place;        // and in the user's configuration
    int joint;        // the first of the three
    bool prescribed;  // of three kinematic variables: then a step is given the rotation vector by which it turns
};

class Mechanism : public Constants {
public:
    int n_dynamic = 0, n_kinematic = 0, n_inputs = 0;
    int n_variables() const { return n_dynamic + n_kinematic; }
    int n_constraints() const { return static_cast<int>(constraints.size()); }
    int n_coordinates() const { return n_variables() + 4 * static_cast<int>(balls.size()); }  // of an internal q
    int n_configuration() const { return n_variables() + static_cast<int>(balls.size()); }    // of the user's
    int n_states() const { return n_configuration() + n_variables(); }
    int n_tangent() const { return 2 * n_variables(); }  // of differences of states
    int n_controls() const { return n_inputs + n_kinematic; }

    Vec3<double> gravity;
    int gravity_slot = -1;  // where its three numbers are; -1: there is none
    int n_massive = 0;
    std::vector<Body> bodies;   // by massive joint
    std::vector<int> external;  // internal variable -> user's
    std::vector<int> internal;  // user's variable -> internal
    bool same_order = true;     // internal and user's order agree
    std::vector<Ball> balls;
    std::vector<int> places;     // internal variable -> the user's configuration, but for those of balls
    bool plain = true;           // the coordinate of every massive joint is a variable of its own
    double fixed_potential = 0;  // of masses fixed in the world

    // By massive joint: its path from the root, itself last; and that path as few runs [first, last) of joints.
    SharedLists path;
    std::vector<std::vector<std::pair<int, int>>> runs;
    // By dynamic variable k: the earlier variables that its column couples to (with fill-in).
    SharedLists coupled;
    bool only_tree_couples = true;  // no potential, force or rotor couples two dynamic variables
    bool rotors_couple = false;     // one of them does
    std::vector<Rotor> rotors;

    // Shared by all mechanisms of the same structure: their numbers are in Constants.
    std::vector<std::shared_ptr<const ConfigurationFunction>> constraints, potentials;
    std::vector<std::shared_ptr<const GeneralizedForce>> forces;
    std::vector<std::pair<int, int>> damping;       // f_i = -c v_i: variable, slot of c
    std::vector<std::pair<int, int>> joint_forces;  // f_i = u_a: variable, input
    bool has_elements_at_middle() const {           // of a step, where potentials and these act
        return !potentials.empty() || !forces.empty() || !damping.empty() || !joint_forces.empty();
    }
    // Of a mechanism as it was built none of these; see at_instants().
    std::vector<std::shared_ptr<const GeneralizedForce>> instant_forces;
    std::vector<std::pair<int, int>> instant_joint_forces;

    std::vector<int> massive_joints;  // 0 .. n_massive - 1
    // All joints that constraints look at, ascending; those that a dynamic variable moves, and those that none does.
    std::vector<int> constraint_joints, free_constraint_joints, prescribed_constraint_joints;
    // Massless joints that potentials and forces look at (the others are placed anyway); all that forces look at.
    std::vector<int> massless_joints_seen, force_joints;
    std::vector<int> element_joints;  // all that potentials and forces look at
    std::vector<int> instant_joints;  // all that forces at the instants look at
};

// The same mechanism with other numbers of its elements, all of them by slot. Throws std::invalid_argument where there are
// as many no longer, or those of gravity change, which fixed masses keep as a potential.
std::shared_ptr<const Mechanism> with_numbers(const Mechanism& mechanism, std::vector<double> numbers);
// The same with other bodies, each at its joint (-1: the world). Throws std::invalid_argument where other joints have any.
std::shared_ptr<const Mechanism> with_bodies(const Mechanism& mechanism,
                                             const std::vector<std::pair<int, Body>>& bodies);

// The same mechanism for steps in which the forces of some inputs act at the instants, with none of the velocity, as those
// of constraints do. Throws std::invalid_argument where a force has such inputs and others.
std::shared_ptr<const Mechanism> at_instants(const Mechanism& mechanism, const std::vector<int>& inputs);

// Whether nothing changes its place when a joint turns: a wheel or rotor that is round about its axis, with nothing behind it
// and no element that looks at it or at its angle.
bool turns_in_place(const Mechanism& mechanism, int joint);

// The number one, which multiplies at no cost.
struct One {};
inline double operator*(One, double x) { return x; }

// The inertias of rotors stand behind the pairs of joints in the planes of second derivatives by velocity twice: how many
// entries a plane has, and what writes those of the rotors.
inline std::size_t pair_entries(const Mechanism& m, std::size_t stride) {
    return m.n_massive * stride + m.rotors.size();
}
inline void put_rotors(const Mechanism& m, std::vector<double>& plane) {
    double* at = plane.data() + plane.size() - m.rotors.size();
    for (const Rotor& rotor : m.rotors) *at++ = m.numbers[rotor.inertia];
}

// Calls f(variable, inertia) with what each rotor adds to the inertia of each of its variables alone.
template <class F>
void each_rotor_inertia(const Mechanism& m, const F& f) {
    for (const Rotor& rotor : m.rotors)
        for (const auto& [variable, slot] : rotor.geared)
            f(variable, m.numbers[rotor.inertia] * m.numbers[slot] * m.numbers[slot]);
}

// Calls f(i, j, at, weight, mirrored) for every pair of variables that a pair of massive joints or a rotor couples: their
// second derivatives are `weight` times those at index `at` of the pair planes; mirrored, once more for (j, i), where the two
// mixed planes change places.
template <class F>
void each_pair(const Mechanism& m, std::size_t stride, const F& f) {
    for (int joint = 0; joint < m.n_massive; ++joint) {
        const Joint& a = m.joints[joint];
        if (m.plain)
            for (const int ancestor : m.path[joint])
                f(a.variable, m.joints[ancestor].variable, joint * stride + ancestor, One{}, joint != ancestor);
        else
            for (const int ancestor : m.path[joint])
                a.each_term([&](int i, double factor_i) {
                    m.joints[ancestor].each_term([&](int j, double factor_j) {
                        f(i, j, joint * stride + ancestor, factor_i * factor_j, joint != ancestor);
                    });
                });
    }
    std::size_t at = m.n_massive * stride;
    for (const Rotor& rotor : m.rotors) {
        for (std::size_t a = 0; a < rotor.geared.size(); ++a)
            for (std::size_t b = 0; b <= a; ++b) {
                const auto& [i, factor_i] = rotor.geared[a];
                const auto& [j, factor_j] = rotor.geared[b];
                f(i, j, at, m.numbers[factor_i] * m.numbers[factor_j], a != b);
            }
        ++at;
    }
}

// How many parts of each kind the elements of a mechanism came to.
struct ElementCounts {
    int potentials = 0, constraints = 0, forces = 0, damping = 0, joint_forces = 0;
};
// The parts that one element came to, or all.
struct ElementParts {
    ElementCounts first, last;
};

class MechanismBuilder {
public:
    MechanismBuilder(int n_dynamic, int n_kinematic, int n_inputs);

    // All methods that return a number return an index to name the thing by.
    int add_joint(int parent, const Pose<double>& base, const Motion<double>& twist, int variable, double factor,
                  double offset);
    void couple_joint(int joint, int variable, double factor);  // one more term of its coordinate
    void add_ball(int joint);  // this joint and the next two are a ball's, and turn behind a rotation of its own
    void add_body(int joint, const Body& body);
    int add_point(int joint, const Vec3<double>& offset);
    int set_gravity(const Vec3<double>& g);  // slot of its first component
    int add_direction(int joint, const Vec3<double>& direction);
    int add_number(double value);
    int time();  // slot of the number that is the time
    void set_number(int slot, double value);

    int combination(std::vector<int> variables, std::vector<int> factor_slots);
    int path(std::vector<int> points);
    int rotation(int variable);  // of a ball: the component of its rotation vector that the variable turns about
    int local(std::vector<int> points, std::vector<int> directions, std::vector<int> variables,
              std::shared_ptr<const LocalFunction> function);
    int offset(int coordinate, int slot, int variable);  // a coordinate less a number, a variable, or both
    int sum(std::vector<int> coordinates, std::vector<int> factor_slots);
    int law_of(int coordinate, int law);  // law(s)
    int add_law(std::shared_ptr<const Law> law);

    int add_distance(int point1, int point2, double length, int variable);  // slot of the length, or -1
    void add_coincidence(int point1, int point2, const Vec3<double>& direction);
    void add_constraint(int coordinate, int slot, int variable);
    void add_potential(int coordinate, int law);
    void add_rotor(const std::vector<int>& variables, const std::vector<int>& factor_slots, int inertia_slot);
    int add_damping(int variable, double coefficient);
    void add_joint_force(int variable, int input);
    void add_force(std::vector<int> coordinates, std::vector<int> inputs,
                   std::shared_ptr<const LocalFunction> magnitude);
    // Along a sum of rates, where those of balls are angular velocities: gain u by_rate(s').
    void add_rate_force(const std::vector<int>& variables, const std::vector<int>& factor_slots, int gain_slot,
                        int input, int law);
    void add_wrench(Wrench::Kind kind, int joint, const Pose<double>& frame, const std::array<int, 6>& slots,
                    const std::array<int, 6>& inputs);

    ElementCounts counts() const {
        const auto size = [](const auto& list) { return static_cast<int>(list.size()); };
        return {size(potentials_), size(constraints_), size(forces_), size(damping_), size(joint_forces_)};
    }

    // Throws std::invalid_argument where the description is not a mechanism.
    std::shared_ptr<const Mechanism> build() const;
    // A mechanism of the structure of another, which the same calls built, with the numbers of this builder.
    std::shared_ptr<const Mechanism> build_like(const Mechanism& other) const;

    // Checks that return what they are given.
    int check_input(int input) const;
    int check_slot(int slot) const;
    void check_slots(const std::vector<int>& slots) const;
    std::shared_ptr<const Law> law(int index) const;

private:
    // Elements are made when the order of joints and variables is settled, from the coordinates made before.
    using Coordinates = std::vector<std::shared_ptr<const ConfigurationFunction>>;
    using Maker = std::function<std::shared_ptr<const ConfigurationFunction>(const Mechanism&, const Coordinates&)>;

    int check_joint(int joint) const;
    int check_variable(int variable) const;
    int check_point(int point) const;
    int check_coordinate(int coordinate) const;

    void set_numbers(Mechanism& m) const;
    int count_massive() const;
    void order_variables(Mechanism& m) const;

    int n_dynamic_, n_kinematic_, n_inputs_;
    int gravity_slot_ = -1, time_slot_ = -1;
    std::vector<Joint> joints_;
    std::vector<int> balls_;  // first joints
    std::vector<std::pair<int, Body>> bodies_;
    std::vector<Point> points_, directions_;
    std::vector<double> numbers_;
    std::vector<std::shared_ptr<const Law>> laws_;
    std::vector<Maker> coordinates_, constraints_, potentials_;
    std::vector<std::function<std::shared_ptr<const GeneralizedForce>(const Mechanism&, const Coordinates&)>> forces_;
    std::vector<std::pair<int, int>> damping_, joint_forces_;
    std::vector<Rotor> rotors_;  // of the user's variables
};

}  // namespace leastaction
