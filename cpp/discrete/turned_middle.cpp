#include "discrete/turned_middle.hpp"

#include <algorithm>

namespace leastaction {

using Matrix6 = Turning::Matrix6;

TurnedMiddle::TurnedMiddle(const Mechanism& m) : mechanism_(m), ball_of_(m.n_variables(), -1), balls_(m.balls.size()) {
    for (std::size_t b = 0; b < m.balls.size(); ++b) {
        std::fill_n(&ball_of_[m.balls[b].variable], 3, static_cast<int>(b));
        const bool massive = m.balls[b].joint < m.n_massive;
        place_in_joints_.push_back(massive ? static_cast<int>(joints_.size()) : -1);
        if (massive) joints_.push_back({m.balls[b].joint, !m.balls[b].prescribed, nullptr, nullptr, {}});
    }
}

void TurnedMiddle::Slopes::make(double rate) const {
    ends_.by = {0.5 * of_.aa - rate * of_.ab, 0.5 * of_.aa + rate * of_.ab, 0.5 * of_.ba - rate * of_.bb,
                0.5 * of_.ba + rate * of_.bb};
    made_ = true;
}

// From (theta, nu) by (s, d) to (theta, nu/dt) by (s, d/dt).
Matrix6 TurnedMiddle::scaled(const Matrix6& by_middle) const {
    return {by_middle.aa, dt_ * by_middle.ab, rate_ * by_middle.ba, by_middle.bb};
}

void TurnedMiddle::set_balls(const std::vector<Turning>& turnings) {
    for (std::size_t b = 0; b < balls_.size(); ++b) {
        const Ball& ball = mechanism_.balls[b];
        const Matrix6& by = balls_[b].middle.set(
            ball.variable, scaled(ball.prescribed ? GivenTurning(turnings[b].phi()).slope() : turnings[b].slope()));
        if (place_in_joints_[b] >= 0) joints_[place_in_joints_[b]].by = &by;
    }
}

void TurnedMiddle::set_field(std::size_t ball, const Matrix6& slope) {
    const Matrix6& along = balls_[ball].field.set(mechanism_.balls[ball].variable, scaled(slope));
    if (place_in_joints_[ball] >= 0) joints_[place_in_joints_[ball]].along = &along;
}

bool TurnedMiddle::set_own(std::size_t ball, const Matrix6& bend, double factor) {
    const int place = place_in_joints_[ball];
    if (place < 0) return false;
    joints_[place].own = {(factor * rate_) * bend.aa, factor * bend.ab, factor * bend.ba, (factor * dt_) * bend.bb};
    return true;
}

}  // namespace leastaction
