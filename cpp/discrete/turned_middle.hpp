// How the middle of a step changes with its ends, where balls turn (turning.hpp).
//
// By any other variable q = (q1 + q2)/2 and v = (q2 - q1)/dt. Of a ball that is so of (s, d/dt), by which the kernel takes
// second derivatives in place of turns and the body's rates. Then the pairs of balls are those of any joint, but for second
// derivatives of the turn and phi by the ends. Elements know a ball by its chart.
#pragma once

#include <vector>

#include "discrete/turning.hpp"
#include "dynamics/lagrangian.hpp"

namespace leastaction {

// What a variable of the middle and its rate change by where one starts from, and where it ends.
struct ByEnds {
    double q_start, q_end, v_start, v_end;
};

// Where nothing turns: each variable depends on itself.
struct PlainMiddle {
    double rate;
    template <class F>
    void each_end(int i, const F& f) const {
        f(i, ByEnds{0.5, 0.5, -rate, rate});
    }
};

// Calls f(k, start, end) with what a row of weights by variable i of the middle and its rate comes to.
template <class Middle, class F>
void spread(const Middle& middle, int i, double by_q, double by_v, const F& f) {
    middle.each_end(
        i, [&](int k, const ByEnds& e) { f(k, by_q * e.q_start + by_v * e.v_start, by_q * e.q_end + by_v * e.v_end); });
}

class TurnedMiddle {
public:
    explicit TurnedMiddle(const Mechanism& mechanism);
    TurnedMiddle(const TurnedMiddle&) = delete;  // its joints point into it
    TurnedMiddle& operator=(const TurnedMiddle&) = delete;

    // For a step in which the balls turn so.
    void set(const std::vector<Turning>& turnings, double dt) {
        dt_ = dt;
        rate_ = 1.0 / dt;
        if (turns()) set_balls(turnings);
    }
    bool turns() const { return !balls_.empty(); }
    // Calls f, which does what elements at the middle do, with this, or a PlainMiddle where nothing turns: asked once for all.
    template <class F>
    void visit(const F& f) const {
        if (!turns())
            f(PlainMiddle{rate_});
        else if (mechanism_.has_elements_at_middle())
            visit_turned(f);
    }
    // The field of a ball, where duals are taken along dt times it.
    void set_field(std::size_t ball, const TurnedField& field);

    // Second derivatives of a ball by (s, d) that are none of the kernel's, times `factor` those of dt L: false where it moves no
    // mass, and so is none of joints().
    bool set_own(std::size_t ball, const Turning::Matrix6& bend, double factor);

    // For the kernel: the joints of balls by (s, d/dt).
    std::span<const TurnedJoints> joints() const { return joints_; }

    // Calls f(k, ByEnds) for every variable k that variable i depends on as elements see it, itself but for balls.
    template <class F>
    void each_end(int i, const F& f) const {
        const int ball = ball_of_[i];
        if (ball < 0) return f(i, ByEnds{0.5, 0.5, -rate_, rate_});
        seen(balls_[ball]).each(i, f);
    }
    // The same of the change of variable i of the field, of balls alone; of rates it is not asked for.
    template <class F>
    void each_field_end(int i, const F& f) const {
        if (ball_of_[i] >= 0) seen_field(balls_[ball_of_[i]]).each(i, f);
    }
    // The turn of a ball's middle and its rates by turns of the start and the end.
    const Turning::Matrix6& by_ends(std::size_t ball) const;
    int ball_of(int variable) const { return ball_of_[variable]; }  // -1: none
    // Whether elements at the middle look at the turns of a ball.
    bool is_seen(std::size_t ball) const { return balls_[ball].is_seen; }

private:
    using Matrix6 = Turning::Matrix6;
    struct Ends {
        int first;
        Matrix6 by;  // three coordinates and rates by the start and the end
        template <class F>
        void each(int i, const F& f) const {
            const int row = i - first;
            for (int k = 0; k < 3; ++k)
                f(first + k, ByEnds{by.aa(row, k), by.ab(row, k), by.ba(row, k), by.bb(row, k)});
        }
    };
    // All but `by` and `along`, by (s, d/dt), is made where it is asked for.
    struct TurnedBall {
        Matrix6 by, along;
        Vec3<double> rate, field;
        bool is_seen = false;
        mutable Ends turned, seen, seen_field;
        mutable bool has_turned, has_seen, has_seen_field;
    };
    const Ends& seen(const TurnedBall& ball) const;
    const Ends& seen_field(const TurnedBall& ball) const;
    Matrix6 ends_of(const Matrix6& by) const;
    void set_balls(const std::vector<Turning>& turnings);
    template <class F>
    [[gnu::noinline]] void visit_turned(const F& f) const {
        f(*this);
    }

    const Mechanism& mechanism_;
    std::vector<int> ball_of_;
    std::vector<TurnedBall> balls_;
    std::vector<TurnedJoints> joints_;  // of balls that move masses
    std::vector<int> place_in_joints_;  // by ball; -1: none
    double dt_ = 0, rate_ = 0;
};

}  // namespace leastaction
