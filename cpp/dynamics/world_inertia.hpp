// The inertia of a body where it is.
#pragma once

#include "mechanism/mechanism.hpp"

namespace leastaction {

// In world axes about the world origin, R I R' - m [c][c], with the first moment h = m c given.
template <class T>
Inertia<T> world_inertia(const Body& body, const Pose<T>& pose, const Vec3<T>& h) {
    const Sym3<double>& s = body.inertia;
    const Vec3<T> c = h;  // m c
    Inertia<T> out;
    out.m = T(body.mass);
    out.h = h;
    const Vec3<T> a0 = s.xx * pose.R.c0 + s.xy * pose.R.c1 + s.xz * pose.R.c2;
    const Vec3<T> a1 = s.xy * pose.R.c0 + s.yy * pose.R.c1 + s.yz * pose.R.c2;
    const Vec3<T> a2 = s.xz * pose.R.c0 + s.yz * pose.R.c1 + s.zz * pose.R.c2;
    const auto entry = [&](T Vec3<T>::* r, T Vec3<T>::* k) {
        return a0.*r * pose.R.c0.*k + a1.*r * pose.R.c1.*k + a2.*r * pose.R.c2.*k;
    };
    out.I = {entry(&Vec3<T>::x, &Vec3<T>::x), entry(&Vec3<T>::y, &Vec3<T>::y), entry(&Vec3<T>::z, &Vec3<T>::z),
             entry(&Vec3<T>::x, &Vec3<T>::y), entry(&Vec3<T>::x, &Vec3<T>::z), entry(&Vec3<T>::y, &Vec3<T>::z)};
    if (body.mass != 0) {
        const double r = 1.0 / body.mass;
        const Vec3<T> b = r * c;
        out.I.xx += c.y * b.y + c.z * b.z;
        out.I.yy += c.x * b.x + c.z * b.z;
        out.I.zz += c.x * b.x + c.y * b.y;
        out.I.xy += -(c.x * b.y);
        out.I.xz += -(c.x * b.z);
        out.I.yz += -(c.y * b.z);
    }
    return out;
}

}  // namespace leastaction
