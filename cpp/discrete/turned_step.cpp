// What a step does where rotations are quaternions (turning.hpp): apart from newton_step.cpp, whose steps are as quick as without.
#include <algorithm>

#include "discrete/newton_step.hpp"

namespace leastaction {

namespace {

bool is_free_slide(const Joint& joint, int n_dynamic) {
    return joint.axis >= Axis::tx && joint.axis <= Axis::tz && joint.simple && joint.variable < n_dynamic;
}

// The products of a tree are those of rows r by a ball's start and columns c by its end, and no symmetric part is taken. This
// is the symmetric part less the product: half of g.(r x c) + h.(r x c') - h.(c x r'), with g = L_q, h = L_v and the rates r'
// and c' of the row and the column.
Turning::Matrix3 half_of_order(const Turning::Vector& g, const Turning::Vector& h, const Turning::Matrix6& by) {
    const Turning::Matrix3 across = crossing(h);
    return -0.5 * (transposed_product(by.aa, crossing(g) * by.ab + across * by.bb) +
                   transposed_product(by.ba, across * by.ab));
}

}  // namespace

void MidpointStep::turn_middle() {
    turnings_.clear();
    for (const Ball& ball : mechanism_->balls) {
        turnings_.emplace_back(&q2[ball.variable]);
        std::fill_n(&q_mid_[ball.variable], 3, 0.0);
        turnings_.back().turn_half(&q1[ball.quaternion], &q_mid_[ball.quaternion]);
    }
}

void MidpointStep::turn_ends() {
    std::copy(q2.begin(), q2.begin() + nq_, placed_.begin());
    for (std::size_t b = 0; b < turnings_.size(); ++b) {
        const Ball& ball = mechanism_->balls[b];
        std::fill_n(&placed_[ball.variable], 3, 0.0);
        turnings_[b].turn_whole(&q1[ball.quaternion], &placed_[ball.quaternion]);
        std::copy_n(&placed_[ball.quaternion], 4, &q2[ball.quaternion]);
    }
}

// Of balls from rows of (q1, q2) to those of turns of the ends.
void MidpointStep::turn_residual() {
    for (int i = 0; i < nd_; ++i) {
        residual[i] -= p1[i];
        raw_start_[i] = residual[i];
        raw_end_[i] = p2[i];
    }
    turn_rows(residual.data(), p2.data(), nd_);
    std::copy(residual.begin(), residual.begin() + nd_, turned_start_.begin());
    std::copy(p2.begin(), p2.end(), turned_end_.begin());
    for (int i = 0; i < nd_; ++i) residual[i] += p1[i];
}

void MidpointStep::turn_rows(double* start, double* end, int n) const {
    for (std::size_t b = 0; b < turnings_.size(); ++b) {
        const int at = mechanism_->balls[b].variable;
        if (at < n) turnings_[b].turn_rows(start + at, end + at);
    }
}

// dphi = d + phi x s + c phi x (phi x d) with s = beta/2, d = beta.
void MidpointStep::turn_correction() {
    for (std::size_t b = 0; b < turnings_.size(); ++b) {
        const Ball& ball = mechanism_->balls[b];
        if (!ball.prescribed) turnings_[b].end_to_phi(&correction_[ball.variable]);
    }
}

void MidpointStep::make_bends(double dt) {
    for (std::size_t b = 0; b < turnings_.size(); ++b) {
        const Ball& ball = mechanism_->balls[b];
        if (ball.prescribed) continue;
        const double *start = &raw_start_[ball.variable], *end = &raw_end_[ball.variable];
        const Vec3<double> from{start[0], start[1], start[2]}, to{end[0], end[1], end[2]}, g = from + to;
        bends_[b] = turnings_[b].bend(g, 0.5 * (to - from));
        if (!turned_middle_.is_seen(b)) continue;
        const double* of_bodies = &kernel_slopes_[ball.variable];
        const Vec3<double> of_elements = g - dt * Vec3<double>{of_bodies[0], of_bodies[1], of_bodies[2]};
        bends_[b] = bends_[b] + OfChart({}, of_elements, {}).by(turnings_[b].slope());
    }
}

void MidpointStep::set_bends(double dt) {
    make_bends(dt);
    for (std::size_t b = 0; b < turnings_.size(); ++b) turned_middle_.set_own(b, bends_[b], 1.0);
}

void MidpointStep::make_ball_turns(double dt) {
    make_bends(dt);
    for (std::size_t b = 0; b < ball_turns_.size(); ++b) {
        const int at = mechanism_->balls[b].variable;
        if (at >= nd_) continue;
        const Turning::Matrix6& by = turned_middle_.by_ends(b);
        const double *g = &kernel_slopes_[at], *h = &lagrangian_.L_v[at];
        ball_turns_[b] = {&by, by_ends(bends_[b]).ab + dt * half_of_order({g[0], g[1], g[2]}, {h[0], h[1], h[2]}, by)};
    }
}

std::pair<Vec3<double>, Vec3<double>> MidpointStep::turned_rows(const Ball& ball) const {
    const double *start = &turned_start_[ball.variable], *end = &turned_end_[ball.variable];
    return {{start[0], start[1], start[2]}, {end[0], end[1], end[2]}};
}

const PairDerivatives& MidpointStep::kernel_pairs() {
    if (!turnings_.empty()) {
        lagrangian_.hessian();
        factored_at_solution_ = false;
    }
    return lagrangian_.pairs;
}

// Of balls what is left goes on in the world, where a turn of everything moves both ends and the middle alike.
void MidpointStep::hand_on_turns() {
    const Mechanism& m = *mechanism_;
    for (std::size_t b = 0; b < turnings_.size(); ++b) {
        const Ball& ball = m.balls[b];
        const int at = ball.variable;
        if (ball.prescribed) continue;
        double carried[3];
        for (int i = 0; i < 3; ++i) {
            carried[i] = p1[at + i];
            for (int c = 0; c < nc_; ++c) carried[i] -= C1_[c * nq_ + at + i] * lam[c];
        }
        const double *start = &raw_start_[at], *end = &raw_end_[at];
        const Vec3<double> torque{start[0] + end[0], start[1] + end[1], start[2] + end[2]};
        Vec3<double> in_world = turned(&q1[ball.quaternion], {carried[0], carried[1], carried[2]}) +
                                turned(&q_mid_[ball.quaternion], torque);
        // What is left to the slides of a free joint went on along them, which changes its moment.
        Vec3<double> moved, left;
        for (int j = m.joints[ball.joint].parent; j >= 0 && is_free_slide(m.joints[j], nd_); j = m.joints[j].parent) {
            const int i = m.joints[j].variable;
            const Vec3<double>& along = lagrangian_.at.twist[j].v;
            moved += (q2[i] - q1[i]) * along;
            left += residual[i] * along;
        }
        in_world = in_world - cross(moved, left);
        const Vec3<double> in_body = turned(&placed_[ball.quaternion], in_world, -1.0);
        p2[at] = in_body.x, p2[at + 1] = in_body.y, p2[at + 2] = in_body.z;
    }
}

}  // namespace leastaction
