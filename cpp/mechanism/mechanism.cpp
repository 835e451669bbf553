#include "mechanism/mechanism.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <set>
#include <stdexcept>
#include <string>

#include "elements/constraints.hpp"
#include "elements/potentials.hpp"

namespace leastaction {

namespace {

// Two bodies fixed to each other are one body: moments add about the common centre of mass.
Body merged(const Body& a, const Body& b) {
    Body out;
    out.mass = a.mass + b.mass;
    if (out.mass == 0) {
        out = a;
    } else {
        out.com = (1.0 / out.mass) * (a.mass * a.com + b.mass * b.com);
    }
    out.inertia = Sym3<double>{};
    for (const Body* body : {&a, &b}) {
        const Vec3<double> r = body->com - out.com;
        const double m = body->mass;
        out.inertia.xx += body->inertia.xx + m * (r.y * r.y + r.z * r.z);
        out.inertia.yy += body->inertia.yy + m * (r.x * r.x + r.z * r.z);
        out.inertia.zz += body->inertia.zz + m * (r.x * r.x + r.y * r.y);
        out.inertia.xy += body->inertia.xy - m * r.x * r.y;
        out.inertia.xz += body->inertia.xz - m * r.x * r.z;
        out.inertia.yz += body->inertia.yz - m * r.y * r.z;
    }
    return out;
}

bool is_identity(const Mat3<double>& R) {
    return R.c0.x == 1 && R.c0.y == 0 && R.c0.z == 0 && R.c1.x == 0 && R.c1.y == 1 && R.c1.z == 0 && R.c2.x == 0 &&
           R.c2.y == 0 && R.c2.z == 1;
}

// The runs of a path, from those of the path without its last joint; small gaps are bridged, because the pair products are
// done several lanes at a time anyway.
void add_to_runs(std::vector<std::pair<int, int>>& runs, int joint) {
    constexpr int bridged_gap = 8;
    if (!runs.empty() && joint - runs.back().second <= bridged_gap)
        runs.back().second = joint + 1;
    else
        runs.emplace_back(joint, joint + 1);
}

// Which entries of the lower triangle are non-zero when the variables are eliminated from last to first; `earlier[k]`
// ascending, the variables before k that it meets at the start.
SharedLists eliminate(std::vector<std::vector<int>> earlier) {
    std::vector<int> both;
    for (int k = static_cast<int>(earlier.size()) - 1; k >= 0; --k) {
        if (earlier[k].empty()) continue;
        // The last of them meets the others when k is gone; through it the fill travels down.
        std::vector<int>& last = earlier[earlier[k].back()];
        both.clear();
        std::set_union(last.begin(), last.end(), earlier[k].begin(), earlier[k].end() - 1, std::back_inserter(both));
        last.assign(both.begin(), both.end());
    }
    SharedLists out;
    for (const std::vector<int>& list : earlier) out.add(list, list.empty() ? -1 : list.back());
    return out;
}

int checked(int index, std::size_t count, const char* what) {
    if (index < 0 || index >= static_cast<int>(count))
        throw std::invalid_argument(std::string("no ") + what + " " + std::to_string(index));
    return index;
}

// Adds to a list and returns the index there.
template <class T, class Added>
int append(std::vector<T>& list, Added&& added) {
    list.push_back(std::forward<Added>(added));
    return static_cast<int>(list.size()) - 1;
}

void note_coupled_variables(Mechanism& m) {
    const auto by_elements = [&](const auto& f) {
        const auto each = [&](const std::vector<int>& support) {
            for (const int a : support)
                for (const int b : support)
                    if (b < a && a < m.n_dynamic) f(a, b);
        };
        for (const auto& potential : m.potentials) each(potential->support());
        for (const auto& force : m.forces) each(force->support());
    };
    const auto by_rotors = [&](const auto& f) {
        for (const Rotor& rotor : m.rotors)
            for (const auto& a : rotor.geared)
                for (const auto& b : rotor.geared)
                    if (b.first < a.first && a.first < m.n_dynamic) f(a.first, b.first);
    };
    m.coupled = {};
    m.rotors_couple = false;
    by_rotors([&](int, int) { m.rotors_couple = true; });
    m.only_tree_couples = !m.rotors_couple;
    by_elements([&](int a, int b) {
        const auto has_both = [&](const Ball& ball) { return ball.variable <= b && a < ball.variable + 3; };
        if (std::ranges::none_of(m.balls, has_both)) m.only_tree_couples = false;
    });
    if (m.plain && m.only_tree_couples) {
        // Each variable meets those of the joints above its own: those of the nearest one, and that one itself.
        std::vector<int> nearest(m.n_massive, -1);  // by joint: its dynamic variable, or that of the next joint above
        for (int i = 0; i < m.n_massive; ++i) {
            const Joint& joint = m.joints[i];
            nearest[i] = joint.parent < 0 ? -1 : nearest[joint.parent];
            if (joint.variable >= m.n_dynamic) continue;
            if (nearest[i] < 0)
                m.coupled.add({}, -1);
            else
                m.coupled.extend(nearest[i], nearest[i]);
            nearest[i] = joint.variable;
        }
        return;
    }
    std::vector<std::vector<int>> earlier(m.n_dynamic);
    const auto meet = [&](int a, int b) {
        if (a != b && std::max(a, b) < m.n_dynamic) earlier[std::max(a, b)].push_back(std::min(a, b));
    };
    for (int i = 0; i < m.n_massive; ++i)
        for (const int j : m.path[i])
            m.joints[i].each_term([&](int a, double) { m.joints[j].each_term([&](int b, double) { meet(a, b); }); });
    by_rotors(meet);
    by_elements(meet);
    for (std::vector<int>& list : earlier) {
        std::sort(list.begin(), list.end());
        list.erase(std::unique(list.begin(), list.end()), list.end());
    }
    m.coupled = eliminate(std::move(earlier));
}

// The joints of some elements, ascending.
template <class Elements>
std::vector<int> joints_of(const Elements& elements) {
    std::set<int> out;
    for (const auto& element : elements) out.insert(element->joints().begin(), element->joints().end());
    return {out.begin(), out.end()};
}

void note_what_elements_see(Mechanism& m) {
    m.constraint_joints = joints_of(m.constraints);
    m.force_joints = joints_of(m.forces);
    m.instant_joints = joints_of(m.instant_forces);
    for (auto* list :
         {&m.element_joints, &m.massless_joints_seen, &m.free_constraint_joints, &m.prescribed_constraint_joints})
        list->clear();
    std::ranges::set_union(m.force_joints, joints_of(m.potentials), std::back_inserter(m.element_joints));
    for (const int joint : m.element_joints)
        if (joint >= m.n_massive) m.massless_joints_seen.push_back(joint);
    std::vector<char> free(m.joints.size());  // parents come first
    for (std::size_t j = 0; j < free.size(); ++j) {
        free[j] = m.joints[j].parent >= 0 && free[m.joints[j].parent];
        m.joints[j].each_term([&](int variable, double) { free[j] = free[j] || variable < m.n_dynamic; });
    }
    for (const int joint : m.constraint_joints)
        (free[joint] ? m.free_constraint_joints : m.prescribed_constraint_joints).push_back(joint);
}

std::vector<int> internal_of(const Mechanism& m, const std::vector<int>& variables) {
    std::vector<int> out;
    for (const int variable : variables) out.push_back(m.internal[variable]);
    return out;
}

}  // namespace

MechanismBuilder::MechanismBuilder(int n_dynamic, int n_kinematic, int n_inputs)
    : n_dynamic_(n_dynamic), n_kinematic_(n_kinematic), n_inputs_(n_inputs) {
    if (n_dynamic < 0 || n_kinematic < 0 || n_inputs < 0)
        throw std::invalid_argument("numbers of variables and inputs must not be negative");
}

int MechanismBuilder::check_joint(int joint) const {
    return joint == -1 ? -1 : checked(joint, joints_.size(), "joint");
}
int MechanismBuilder::check_variable(int variable) const {
    for (const int joint : balls_) {
        const int turned = variable - joints_[joint].variable;
        if (turned >= 0 && turned < 3)
            throw std::invalid_argument("the turns of a rotation that is a quaternion are no coordinates to act on");
    }
    return checked(variable, n_dynamic_ + n_kinematic_, "configuration variable");
}
int MechanismBuilder::check_point(int point) const { return checked(point, points_.size(), "point"); }
int MechanismBuilder::check_input(int input) const { return checked(input, n_inputs_, "input"); }
int MechanismBuilder::check_slot(int slot) const { return checked(slot, numbers_.size(), "number"); }
void MechanismBuilder::check_slots(const std::vector<int>& slots) const {
    for (const int slot : slots) check_slot(slot);
}
int MechanismBuilder::check_coordinate(int coordinate) const {
    return checked(coordinate, coordinates_.size(), "coordinate");
}
std::shared_ptr<const Law> MechanismBuilder::law(int index) const {
    return index < 0 ? nullptr : laws_[checked(index, laws_.size(), "law")];
}

int MechanismBuilder::add_joint(int parent, const Pose<double>& base, const Motion<double>& twist, int variable,
                                double factor, double offset) {
    Joint joint;
    joint.parent = check_joint(parent);
    joint.variable = check_variable(variable);
    joint.factor = factor;
    joint.offset = offset;
    joint.simple = factor == 1.0 && offset == 0.0;
    joint.base = base;
    joint.twist = twist;
    joint.axis = axis_of(twist);
    joint.base_rotates = !is_identity(base.R);
    return append(joints_, joint);
}
void MechanismBuilder::couple_joint(int joint, int variable, double factor) {
    if (joint < 0) throw std::invalid_argument("the world has no coordinate to couple");
    Joint& coupled = joints_[check_joint(joint)];
    coupled.more.push_back({check_variable(variable), factor});
    coupled.simple = false;
}
void MechanismBuilder::add_ball(int joint) {
    check_joint(joint);
    const int last = joint + 2;
    const auto stands_there = [](const Joint& of) {
        const Vec3<double>& p = of.base.p;
        return !of.base_rotates && p.x == 0 && p.y == 0 && p.z == 0;
    };
    bool fits = joint >= 0 && last < static_cast<int>(joints_.size());
    for (int j = joint; fits && j <= last; ++j) {
        const Joint& of = joints_[j];
        fits = of.simple && of.more.empty() && of.axis == static_cast<Axis>(j - joint) &&
               (of.variable < n_dynamic_) == (joints_[joint].variable < n_dynamic_) &&
               of.variable == joints_[joint].variable + j - joint &&
               (j == joint || (of.parent == j - 1 && stands_there(of)));
    }
    if (!fits)
        throw std::invalid_argument("a ball is three joints rx, ry, rz in a row, with variables of one kind in a row");
    balls_.push_back(joint);
}
void MechanismBuilder::add_body(int joint, const Body& body) { bodies_.emplace_back(check_joint(joint), body); }
int MechanismBuilder::add_point(int joint, const Vec3<double>& offset) {
    return append(points_, Point{check_joint(joint), offset});
}
int MechanismBuilder::add_direction(int joint, const Vec3<double>& direction) {
    return append(directions_, Point{check_joint(joint), direction});
}
int MechanismBuilder::add_number(double value) { return append(numbers_, value); }
int MechanismBuilder::time() {
    if (time_slot_ < 0) time_slot_ = add_number(0.0);
    return time_slot_;
}
void MechanismBuilder::set_number(int slot, double value) { numbers_[check_slot(slot)] = value; }
int MechanismBuilder::set_gravity(const Vec3<double>& g) {
    gravity_slot_ = add_number(g.x);
    add_number(g.y);
    add_number(g.z);
    return gravity_slot_;
}

int MechanismBuilder::combination(std::vector<int> variables, std::vector<int> factor_slots) {
    if (variables.empty() || variables.size() != factor_slots.size())
        throw std::invalid_argument("one factor for each of at least one variable is needed");
    for (const int variable : variables) check_variable(variable);
    check_slots(factor_slots);
    return append(coordinates_, [variables, factor_slots](const Mechanism& m, const Coordinates&) {
        return std::make_shared<Combination>(internal_of(m, variables), factor_slots);
    });
}
int MechanismBuilder::path(std::vector<int> points) {
    if (points.size() < 2) throw std::invalid_argument("a path needs two points at least");
    for (const int point : points) check_point(point);
    return append(coordinates_,
                  [points](const Mechanism& m, const Coordinates&) { return std::make_shared<PathLength>(m, points); });
}
int MechanismBuilder::rotation(int variable) {
    checked(variable, n_dynamic_ + n_kinematic_, "variable");
    return append(coordinates_, [=](const Mechanism& m, const Coordinates&) {
        const int own = m.internal[variable];
        for (const Ball& ball : m.balls)
            if (ball.variable <= own && own < ball.variable + 3)
                return std::make_shared<RotationVector>(ball.variable, ball.quaternion, own - ball.variable);
        throw std::invalid_argument("variable " + std::to_string(variable) + " is none of a ball");
    });
}
int MechanismBuilder::local(std::vector<int> points, std::vector<int> directions, std::vector<int> variables,
                            std::shared_ptr<const LocalFunction> function) {
    for (const int point : points) check_point(point);
    for (const int variable : variables) check_variable(variable);
    for (const int direction : directions) checked(direction, directions_.size(), "direction");
    return append(coordinates_, [=](const Mechanism& m, const Coordinates&) {
        return std::make_shared<LocalCoordinate>(m, points, directions, internal_of(m, variables), function);
    });
}
int MechanismBuilder::offset(int coordinate, int slot, int variable) {
    check_coordinate(coordinate);
    if (slot >= 0) check_slot(slot);
    if (variable >= 0) check_variable(variable);
    return append(coordinates_, [=](const Mechanism& m, const Coordinates& made) {
        return std::make_shared<OffsetCoordinate>(made[coordinate], slot, variable < 0 ? -1 : m.internal[variable]);
    });
}
int MechanismBuilder::sum(std::vector<int> coordinates, std::vector<int> factor_slots) {
    if (coordinates.empty() || coordinates.size() != factor_slots.size())
        throw std::invalid_argument("one factor for each of at least one coordinate is needed");
    for (const int coordinate : coordinates) check_coordinate(coordinate);
    check_slots(factor_slots);
    return append(coordinates_, [=](const Mechanism&, const Coordinates& made) {
        Coordinates own;
        for (const int coordinate : coordinates) own.push_back(made[coordinate]);
        return std::make_shared<SumOfCoordinates>(own, factor_slots);
    });
}
int MechanismBuilder::law_of(int coordinate, int law) {
    check_coordinate(coordinate);
    return append(coordinates_, [coordinate, law = this->law(law)](const Mechanism&, const Coordinates& made) {
        return std::make_shared<Potential>(made[coordinate], law);
    });
}
int MechanismBuilder::add_law(std::shared_ptr<const Law> law) { return append(laws_, std::move(law)); }

int MechanismBuilder::add_distance(int point1, int point2, double length, int variable) {
    check_point(point1);
    check_point(point2);
    const int slot = variable < 0 ? add_number(length) : -1;
    if (variable >= 0) check_variable(variable);
    constraints_.push_back([=](const Mechanism& m, const Coordinates&) {
        return std::make_shared<Distance>(m, point1, point2, slot, variable < 0 ? -1 : m.internal[variable]);
    });
    return slot;
}
void MechanismBuilder::add_coincidence(int point1, int point2, const Vec3<double>& direction) {
    check_point(point1);
    check_point(point2);
    constraints_.push_back([=](const Mechanism& m, const Coordinates&) {
        return std::make_shared<Coincidence>(m, point1, point2, direction);
    });
}
void MechanismBuilder::add_constraint(int coordinate, int slot, int variable) {
    const int held = offset(coordinate, slot, variable);
    constraints_.push_back([held](const Mechanism&, const Coordinates& coordinates) { return coordinates[held]; });
}
void MechanismBuilder::add_potential(int coordinate, int law) {
    check_coordinate(coordinate);
    potentials_.push_back([coordinate, energy = this->law(law)](const Mechanism&, const Coordinates& coordinates) {
        return std::make_shared<Potential>(coordinates[coordinate], energy);
    });
}
void MechanismBuilder::add_rotor(const std::vector<int>& variables, const std::vector<int>& factor_slots,
                                 int inertia_slot) {
    if (variables.empty() || variables.size() != factor_slots.size())
        throw std::invalid_argument("one factor for each of at least one variable is needed");
    Rotor rotor{check_slot(inertia_slot), {}};
    for (std::size_t k = 0; k < variables.size(); ++k)
        rotor.geared.emplace_back(check_variable(variables[k]), check_slot(factor_slots[k]));
    rotors_.push_back(std::move(rotor));
}
int MechanismBuilder::add_damping(int variable, double coefficient) {
    if (check_variable(variable) >= n_dynamic_) throw std::invalid_argument("damping acts on dynamic variables only");
    damping_.emplace_back(variable, add_number(coefficient));
    return damping_.back().second;
}
void MechanismBuilder::add_joint_force(int variable, int input) {
    if (check_variable(variable) >= n_dynamic_) throw std::invalid_argument("forces act on dynamic variables only");
    joint_forces_.emplace_back(variable, check_input(input));
}
void MechanismBuilder::add_force(std::vector<int> coordinates, std::vector<int> inputs,
                                 std::shared_ptr<const LocalFunction> magnitude) {
    if (coordinates.empty()) throw std::invalid_argument("a force acts along one coordinate at least");
    for (const int coordinate : coordinates) check_coordinate(coordinate);
    for (const int input : inputs) check_input(input);
    forces_.push_back([=](const Mechanism&, const Coordinates& all) {
        Coordinates own;
        for (const int coordinate : coordinates) own.push_back(all[coordinate]);
        return std::make_shared<CoordinateForce>(own, inputs, magnitude);
    });
}
void MechanismBuilder::add_rate_force(const std::vector<int>& variables, const std::vector<int>& factor_slots,
                                      int gain_slot, int input, int law) {
    if (variables.empty() || variables.size() != factor_slots.size())
        throw std::invalid_argument("one factor for each of at least one variable is needed");
    for (const int variable : variables) checked(variable, n_dynamic_ + n_kinematic_, "variable");
    check_slots(factor_slots);
    check_slot(gain_slot);
    if (input >= 0) check_input(input);
    forces_.push_back([=, by_rate = this->law(law)](const Mechanism& m, const Coordinates&) {
        std::vector<int> firsts;
        for (const Ball& ball : m.balls) firsts.push_back(ball.variable);
        return std::make_shared<RateForce>(internal_of(m, variables), factor_slots, firsts, gain_slot, input, by_rate);
    });
}
void MechanismBuilder::add_wrench(Wrench::Kind kind, int joint, const Pose<double>& frame,
                                  const std::array<int, 6>& slots, const std::array<int, 6>& inputs) {
    for (int c = 0; c < 6; ++c) {
        if (slots[c] >= 0) check_slot(slots[c]);
        if (inputs[c] >= 0) check_input(inputs[c]);
    }
    const int point = add_point(joint, frame.p);
    const std::array<int, 3> axes{add_direction(joint, frame.R.c0), add_direction(joint, frame.R.c1),
                                  add_direction(joint, frame.R.c2)};
    forces_.push_back([=](const Mechanism& m, const Coordinates&) {
        return std::make_shared<Wrench>(m, kind, m.points[point].joint, point, axes, slots, inputs);
    });
}

// How many joints carry mass somewhere behind them; checks that these are the first, and in depth-first preorder.
int MechanismBuilder::count_massive() const {
    const int nj = static_cast<int>(joints_.size());
    std::vector<char> massive(nj, 0);
    for (const auto& [joint, body] : bodies_)
        if (joint >= 0 && !body.is_empty()) massive[joint] = 1;
    for (int j = nj - 1; j >= 0; --j)
        if (massive[j] && joints_[j].parent >= 0) massive[joints_[j].parent] = 1;
    const int count = static_cast<int>(std::count(massive.begin(), massive.end(), 1));
    for (int j = 0; j < count; ++j) {
        int place = massive[j] ? j - 1 : -2;
        while (place >= 0 && place != joints_[j].parent) place = joints_[place].parent;
        if (place != joints_[j].parent)
            throw std::invalid_argument("joint " + std::to_string(j) +
                                        ": joints with a mass behind them come first, in depth-first preorder");
    }
    return count;
}

// Dynamic variables in the order of their joints (those that move no mass, which no step can be made with, last), kinematic
// ones as the user has them.
void MechanismBuilder::order_variables(Mechanism& m) const {
    const int nq = n_dynamic_ + n_kinematic_;
    std::vector<char> has_joint(nq, 0);
    for (int i = 0; i < m.n_massive; ++i)
        joints_[i].each_term([&](int variable, double factor) {
            m.plain = m.plain && !has_joint[variable] && factor == 1.0;
            if (variable < n_dynamic_ && !has_joint[variable]) m.external.push_back(variable);
            has_joint[variable] = 1;
        });
    for (int i = 0; i < m.n_massive; ++i) m.plain = m.plain && joints_[i].more.empty();
    for (int variable = 0; variable < n_dynamic_; ++variable)
        if (!has_joint[variable]) {
            m.external.push_back(variable);
            m.plain = false;
        }
    for (int variable = n_dynamic_; variable < nq; ++variable) m.external.push_back(variable);
    m.internal.resize(nq);
    for (int i = 0; i < nq; ++i) {
        m.internal[m.external[i]] = i;
        m.same_order = m.same_order && m.external[i] == i;
    }
    m.places = m.external;
    for (const int joint : balls_) {
        const int variable = joints_[joint].variable;
        for (int i = 0; i < nq; ++i) m.places[i] += m.external[i] > variable;
    }
    for (const int joint : balls_) {
        const int first = m.internal[joints_[joint].variable];
        const bool prescribed = first >= n_dynamic_;
        if (!prescribed && joint + 2 >= m.n_massive) throw std::invalid_argument("a ball that moves no mass");
        m.balls.push_back({first, nq + 4 * static_cast<int>(m.balls.size()), m.places[first], joint, prescribed});
    }
}

// Everything that may change while the structure stays.
static void set_bodies(Mechanism& m, const std::vector<std::pair<int, Body>>& bodies) {
    m.bodies.assign(m.n_massive, Body{});
    m.fixed_potential = 0;
    for (const auto& [joint, body] : bodies) {
        if (joint < 0) {
            m.fixed_potential -= body.mass * dot(m.gravity, body.com);
        } else if (!body.is_empty()) {
            Body& sum = m.bodies.at(joint);
            sum = sum.is_empty() ? body : merged(sum, body);
        }
    }
}

void MechanismBuilder::set_numbers(Mechanism& m) const {
    m.numbers = numbers_;
    m.gravity_slot = gravity_slot_;
    m.time_slot = time_slot_;
    if (gravity_slot_ >= 0) {
        const double* g = m.numbers.data() + gravity_slot_;
        m.gravity = {g[0], g[1], g[2]};
    }
    m.points = points_;
    m.directions = directions_;
    m.joints = joints_;
    for (Joint& joint : m.joints) {
        joint.variable = m.internal[joint.variable];
        for (Term& term : joint.more) term.variable = m.internal[term.variable];
    }
    m.has_quaternions = !balls_.empty();
    for (std::size_t b = 0; b < balls_.size(); ++b) {
        m.joints[balls_[b]].axis = Axis::screw;
        m.joints[balls_[b]].quaternion = m.balls[b].quaternion;
    }
    set_bodies(m, bodies_);
}

std::shared_ptr<const Mechanism> MechanismBuilder::build() const {
    auto m = std::make_shared<Mechanism>();
    m->n_dynamic = n_dynamic_;
    m->n_kinematic = n_kinematic_;
    m->n_inputs = n_inputs_;
    m->n_massive = count_massive();
    order_variables(*m);
    set_numbers(*m);

    for (int i = 0; i < m->n_massive; ++i) {
        const int parent = m->joints[i].parent;
        m->massive_joints.push_back(i);
        m->path.extend(parent, i);
        m->runs.push_back(parent < 0 ? std::vector<std::pair<int, int>>{} : m->runs[parent]);
        add_to_runs(m->runs.back(), i);
    }

    Coordinates coordinates;
    for (const auto& make : coordinates_) coordinates.push_back(make(*m, coordinates));
    for (const auto& make : constraints_) m->constraints.push_back(make(*m, coordinates));
    for (const auto& make : potentials_) m->potentials.push_back(make(*m, coordinates));
    for (const auto& make : forces_) m->forces.push_back(make(*m, coordinates));
    for (const auto& [variable, slot] : damping_) m->damping.emplace_back(m->internal[variable], slot);
    for (const auto& [variable, input] : joint_forces_) m->joint_forces.emplace_back(m->internal[variable], input);
    m->rotors = rotors_;
    for (Rotor& rotor : m->rotors)
        for (auto& geared : rotor.geared) geared.first = m->internal[geared.first];

    note_coupled_variables(*m);
    note_what_elements_see(*m);
    return m;
}

std::shared_ptr<const Mechanism> MechanismBuilder::build_like(const Mechanism& other) const {
    const bool alike = other.n_dynamic == n_dynamic_ && other.n_kinematic == n_kinematic_ &&
                       other.n_inputs == n_inputs_ && other.joints.size() == joints_.size() &&
                       other.points.size() == points_.size() && other.directions.size() == directions_.size() &&
                       other.numbers.size() == numbers_.size() && other.gravity_slot == gravity_slot_ &&
                       other.constraints.size() == constraints_.size() &&
                       other.potentials.size() == potentials_.size() && other.forces.size() == forces_.size() &&
                       other.rotors.size() == rotors_.size() && other.balls.size() == balls_.size();
    // Elements hold the factors of the joints that move them.
    const auto same_factors = [](const Joint& a, const Joint& b) {
        return a.factor == b.factor && std::ranges::equal(a.more, b.more, {}, &Term::factor, &Term::factor);
    };
    Mechanism order;  // which joints carry masses, and which coordinates are variables, are structure too
    order.n_massive = count_massive();
    order_variables(order);
    if (!alike || !std::ranges::equal(other.joints, joints_, same_factors) || order.n_massive != other.n_massive ||
        order.external != other.external || order.plain != other.plain)
        throw std::invalid_argument("the other mechanism is of another structure");
    auto m = std::make_shared<Mechanism>(other);
    set_numbers(*m);
    return m;
}

std::shared_ptr<const Mechanism> with_numbers(const Mechanism& mechanism, std::vector<double> numbers) {
    const std::vector<double>& own = mechanism.numbers;
    if (numbers.size() != own.size()) throw std::invalid_argument("the mechanism has other numbers");
    const int gravity = mechanism.gravity_slot;
    if (gravity >= 0 && !std::equal(own.begin() + gravity, own.begin() + gravity + 3, numbers.begin() + gravity))
        throw std::invalid_argument("the numbers of gravity are part of more");
    auto m = std::make_shared<Mechanism>(mechanism);
    m->numbers = std::move(numbers);
    return m;
}

std::shared_ptr<const Mechanism> with_bodies(const Mechanism& mechanism,
                                             const std::vector<std::pair<int, Body>>& bodies) {
    const auto structure = "the other mechanism is of another structure";
    for (const auto& [joint, body] : bodies)
        if (joint >= mechanism.n_massive && !body.is_empty()) throw std::invalid_argument(structure);
    auto m = std::make_shared<Mechanism>(mechanism);
    set_bodies(*m, bodies);
    if (!std::ranges::equal(m->bodies, mechanism.bodies, {}, &Body::is_empty, &Body::is_empty))
        throw std::invalid_argument(structure);
    return m;
}

std::shared_ptr<const Mechanism> at_instants(const Mechanism& mechanism, const std::vector<int>& inputs) {
    const auto late = [&](int input) { return std::ranges::find(inputs, input) != inputs.end(); };
    auto m = std::make_shared<Mechanism>(mechanism);
    m->forces.clear();
    m->joint_forces.clear();
    for (const auto& force : mechanism.forces) {
        const std::vector<int>& own = force->inputs();
        const auto count = std::ranges::count_if(own, late);
        if (count > 0 && count < std::ssize(own))
            throw std::invalid_argument("a force has inputs that act at the instants and others");
        (count > 0 ? m->instant_forces : m->forces).push_back(force);
    }
    for (const auto& force : mechanism.joint_forces)
        (late(force.second) ? m->instant_joint_forces : m->joint_forces).push_back(force);
    note_coupled_variables(*m);
    note_what_elements_see(*m);
    return m;
}

// Whether a body is round about an axis through its joint.
static bool is_round(const Body& body, int axis) {
    const Sym3<double>& I = body.inertia;
    const std::array<double, 3> com{body.com.x, body.com.y, body.com.z}, moments{I.xx, I.yy, I.zz};
    const int a = (axis + 1) % 3, b = (axis + 2) % 3;
    constexpr double rounding = 1e-12;
    const double least = rounding * (I.xx + I.yy + I.zz);
    const double away = body.mass * (com[a] * com[a] + com[b] * com[b]);
    return away <= least && std::abs(moments[a] - moments[b]) <= least &&
           std::max({std::abs(I.yz), std::abs(I.xz), std::abs(I.xy)}) <= least;
}

bool turns_in_place(const Mechanism& m, int joint) {
    const Joint& wheel = m.joints[joint];
    if (joint >= m.n_massive || wheel.axis > Axis::rz || !wheel.more.empty()) return false;
    if (!is_round(m.bodies[joint], static_cast<int>(wheel.axis))) return false;
    for (int other = 0; other < static_cast<int>(m.joints.size()); ++other) {
        if (other == joint) continue;
        bool moves = other < m.n_massive && m.joints[other].parent == joint;
        m.joints[other].each_term([&](int variable, double) { moves = moves || variable == wheel.variable; });
        if (moves) return false;
    }
    const auto looks_at = [&](const auto& element) {
        return std::ranges::count(element->support(), wheel.variable) > 0;
    };
    return std::ranges::none_of(m.constraints, looks_at) && std::ranges::none_of(m.potentials, looks_at) &&
           std::ranges::none_of(m.forces, looks_at) && std::ranges::none_of(m.instant_forces, looks_at);
}

}  // namespace leastaction
