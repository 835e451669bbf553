// How the middle of a step changes with its ends, where balls turn (turning.hpp).
//
// By any other variable q = (q1 + q2)/2 and v = (q2 - q1)/dt. Of a ball that is so of (s, d/dt), by which the kernel takes
// second derivatives in place of its (theta, theta'). Then the pairs of balls are those of any joint, but for second
// derivatives of (theta, nu) by the ends.
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
    // The derivatives by (s, d) of the field of a ball, where duals are taken along it (0 before).
    void set_field(std::size_t ball, const Turning::Matrix6& slope);

    // Second derivatives of a ball by (s, d) that are none of the kernel's, times `factor` those of dt L: false where it moves no
    // mass, and so is none of joints().
    bool set_own(std::size_t ball, const Turning::Matrix6& bend, double factor);

    // For the kernel: the joints of balls by (s, d/dt).
    std::span<const TurnedJoints> joints() const { return joints_; }

    // Calls f(k, ByEnds) for every variable k that variable i of the kernel depends on, itself but for balls.
    template <class F>
    void each_end(int i, const F& f) const {
        const int ball = ball_of_[i];
        if (ball < 0) return f(i, ByEnds{0.5, 0.5, -rate_, rate_});
        balls_[ball].middle.ends(rate_).each(i, f);
    }
    // The same of the change of variable i of the field, of balls alone.
    template <class F>
    void each_field_end(int i, const F& f) const {
        if (ball_of_[i] >= 0) balls_[ball_of_[i]].field.ends(rate_).each(i, f);
    }
    // (theta, theta') of a ball by turns of the start and the end.
    const Turning::Matrix6& by_ends(std::size_t ball) const { return balls_[ball].middle.ends(rate_).by; }
    int ball_of(int variable) const { return ball_of_[variable]; }  // -1: none

private:
    using Matrix6 = Turning::Matrix6;
    struct Ends {
        int first;
        Matrix6 by;  // (theta, theta') by the start and the end
        template <class F>
        void each(int i, const F& f) const {
            const int row = i - first;
            for (int k = 0; k < 3; ++k)
                f(first + k, ByEnds{by.aa(row, k), by.ab(row, k), by.ba(row, k), by.bb(row, k)});
        }
    };
    // By (s, d/dt), and by the ends where these are asked for.
    class Slopes {
    public:
        const Matrix6& set(int variable, const Matrix6& of) {
            ends_.first = variable;
            made_ = false;
            return of_ = of;
        }
        const Ends& ends(double rate) const {
            if (!made_) make(rate);
            return ends_;
        }

    private:
        void make(double rate) const;
        Matrix6 of_;
        mutable Ends ends_;
        mutable bool made_ = false;
    };
    struct TurnedBall {
        Slopes middle, field;
    };
    void set_balls(const std::vector<Turning>& turnings);
    template <class F>
    [[gnu::noinline]] void visit_turned(const F& f) const {
        f(*this);
    }
    Matrix6 scaled(const Matrix6& by_middle) const;

    const Mechanism& mechanism_;
    std::vector<int> ball_of_;
    std::vector<TurnedBall> balls_;
    std::vector<TurnedJoints> joints_;  // of balls that move masses
    std::vector<int> place_in_joints_;  // by ball; -1: none
    double dt_ = 0, rate_ = 0;
};

}  // namespace leastaction
