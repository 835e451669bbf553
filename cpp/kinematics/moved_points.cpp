#include "kinematics/moved_points.hpp"

#include <algorithm>

namespace leastaction {

MovedPoints::MovedPoints(const Constants& constants, const std::vector<Point>& points, const std::vector<int>& external)
    : external_(external), at_(constants) {
    for (const Point& point : points) {
        Moved moved{point.offset, point.offset, {}, {}};
        for (int j = point.joint; j >= 0; j = constants.joints[j].parent) moved.way.push_back(j);
        std::reverse(moved.way.begin(), moved.way.end());
        moved.l.resize(moved.way.size());
        for (const int j : moved.way)
            if (std::find(joints_.begin(), joints_.end(), j) == joints_.end()) joints_.push_back(j);
        points_.push_back(std::move(moved));
    }
}

void MovedPoints::place_at(const double* q) {
    place(joints_, q, at_);
    for (Moved& point : points_) {
        if (point.way.empty()) continue;
        const Pose<double>& pose = at_.pose[point.way.back()];
        point.p = pose.R * point.offset + pose.p;
        for (std::size_t i = 0; i < point.way.size(); ++i) {
            const auto& [v, w] = at_.twist[point.way[i]];
            point.l[i] = v + cross(w, point.p);
        }
    }
}

void MovedPoints::slope(std::size_t point, const Vec3<double>& g, double* out) const {
    std::fill_n(out, n_variables(), 0.0);
    const auto& [offset, p, way, l] = points_[point];
    for (std::size_t i = 0; i < way.size(); ++i) {
        const double value = dot(g, l[i]);
        at_.joints()[way[i]].each_term(
            [&](int variable, double factor) { out[external_[variable]] += factor * value; });
    }
}

void MovedPoints::add_bent(std::size_t point, const Vec3<double>& f, double w, double* out) const {
    const std::vector<Joint>& joints = at_.joints();
    const auto& [offset, p, way, l] = points_[point];
    const std::size_t n = n_variables();
    const auto add = [&](int i, int j, double value) {
        joints[i].each_term([&](int a, double of_i) {
            joints[j].each_term(
                [&](int b, double of_j) { out[external_[a] * n + external_[b]] += of_i * of_j * value; });
        });
    };
    const auto turned_by = [&](std::size_t i) { return cross(f, at_.twist[way[i]].w) + w * l[i]; };
    std::size_t behind_ball = 0;  // of the way, the first joint behind the last ball joint that was met
    for (std::size_t i = 0; i < way.size(); ++i) {
        if (joints[way[i]].quaternion >= 0) behind_ball = i + 3;
        const Vec3<double> turned = turned_by(i);
        add(way[i], way[i], dot(turned, l[i]));
        for (std::size_t j = i + 1; j < way.size(); ++j) {
            double value = dot(turned, l[j]);
            if (j < behind_ball) value = 0.5 * (value + dot(turned_by(j), l[i]));
            add(way[i], way[j], value);
            add(way[j], way[i], value);
        }
    }
}

void MovedPoints::add_apart(std::size_t point, std::size_t from, const Vec3<double>& g, double s, double w,
                            double* out) {
    const std::size_t n = n_variables();
    auto& [x, y, z] = apart_;
    for (auto* component : {&x, &y, &z}) component->assign(n, 0.0);
    const auto add = [&](const Moved& end, double sign) {
        for (std::size_t i = 0; i < end.way.size(); ++i) {
            const Vec3<double> moved = sign * end.l[i];
            at_.joints()[end.way[i]].each_term([&](int variable, double factor) {
                const int at = external_[variable];
                x[at] += factor * moved.x;
                y[at] += factor * moved.y;
                z[at] += factor * moved.z;
            });
        }
    };
    add(points_[point], 1.0);
    add(points_[from], -1.0);
    for (std::size_t a = 0; a < n; ++a) {
        const Vec3<double> moved{x[a], y[a], z[a]};
        if (moved.x == 0.0 && moved.y == 0.0 && moved.z == 0.0) continue;
        const Vec3<double> felt = (s * dot(g, moved)) * g + w * moved;
        double* row = out + a * n;
        for (std::size_t b = 0; b < n; ++b) row[b] += felt.x * x[b] + felt.y * y[b] + felt.z * z[b];
    }
}

}  // namespace leastaction
