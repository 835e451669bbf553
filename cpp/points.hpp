// Where everything is at one configuration: joint poses and joint twists in the world, and points fixed in frames.
//
// For a point p fixed behind joint k and a joint i on the path to k:  dp/dq_i = v_i + w_i x p,
// and for j an ancestor of i (or i itself):                          d2p/dq_i dq_j = w_j x dp/dq_i.
#pragma once

#include <vector>

#include "dual.hpp"
#include "spatial.hpp"

namespace leastaction {

enum class Axis { rx, ry, rz, tx, ty, tz, screw };

// One joint: a constant pose behind the parent joint, then exp(twist * q).
struct Joint {
    int parent = -1;    // joint index, -1: the world
    int variable = -1;  // index of its configuration variable (internal order, see Mechanism)
    Axis axis = Axis::screw;
    bool base_rotates = true;  // the constant pose has a rotation
    Pose<double> base;
    Motion<double> twist;
};

// A point fixed in the frame behind a joint (joint -1: fixed in the world).
struct Point {
    int joint = -1;
    Vec3<double> offset;
};

template <class T>
struct Placement {
    std::vector<Pose<T>> pose;                // by joint, after its motion
    std::vector<Motion<T>> twist;             // by joint, world coordinates, at the world origin
    std::vector<double> angle, sine, cosine;  // work space of place()

    explicit Placement(std::size_t joints)
        : pose(joints), twist(joints), angle(joints + 8), sine(joints + 8), cosine(joints + 8) {}

    Vec3<T> position(const Point& point) const {
        if (point.joint < 0) return {T(point.offset.x), T(point.offset.y), T(point.offset.z)};
        const Pose<T>& at = pose[point.joint];
        return at.R * point.offset + at.p;
    }
};

// Places the listed joints at q, parents before children.
template <class T>
void place(const std::vector<Joint>& joints, const std::vector<int>& list, const T* q, Placement<T>& out);

extern template void place(const std::vector<Joint>&, const std::vector<int>&, const double*, Placement<double>&);
extern template void place(const std::vector<Joint>&, const std::vector<int>&, const Dual<double>*,
                           Placement<Dual<double>>&);

// Reads a twist in the joint's base frame: one of the six primitive axes where it is one, else a screw.
Axis axis_of(const Motion<double>& twist);

}  // namespace leastaction
