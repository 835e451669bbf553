#include "kinematics/moved_point.hpp"

#include <algorithm>

namespace leastaction {

MovedPoint::MovedPoint(const Constants& constants, int joint, const Vec3<double>& offset,
                       const std::vector<int>& external)
    : n_(external.size()), offset_(offset), p_(offset), external_(external), at_(constants) {
    for (int j = joint; j >= 0; j = constants.joints[j].parent) way_.push_back(j);
    std::reverse(way_.begin(), way_.end());
    l_.resize(way_.size());
}

void MovedPoint::place_at(const double* q) {
    if (way_.empty()) return;
    place(way_, q, at_);
    const Pose<double>& pose = at_.pose[way_.back()];
    p_ = pose.R * offset_ + pose.p;
    for (std::size_t i = 0; i < way_.size(); ++i) {
        const auto& [v, w] = at_.twist[way_[i]];
        l_[i] = v + cross(w, p_);
    }
}

void MovedPoint::jacobian(double* out) const {
    std::fill_n(out, 3 * n_, 0.0);
    for (std::size_t i = 0; i < way_.size(); ++i) {
        at_.joints()[way_[i]].each_term([&](int variable, double factor) {
            double* column = out + external_[variable];
            column[0] += factor * l_[i].x;
            column[n_] += factor * l_[i].y;
            column[2 * n_] += factor * l_[i].z;
        });
    }
}

void MovedPoint::bent(const Vec3<double>& f, double* out) const {
    std::fill_n(out, n_ * n_, 0.0);
    const std::vector<Joint>& joints = at_.joints();
    const auto add = [&](int i, int j, double value) {
        joints[i].each_term([&](int a, double of_i) {
            joints[j].each_term(
                [&](int b, double of_j) { out[external_[a] * n_ + external_[b]] += of_i * of_j * value; });
        });
    };
    for (std::size_t i = 0; i < way_.size(); ++i) {
        const Vec3<double> turned = cross(f, at_.twist[way_[i]].w);
        add(way_[i], way_[i], dot(turned, l_[i]));
        for (std::size_t j = i + 1; j < way_.size(); ++j) {
            const double value = dot(turned, l_[j]);
            add(way_[i], way_[j], value);
            add(way_[j], way_[i], value);
        }
    }
}

}  // namespace leastaction
