// The compiled, immutable mechanism: joints, bodies and elements in the order that the sweeps want.
//
// Joints: first those that carry mass somewhere behind them ("massive"), in depth-first preorder, so that a parent
// stands before its children and a loop over joints is a sweep over the tree; then the massless ones (the upper end of a
// string, say), which only move points.
// Variables: internally the dynamic ones in the order of their joints, then the kinematic ones. This is the elimination
// order of the Newton matrix: eliminating from last to first fills nothing in. `external` maps back to the user's order.
#pragma once

#include <memory>
#include <utility>
#include <vector>

#include "elements.hpp"

namespace leastaction {

// Mass, first moment and rotational inertia (about the centre of mass) of all that is fixed behind a joint.
struct Body {
    double mass = 0;
    Vec3<double> com;
    Sym3<double> inertia;

    bool is_empty() const { return mass == 0 && inertia.xx == 0 && inertia.yy == 0 && inertia.zz == 0; }
};

class Mechanism {
public:
    Mechanism() = default;
    Mechanism(const Mechanism&) = delete;
    Mechanism& operator=(const Mechanism&) = delete;

    int n_dynamic = 0, n_kinematic = 0, n_inputs = 0;
    int n_variables() const { return n_dynamic + n_kinematic; }
    int n_constraints() const { return static_cast<int>(constraints.size()); }
    int n_states() const { return 2 * n_variables(); }
    int n_controls() const { return n_inputs + n_kinematic; }

    Vec3<double> gravity;
    std::vector<Joint> joints;
    int n_massive = 0;
    std::vector<Body> bodies;           // by massive joint
    std::vector<int> joint_of_builder;  // builder's joint number -> joint
    std::vector<int> external;          // internal variable -> user's
    std::vector<int> internal;          // user's variable -> internal
    bool same_order = true;             // internal and user's order agree
    double fixed_potential = 0;         // of masses fixed in the world

    // By massive joint: its path from the root, itself last; and that path as few runs [first, last) of joints.
    std::vector<std::vector<int>> path;
    std::vector<std::vector<std::pair<int, int>>> runs;
    // By dynamic variable k: the earlier variables that its column couples to (with fill-in).
    std::vector<std::vector<int>> coupled;

    std::vector<std::unique_ptr<ConfigurationFunction>> constraints, potentials;
    std::vector<std::unique_ptr<GeneralizedForce>> forces;
    std::vector<int> massive_joints;  // 0 .. n_massive - 1
    // All joints that constraints look at, ascending; those that a dynamic variable moves, and those that none does.
    std::vector<int> constraint_joints, free_constraint_joints, prescribed_constraint_joints;
};

class MechanismBuilder {
public:
    MechanismBuilder(int n_dynamic, int n_kinematic, int n_inputs);

    int add_joint(int parent, const Pose<double>& base, const Motion<double>& twist, int variable);
    void add_body(int joint, const Body& body);
    int add_point(int joint, const Vec3<double>& offset);
    void set_gravity(const Vec3<double>& g);
    void add_distance(int point1, int point2, double length, int variable);
    void add_coincidence(int point1, int point2, const Vec3<double>& direction);
    void add_damping(int variable, double coefficient);
    void add_joint_force(int variable, int input);

    // Throws std::invalid_argument where the description is not a mechanism.
    std::shared_ptr<const Mechanism> build() const;

private:
    // Two points at a distance, or coincident along a direction.
    struct RawPair {
        int point1, point2;
        double length;
        int variable;
        bool coincide;
        Vec3<double> direction;
    };
    void check_points(int point1, int point2) const;
    int check_joint(int joint) const;
    int check_variable(int variable) const;

    int n_dynamic_, n_kinematic_, n_inputs_;
    Vec3<double> gravity_;
    std::vector<Joint> joints_;
    std::vector<std::pair<int, Body>> bodies_;
    std::vector<Point> points_;
    std::vector<RawPair> pairs_;  // in the order of the constraints
    std::vector<std::pair<int, double>> damping_;
    std::vector<std::pair<int, int>> joint_forces_;
};

}  // namespace leastaction
