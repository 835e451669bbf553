#include "discrete/turned_middle.hpp"

#include <algorithm>
#include <utility>

namespace leastaction {

using Matrix6 = Turning::Matrix6;

TurnedMiddle::TurnedMiddle(const Mechanism& m) : mechanism_(m), ball_of_(m.n_variables(), -1), balls_(m.balls.size()) {
    for (std::size_t b = 0; b < m.balls.size(); ++b) {
        std::fill_n(&ball_of_[m.balls[b].variable], 3, static_cast<int>(b));
        const bool massive = m.balls[b].joint < m.n_massive;
        place_in_joints_.push_back(massive ? static_cast<int>(joints_.size()) : -1);
        TurnedBall& ball = balls_[b];
        ball.turned.first = ball.seen.first = ball.seen_field.first = m.balls[b].variable;
        if (massive) joints_.push_back({m.balls[b].joint, !m.balls[b].prescribed, &ball.by, &ball.along, {}});
    }
    const auto see = [&](int variable) {
        if (ball_of_[variable] >= 0) balls_[ball_of_[variable]].is_seen = true;
    };
    for (const auto& potential : m.potentials) std::ranges::for_each(potential->support(), see);
    for (const auto& force : m.forces) std::ranges::for_each(force->support(), see);
    for (const auto& [variable, slot] : m.damping) see(variable);
    for (const auto& [variable, input] : m.joint_forces) see(variable);
}

Matrix6 TurnedMiddle::ends_of(const Matrix6& by) const {
    return {0.5 * by.aa - rate_ * by.ab, 0.5 * by.aa + rate_ * by.ab, 0.5 * by.ba - rate_ * by.bb,
            0.5 * by.ba + rate_ * by.bb};
}

const Matrix6& TurnedMiddle::by_ends(std::size_t b) const {
    const TurnedBall& ball = balls_[b];
    if (!std::exchange(ball.has_turned, true)) ball.turned.by = ends_of(ball.by);
    return ball.turned.by;
}

const TurnedMiddle::Ends& TurnedMiddle::seen(const TurnedBall& ball) const {
    if (!std::exchange(ball.has_seen, true)) {
        const Turning::Matrix3 change = change_by_turn(ball.rate);
        Matrix6 by = ball.by;
        by.ba = by.ba - change * by.aa;
        by.bb = by.bb - change * by.ab;
        ball.seen.by = ends_of(by);
    }
    return ball.seen;
}

const TurnedMiddle::Ends& TurnedMiddle::seen_field(const TurnedBall& ball) const {
    if (!std::exchange(ball.has_seen_field, true)) {
        const Turning::Matrix3 change = crossing(ball.field) - change_by_turn(ball.field);
        Matrix6 along = ball.along;
        along.aa = along.aa + change * ball.by.aa;
        along.ab = along.ab + change * ball.by.ab;
        ball.seen_field.by = ends_of(along);
    }
    return ball.seen_field;
}

void TurnedMiddle::set_balls(const std::vector<Turning>& turnings) {
    for (std::size_t b = 0; b < balls_.size(); ++b) {
        const Ball& ball = mechanism_.balls[b];
        TurnedBall& to = balls_[b];
        const double* phi = turnings[b].phi();
        to.by = ball.prescribed ? GivenTurning(phi).slope(dt_) : turnings[b].slope(dt_);
        to.rate = rate_ * Vec3<double>{phi[0], phi[1], phi[2]};
        to.has_turned = to.has_seen = to.has_seen_field = false;
    }
}

void TurnedMiddle::set_field(std::size_t b, const TurnedField& field) {
    TurnedBall& ball = balls_[b];
    ball.along = field.slope_in_turned_axes(ball.by, dt_);
    ball.field = dt_ * field.theta();
}

bool TurnedMiddle::set_own(std::size_t ball, const Matrix6& bend, double factor) {
    const int place = place_in_joints_[ball];
    if (place < 0) return false;
    joints_[place].own = {(factor * rate_) * bend.aa, factor * bend.ab, factor * bend.ba, (factor * dt_) * bend.bb};
    return true;
}

}  // namespace leastaction
