#include "mechanism.hpp"

#include <algorithm>
#include <set>
#include <stdexcept>
#include <string>

#include "constraints.hpp"
#include "forces.hpp"

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

// Runs of a path; small gaps are bridged, because the pair products are done several lanes at a time anyway.
std::vector<std::pair<int, int>> runs_of(const std::vector<int>& path) {
    constexpr int bridged_gap = 8;
    std::vector<std::pair<int, int>> runs;
    for (const int joint : path) {
        if (!runs.empty() && joint - runs.back().second <= bridged_gap)
            runs.back().second = joint + 1;
        else
            runs.emplace_back(joint, joint + 1);
    }
    return runs;
}

// Which entries are non-zero when the variables are eliminated from last to first.
std::vector<std::vector<int>> eliminate(int n, const std::set<std::pair<int, int>>& pairs) {
    std::vector<std::set<int>> earlier(n);
    for (const auto& [a, b] : pairs)
        if (a != b) earlier[std::max(a, b)].insert(std::min(a, b));
    std::vector<std::vector<int>> out(n);
    for (int k = n - 1; k >= 0; --k) {
        out[k].assign(earlier[k].begin(), earlier[k].end());
        // The last of them meets the others when k is gone; through it the fill travels down.
        if (!out[k].empty()) earlier[out[k].back()].insert(out[k].begin(), out[k].end() - 1);
    }
    return out;
}

}  // namespace

MechanismBuilder::MechanismBuilder(int n_dynamic, int n_kinematic, int n_inputs)
    : n_dynamic_(n_dynamic), n_kinematic_(n_kinematic), n_inputs_(n_inputs) {
    if (n_dynamic < 0 || n_kinematic < 0 || n_inputs < 0)
        throw std::invalid_argument("numbers of variables and inputs must not be negative");
}

int MechanismBuilder::check_joint(int joint) const {
    if (joint < -1 || joint >= static_cast<int>(joints_.size()))
        throw std::invalid_argument("no joint " + std::to_string(joint));
    return joint;
}
int MechanismBuilder::check_variable(int variable) const {
    if (variable < 0 || variable >= n_dynamic_ + n_kinematic_)
        throw std::invalid_argument("no configuration variable " + std::to_string(variable));
    return variable;
}

int MechanismBuilder::add_joint(int parent, const Pose<double>& base, const Motion<double>& twist, int variable) {
    Joint joint;
    joint.parent = check_joint(parent);
    joint.variable = check_variable(variable);
    joint.base = base;
    joint.twist = twist;
    joint.axis = axis_of(twist);
    joint.base_rotates = !is_identity(base.R);
    for (const Joint& other : joints_)
        if (other.variable == variable)
            throw std::invalid_argument("two joints share configuration variable " + std::to_string(variable));
    joints_.push_back(joint);
    return static_cast<int>(joints_.size()) - 1;
}
void MechanismBuilder::add_body(int joint, const Body& body) { bodies_.emplace_back(check_joint(joint), body); }
int MechanismBuilder::add_point(int joint, const Vec3<double>& offset) {
    points_.push_back({check_joint(joint), offset});
    return static_cast<int>(points_.size()) - 1;
}
void MechanismBuilder::set_gravity(const Vec3<double>& g) { gravity_ = g; }
void MechanismBuilder::check_points(int point1, int point2) const {
    for (const int point : {point1, point2})
        if (point < 0 || point >= static_cast<int>(points_.size()))
            throw std::invalid_argument("no point " + std::to_string(point));
}
void MechanismBuilder::add_distance(int point1, int point2, double length, int variable) {
    check_points(point1, point2);
    pairs_.push_back({point1, point2, length, variable < 0 ? -1 : check_variable(variable), false, {}});
}
void MechanismBuilder::add_coincidence(int point1, int point2, const Vec3<double>& direction) {
    check_points(point1, point2);
    pairs_.push_back({point1, point2, 0.0, -1, true, direction});
}
void MechanismBuilder::add_damping(int variable, double coefficient) {
    if (check_variable(variable) >= n_dynamic_) throw std::invalid_argument("damping acts on dynamic variables only");
    damping_.emplace_back(variable, coefficient);
}
void MechanismBuilder::add_joint_force(int variable, int input) {
    if (check_variable(variable) >= n_dynamic_) throw std::invalid_argument("forces act on dynamic variables only");
    if (input < 0 || input >= n_inputs_) throw std::invalid_argument("no input " + std::to_string(input));
    joint_forces_.emplace_back(variable, input);
}

