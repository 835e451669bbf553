// Where everything is at one configuration: joint poses and joint twists in the world, and points fixed in frames.
//
// For a point p fixed behind joint k and a joint i on the path to k:  dp/dq_i = v_i + w_i x p,
// and for j an ancestor of i (or i itself):                          d2p/dq_i dq_j = w_j x dp/dq_i.
#pragma once

#include <type_traits>
#include <vector>

#include "numerics/lanes.hpp"
#include "numerics/spatial.hpp"

namespace leastaction {

enum class Axis { rx, ry, rz, tx, ty, tz, screw };

// A configuration variable times a factor.
struct Term {
    int variable;
    double factor;
};

// One joint: a constant pose behind the parent joint, then exp(twist * s), where its coordinate s is an affine function of
// the configuration variables: s = factor q[variable] + offset, and `more` terms where it couples several.
struct Joint {
    int parent = -1;    // joint index, -1: the world
    int variable = -1;  // index of its configuration variable (internal order, see Mechanism)
    Axis axis = Axis::screw;
    bool base_rotates = true;  // the constant pose has a rotation
    bool simple = true;        // s is the variable itself
    double factor = 1.0, offset = 0.0;
    Pose<double> base;
    Motion<double> twist;
    std::vector<Term> more;
    int quaternion = -1;  // of rx of a ball, a screw here: where its four numbers stand in q, scalar first

    template <class T>
    T coordinate(const T* q) const {
        return simple ? q[variable] : linear(q) + offset;
    }
    template <class T>
    T rate(const T* v) const {
        return simple ? v[variable] : linear(v);
    }
    template <class T>
    T linear(const T* v) const {
        T out = factor * v[variable];
        for (const Term& term : more) out += term.factor * v[term.variable];
        return out;
    }
    // Calls f(variable, factor) for every term.
    template <class F>
    void each_term(const F& f) const {
        f(variable, factor);
        for (const Term& term : more) f(term.variable, term.factor);
    }
};

// A point fixed in the frame behind a joint (joint -1: fixed in the world).
struct Point {
    int joint = -1;
    Vec3<double> offset;
};

// All numbers of a mechanism that placements and elements read: elements hold indices into it, so numbers can change while
// the structure is shared.
struct Constants {
    std::vector<Joint> joints;
    std::vector<Point> points;
    std::vector<Point> directions;  // vectors fixed in the frame behind a joint: they turn, but do not move
    std::vector<double> numbers;    // of the elements, by slot
    int time_slot = -1;             // of the number that is the time, where an element asks for it
    bool has_quaternions = false;   // some joints turn behind one

    double number(int slot) const { return numbers[slot]; }
    double own_time() const { return time_slot < 0 ? 0.0 : numbers[time_slot]; }  // where no other is told (s)
};

// Numbers of the elements, by slot; others may stand for those of the mechanism, and the time for the one in its slot.
template <class T>
struct Numbers {
    const double* numbers;
    const double* number_slopes = nullptr;  // duals only: the direction in their space
    int time_slot = -1;
    T time{};  // s; on duals with its part of the direction

    T number(int slot) const {
        if (slot == time_slot) return time;
        if constexpr (is_dual<T>)
            return {numbers[slot], number_slopes ? number_slopes[slot] : 0.0};
        else
            return numbers[slot];
    }
    // Of lanes, which share the time.
    Numbers<double> plain() const { return {numbers, nullptr, time_slot, time[0]}; }
};

template <class T>
class Placement : public Numbers<T> {
public:
    std::vector<Pose<T>> pose;                // by joint, after its motion
    std::vector<Motion<T>> twist;             // by joint, world coordinates, at the world origin
    std::vector<double> angle, sine, cosine;  // work space of place()
    // Duals of balls are turns along exp: their three axes turn with the ball, and the second of their three poses is not placed.
    bool turns_along_exp = false;

    explicit Placement(const Constants& constants)
        : Numbers<T>{constants.numbers.data(), nullptr, constants.time_slot, constants.own_time()},
          pose(constants.joints.size()),
          twist(pose.size()),
          angle(pose.size() + 8),
          sine(pose.size() + 8),
          cosine(pose.size() + 8),
          constants_(&constants) {}

    const std::vector<Joint>& joints() const { return constants_->joints; }
    bool has_quaternions() const { return constants_->has_quaternions; }
    Vec3<T> position(int index) const {
        const Point& point = constants_->points[index];
        if (point.joint < 0) return {T(point.offset.x), T(point.offset.y), T(point.offset.z)};
        const Pose<T>& at = pose[point.joint];
        return at.R * point.offset + at.p;
    }
    Vec3<T> direction(int index) const {
        const Point& fixed = constants_->directions[index];
        if (fixed.joint < 0) return {T(fixed.offset.x), T(fixed.offset.y), T(fixed.offset.z)};
        return pose[fixed.joint].R * fixed.offset;
    }

private:
    const Constants* constants_;
};

// Places the listed joints at q, parents before children.
template <class T>
void place(const std::vector<int>& list, const T* q, Placement<T>& out);

extern template void place(const std::vector<int>&, const double*, Placement<double>&);
extern template void place(const std::vector<int>&, const Dual<double>*, Placement<Dual<double>>&);
extern template void place(const std::vector<int>&, const HyperDual*, Placement<HyperDual>&);
extern template void place(const std::vector<int>&, const Lanes*, Placement<Lanes>&);

// Reads a twist in the joint's base frame: one of the six primitive axes where it is one, else a screw.
Axis axis_of(const Motion<double>& twist);

}  // namespace leastaction
