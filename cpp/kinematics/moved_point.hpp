// A point p fixed behind a joint, moved by the variables of the joints on its way from the world:
//
//   dp/ds_i = l_i = v_i + w_i x p,    d2p/ds_i ds_j = w_i x l_j  where i is nearer to the world than j, or the same,
//
// and coordinates s are affine functions of the variables (points.hpp). Forces f on points weigh second derivatives:
// f . (w_i x l_j) = (f x w_i) . l_j, a product for each pair of joints.
#pragma once

#include <vector>

#include "kinematics/points.hpp"

namespace leastaction {

class MovedPoint {
public:
    // `joint`: -1 for a point of the world. `external`: the places of variables in arrays of the caller's.
    MovedPoint(const Constants& constants, int joint, const Vec3<double>& offset, const std::vector<int>& external);

    // Goes to a configuration, by the internal order of variables.
    void place_at(const double* q);

    Vec3<double> position() const { return p_; }
    // Writes dp (3 x n) by the variables.
    void jacobian(double* out) const;
    // Writes f . d2p (n x n).
    void bent(const Vec3<double>& f, double* out) const;

private:
    std::size_t n_;
    Vec3<double> offset_, p_;
    const std::vector<int>& external_;
    std::vector<int> way_;  // joints, from the world outwards
    Placement<double> at_;
    std::vector<Vec3<double>> l_;  // by the joints of the way
};

}  // namespace leastaction
