#include "kinematics/points.hpp"

#include <algorithm>
#include <cmath>

#include "numerics/sincos.hpp"

namespace leastaction {

namespace {

// Turns the columns a, b of a rotation by an angle about the third one.
template <class T>
void turn(Vec3<T>& a, Vec3<T>& b, const T& s, const T& c) {
    const Vec3<T> a0 = a;
    a = c * a0 + s * b;
    b = c * b - s * a0;
}

// exp(twist * q) for any constant twist: Rodrigues' formula; a turn by |w| q about w and a slide along it.
template <class T>
void move_along_screw(const Motion<double>& twist, const T& q, Pose<T>& pose) {
    const double rate = std::sqrt(dot(twist.w, twist.w));
    if (rate == 0.0) {
        pose.p += pose.R * (q * twist.v);
        return;
    }
    const Vec3<double> axis = (1.0 / rate) * twist.w;
    const Vec3<double> v = (1.0 / rate) * twist.v;
    const T angle = rate * q;
    T s, c;
    sincos_of(angle, s, c);
    const auto rotated = [&](const Vec3<double>& e) {
        return T(1.0) * e + s * cross(axis, e) + (1.0 - c) * cross(axis, cross(axis, e));
    };
    const Vec3<T> slide = angle * v + (1.0 - c) * cross(axis, v) + (angle - s) * cross(axis, cross(axis, v));
    const Mat3<T> turned{rotated({1, 0, 0}), rotated({0, 1, 0}), rotated({0, 0, 1})};
    pose.p += pose.R * slide;
    pose.R = pose.R * turned;
}

}  // namespace

Axis axis_of(const Motion<double>& t) {
    const auto is = [](const Vec3<double>& a, double x, double y, double z) {
        return a.x == x && a.y == y && a.z == z;
    };
    if (is(t.v, 0, 0, 0)) {
        if (is(t.w, 1, 0, 0)) return Axis::rx;
        if (is(t.w, 0, 1, 0)) return Axis::ry;
        if (is(t.w, 0, 0, 1)) return Axis::rz;
    }
    if (is(t.w, 0, 0, 0)) {
        if (is(t.v, 1, 0, 0)) return Axis::tx;
        if (is(t.v, 0, 1, 0)) return Axis::ty;
        if (is(t.v, 0, 0, 1)) return Axis::tz;
    }
    return Axis::screw;
}

namespace {

// Any twist; apart, so that the joints that are everywhere are as quick as without it.
template <class T>
[[gnu::noinline]] void place_screw(const Joint& joint, T q, Pose<T>& pose, Motion<T>& twist) {
    const Vec3<T> w = pose.R * joint.twist.w;
    twist = {pose.R * joint.twist.v + cross(pose.p, w), w};
    move_along_screw(joint.twist, q, pose);
}

template <class T, class U>
Vec3<T> lifted(const Vec3<U>& a) {
    return {T(a.x), T(a.y), T(a.z)};
}
template <class T, class U>
Mat3<T> lifted(const Mat3<U>& R) {
    return {lifted<T>(R.c0), lifted<T>(R.c1), lifted<T>(R.c2)};
}

// Turns by an angle that is zero, of duals with its derivatives.
template <class T>
void turn_at_zero(Vec3<T>& a, Vec3<T>& b, const T& angle) {
    if constexpr (is_dual<T>) {
        T s, c;
        sincos_from(angle, 0.0, 1.0, s, c);
        turn(a, b, s, c);
    }
}

// R exp(angles) of angles that are zero.
void turn_at_zero(Mat3<Dual<double>>& R, const Dual<double>* angles) {
    const auto add = [](Vec3<Dual<double>>& to, double factor, const Vec3<Dual<double>>& by) {
        to.x.d += factor * by.x.v, to.y.d += factor * by.y.v, to.z.d += factor * by.z.v;
    };
    const double x = angles[0].d, y = angles[1].d, z = angles[2].d;
    add(R.c0, z, R.c1), add(R.c0, -y, R.c2);
    add(R.c1, x, R.c2), add(R.c1, -z, R.c0);
    add(R.c2, y, R.c0), add(R.c2, -x, R.c1);
}

// The three joints of a ball, given that its parent is placed: about the axes of its rotation, where their coordinates are zero.
// The rotation itself is fixed.
template <class T>
[[gnu::noinline]] void place_ball(const Joint& joint, const T* q, int index, Placement<T>& out) {
    using Number = SizeOf<T>;
    const T* angles = q + joint.variable;
    Number quaternion[4];
    for (int i = 0; i < 4; ++i) quaternion[i] = value_of(q[joint.quaternion + i]);
    Mat3<Number> own = rotation_of(quaternion);
    if (joint.base_rotates) own = joint.base.R * own;
    Pose<T>* pose = &out.pose[index];
    Mat3<T>& R = pose[0].R;
    Vec3<T>& p = pose[0].p;
    if (joint.parent < 0) {
        R = lifted<T>(own);
        p = lifted<T>(joint.base.p);
    } else {
        const Pose<T>& parent = out.pose[joint.parent];
        R = parent.R * own;
        p = parent.R * joint.base.p + parent.p;
    }
    const auto about = [&](int k, const Vec3<T>& w) { out.twist[index + k] = {cross(p, w), w}; };
    if constexpr (std::is_same_v<T, Dual<double>>) {
        if (out.turns_along_exp) {
            turn_at_zero(R, angles);
            about(0, R.c0), about(1, R.c1), about(2, R.c2);
            pose[2] = pose[0];
            return;
        }
    }
    about(0, R.c0);
    turn_at_zero(R.c1, R.c2, angles[0]);
    pose[1] = pose[0];
    about(1, R.c1);
    turn_at_zero(pose[1].R.c2, pose[1].R.c0, angles[1]);
    pose[2] = pose[1];
    about(2, pose[1].R.c2);
    turn_at_zero(pose[2].R.c0, pose[2].R.c1, angles[2]);
}

// One joint, given that its parent is placed; s and c are the sine and cosine of q.
template <class T>
[[gnu::always_inline]] inline void place_one(const Joint& joint, const T& q, const T& s, const T& c, int index,
                                             Placement<T>& out) {
    Pose<T>& pose = out.pose[index];
    if (joint.parent < 0) {
        pose = {lifted<T>(joint.base.R), lifted<T>(joint.base.p)};
    } else {
        const Pose<T>& parent = out.pose[joint.parent];
        pose.R = joint.base_rotates ? parent.R * joint.base.R : parent.R;
        pose.p = parent.R * joint.base.p + parent.p;
    }
    Motion<T>& twist = out.twist[index];
    const auto about = [&](const Vec3<T>& w) { twist = {cross(pose.p, w), w}; };
    const auto along = [&](const Vec3<T>& v) {
        twist = {v, Vec3<T>{}};
        pose.p += q * v;
    };
    switch (joint.axis) {
        case Axis::rx:
            about(pose.R.c0);
            turn(pose.R.c1, pose.R.c2, s, c);
            break;
        case Axis::ry:
            about(pose.R.c1);
            turn(pose.R.c2, pose.R.c0, s, c);
            break;
        case Axis::rz:
            about(pose.R.c2);
            turn(pose.R.c0, pose.R.c1, s, c);
            break;
        case Axis::tx:
            along(pose.R.c0);
            break;
        case Axis::ty:
            along(pose.R.c1);
            break;
        case Axis::tz:
            along(pose.R.c2);
            break;
        case Axis::screw:
            place_screw(joint, q, pose, twist);
            break;
    }
}

// Whether there is a sine to take: balls and slides alone have none.
bool any_turns(const std::vector<int>& list, const std::vector<Joint>& joints, const double* angles) {
    for (std::size_t i = 0; i < list.size(); ++i) {
        const Axis axis = joints[list[i]].axis;
        if (angles[i] != 0.0 && (axis <= Axis::rz || axis == Axis::screw)) return true;
    }
    return false;
}

// Where sines and cosines are known, but of lanes.
template <bool with_balls, class T>
[[gnu::always_inline]] inline void place_each(const std::vector<int>& list, const T* q, Placement<T>& out) {
    const std::vector<Joint>& joints = out.joints();
    const int n = static_cast<int>(list.size());
    for (int i = 0; i < n; ++i) {
        const Joint& joint = joints[list[i]];
        if (with_balls && joint.quaternion >= 0) {
            place_ball(joint, q, list[i], out);
            i += 2;  // its other two stand behind it
            continue;
        }
        const T x = joint.coordinate(q);
        T s, c;
        if constexpr (!std::is_same_v<T, Lanes>)
            sincos_from(x, out.sine[i], out.cosine[i], s, c);
        else if (joint.axis <= Axis::rz)
            sincos_of(x, s, c);
        else
            s = c = T(0.0);
        place_one(joint, x, s, c, list[i], out);
    }
}

// Apart, so that mechanisms without balls are as quick as without these.
template <class T>
[[gnu::noinline]] void place_with_balls(const std::vector<int>& list, const T* q, Placement<T>& out) {
    place_each<true>(list, q, out);
}

}  // namespace

template <class T>
void place(const std::vector<int>& list, const T* q, Placement<T>& out) {
    if (list.empty()) return;
    const std::vector<Joint>& joints = out.joints();
    const int n = static_cast<int>(list.size());
    // Those of one configuration side by side; lanes are so by themselves.
    if constexpr (!std::is_same_v<T, Lanes>) {
        for (int i = 0; i < n; ++i) out.angle[i] = value_of(joints[list[i]].coordinate(q));
        if (out.has_quaternions() && !any_turns(list, joints, out.angle.data())) {
            std::fill_n(out.sine.data(), n, 0.0);
            std::fill_n(out.cosine.data(), n, 1.0);
        } else {
            sincos_all(out.angle.data(), out.sine.data(), out.cosine.data(), n);
        }
    }
    if (out.has_quaternions())
        place_with_balls(list, q, out);
    else
        place_each<false>(list, q, out);
}

template void place(const std::vector<int>&, const double*, Placement<double>&);
template void place(const std::vector<int>&, const Dual<double>*, Placement<Dual<double>>&);
template void place(const std::vector<int>&, const HyperDual*, Placement<HyperDual>&);
template void place(const std::vector<int>&, const Lanes*, Placement<Lanes>&);

}  // namespace leastaction
