// A force along rates, those of balls among them: f_i = F ds'/dv_i with s' = sum factor_k (rate k).
//
// The rates of a ball are its angular velocity in the axes behind it, w = J v in the chart p = Q rx(a) ry(b) rz(c), with
//   J = [ cos b cos c   sin c   0 ]
//       [-cos b sin c   cos c   0 ]
//       [ sin b         0       1 ].
// They are no derivative of a coordinate, so this is no `CoordinateForce`: g = ds'/dv depends on place, and dg_i/dq_j has no
// symmetry.
#pragma once

#include <array>
#include <memory>
#include <utility>
#include <vector>

#include "elements/elements.hpp"
#include "elements/laws.hpp"

namespace leastaction {

// F = gain u by_rate(s'); without an input (-1), or a law, its factor is 1.
class RateForce final : public ForceOnAnyScalar<RateForce> {
public:
    // Variables with the slots of their factors; `firsts` are the first variables of all balls.
    RateForce(const std::vector<int>& variables, const std::vector<int>& factor_slots, const std::vector<int>& firsts,
              int gain_slot, int input, std::shared_ptr<const Law> by_rate);
    void curvature(const ForcePoint<double>& point, const ForceDirections& directions,
                   LocalForce<double>& out) const override;

    template <class T>
    void evaluate_on(const ForcePoint<T>& point, Order order, LocalForce<T>& out) const;

private:
    struct Turns {  // of one ball: where it stands in the support, and the slots of its factors (-1: none)
        int place;
        std::array<int, 3> slots;
    };
    // g (m), and dg_i/dq_j (m x m).
    template <class T>
    void rates(const ForcePoint<T>& point, T* g, T* bend) const;
    template <class T>
    struct Magnitude {
        T F, by_rate, by_input;
        SizeOf<T> second, mixed;  // by the rate twice, and by the rate and the input
    };
    template <class T>
    Magnitude<T> magnitude(const ForcePoint<T>& point, const T& rate) const;

    std::vector<std::pair<int, int>> plain_;  // place in the support, slot
    std::vector<Turns> turns_;
    int gain_slot_;
    std::shared_ptr<const Law> by_rate_;
};

}  // namespace leastaction