std::shared_ptr<const Mechanism> MechanismBuilder::build() const {
    auto m = std::make_shared<Mechanism>();
    const int nj = static_cast<int>(joints_.size()), nq = n_dynamic_ + n_kinematic_;
    m->n_dynamic = n_dynamic_;
    m->n_kinematic = n_kinematic_;
    m->n_inputs = n_inputs_;
    m->gravity = gravity_;

    std::vector<Body> body(nj);
    for (const auto& [joint, b] : bodies_) {
        if (joint < 0)
            m->fixed_potential -= b.mass * dot(gravity_, b.com);
        else
            body[joint] = body[joint].is_empty() ? b : merged(body[joint], b);
    }

    // Massive joints first, in depth-first preorder; then the others, parents before children as they came.
    std::vector<char> massive(nj, 0);
    for (int j = nj - 1; j >= 0; --j) {
        massive[j] = massive[j] || !body[j].is_empty();
        if (massive[j] && joints_[j].parent >= 0) massive[joints_[j].parent] = 1;
    }
    std::vector<int> order;
    {
        std::vector<std::vector<int>> children(nj + 1);
        for (int j = nj - 1; j >= 0; --j)
            if (massive[j]) children[joints_[j].parent + 1].push_back(j);
        std::vector<int> stack = children[0];
        while (!stack.empty()) {
            const int j = stack.back();
            stack.pop_back();
            order.push_back(j);
            for (const int child : children[j + 1]) stack.push_back(child);
        }
    }
    m->n_massive = static_cast<int>(order.size());
    for (int j = 0; j < nj; ++j)
        if (!massive[j]) order.push_back(j);
    m->joint_of_builder.resize(nj);
    for (int i = 0; i < nj; ++i) m->joint_of_builder[order[i]] = i;

    // Dynamic variables in the order of their joints, kinematic ones as the user has them.
    std::vector<char> has_joint(nq, 0);
    for (int i = 0; i < m->n_massive; ++i) {
        const int variable = joints_[order[i]].variable;
        has_joint[variable] = 1;
        if (variable < n_dynamic_) m->external.push_back(variable);
    }
    for (int variable = 0; variable < n_dynamic_; ++variable)
        if (!has_joint[variable])
            throw std::invalid_argument("dynamic variable " + std::to_string(variable) + " moves no mass");
    for (int variable = n_dynamic_; variable < nq; ++variable) m->external.push_back(variable);
    m->internal.resize(nq);
    for (int i = 0; i < nq; ++i) {
        m->internal[m->external[i]] = i;
        m->same_order = m->same_order && m->external[i] == i;
    }

    for (const int j : order) {
        Joint joint = joints_[j];
        joint.parent = joint.parent < 0 ? -1 : m->joint_of_builder[joint.parent];
        joint.variable = m->internal[joint.variable];
        m->joints.push_back(joint);
    }
    std::set<std::pair<int, int>> pairs;
    for (int i = 0; i < m->n_massive; ++i) {
        m->bodies.push_back(body[order[i]]);
        const int parent = m->joints[i].parent;
        m->path.push_back(parent < 0 ? std::vector<int>{} : m->path[parent]);
        m->path.back().push_back(i);
        m->runs.push_back(runs_of(m->path.back()));
        const int variable = m->joints[i].variable;
        if (variable < n_dynamic_)
            for (const int j : m->path.back())
                if (m->joints[j].variable < n_dynamic_) pairs.emplace(variable, m->joints[j].variable);
    }

    const auto moved = [&](const Point& point) {
        return Point{point.joint < 0 ? -1 : m->joint_of_builder[point.joint], point.offset};
    };
    for (const RawPair& pair : pairs_) {
        const Point point1 = moved(points_[pair.point1]), point2 = moved(points_[pair.point2]);
        if (pair.coincide)
            m->constraints.push_back(std::make_unique<Coincidence>(m->joints, point1, point2, pair.direction));
        else
            m->constraints.push_back(std::make_unique<Distance>(m->joints, point1, point2, pair.length,
                                                                pair.variable < 0 ? -1 : m->internal[pair.variable]));
    }
    if (!damping_.empty()) {
        std::vector<double> coefficients(n_dynamic_, 0.0);
        for (const auto& [variable, c] : damping_) coefficients[m->internal[variable]] += c;
        m->forces.push_back(std::make_unique<JointDamping>(std::move(coefficients), nq));
    }
    for (const auto& [variable, input] : joint_forces_)
        m->forces.push_back(std::make_unique<JointForce>(m->internal[variable], input, n_inputs_));

    for (const auto& potential : m->potentials)
        for (const int a : potential->support())
            for (const int b : potential->support())
                if (a < n_dynamic_ && b < n_dynamic_) pairs.emplace(a, b);
    for (const auto& force : m->forces)
        for (const auto& pair : force->couplings()) pairs.insert(pair);
    m->coupled = eliminate(n_dynamic_, pairs);

    std::set<int> looked_at;
    for (const auto& constraint : m->constraints)
        looked_at.insert(constraint->joints().begin(), constraint->joints().end());
    m->constraint_joints.assign(looked_at.begin(), looked_at.end());
    for (const int joint : m->constraint_joints) {
        bool free = false;
        for (int j = joint; j >= 0; j = m->joints[j].parent) free = free || m->joints[j].variable < n_dynamic_;
        (free ? m->free_constraint_joints : m->prescribed_constraint_joints).push_back(joint);
    }
    for (int i = 0; i < m->n_massive; ++i) m->massive_joints.push_back(i);
    return m;
}

}  // namespace leastaction
