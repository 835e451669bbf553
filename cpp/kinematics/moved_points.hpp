// Points p fixed behind joints, moved by the variables of the joints on their ways from the world:
//
//   dp/ds_i = l_i = v_i + w_i x p,    d2p/ds_i ds_j = w_i x l_j  where i is nearer to the world than j, or the same,
//
// of two turns i and j of one ball joint the mean of both orders (its chart is q exp(phi)), and coordinates s are
// affine functions of the variables (points.hpp). Forces f on points weigh second derivatives:
// f . (w_i x l_j) = (f x w_i) . l_j, a product for each pair of joints.
#pragma once

#include <array>
#include <vector>

#include "kinematics/points.hpp"

namespace leastaction {

class MovedPoints {
public:
    // `points`: behind joint -1 those of the world. `external`: the places of variables in arrays of the caller's.
    MovedPoints(const Constants& constants, const std::vector<Point>& points, const std::vector<int>& external);

    // Goes to a configuration, in the internal order.
    void place_at(const double* q);

    std::size_t n_variables() const { return external_.size(); }
    std::size_t n_points() const { return points_.size(); }
    Vec3<double> position(std::size_t point) const { return points_[point].p; }
    // Writes g . dp (n) by the variables.
    void slope(std::size_t point, const Vec3<double>& g, double* out) const;
    // Adds f . d2p + w dp . dp (n x n).
    void add_bent(std::size_t point, const Vec3<double>& f, double w, double* out) const;
    // Adds s (g . dd) (g . dd) + w dd . dd (n x n) of d, by which one point is apart from another.
    void add_apart(std::size_t point, std::size_t from, const Vec3<double>& g, double s, double w, double* out);

private:
    struct Moved {
        Vec3<double> offset, p;
        std::vector<int> way;         // joints, from the world outwards
        std::vector<Vec3<double>> l;  // by the joints of the way
    };
    const std::vector<int>& external_;
    std::vector<Moved> points_;
    std::vector<int> joints_;  // of all ways, parents before children
    Placement<double> at_;
    std::array<std::vector<double>, 3> apart_;  // components of the derivatives by the variables, in add_apart
};

}  // namespace leastaction
