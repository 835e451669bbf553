// Functions of one number: the energy of a spring by its length, a force by a velocity.
#pragma once

#include <memory>
#include <string>

#include "elements/elements.hpp"
#include "expressions/tape.hpp"

namespace leastaction {

// Its numbers are slots of the mechanism. In each case x is the argument:
//   linear      k: k x                            spring   k, x0: k/2 (x - x0)^2
//   polynomial  c0, c1, ... (16 at most): sum c_i x^i          inverse  c: c/x
//   tanh        a, w: a tanh(x/w)                 taut     k, x0, w: k/2 w^2 log(1 + exp((x - x0)/w))^2
//   piecewise   k: k times the polynomial of the interval (the first and the last carry on outside)
//   tape        the numbers of an expression
class Law {
public:
    enum class Kind { linear, spring, polynomial, inverse, tanh, taut, piecewise, tape };

    // Throws std::invalid_argument for an unknown kind or a wrong number of slots.
    Law(const std::string& kind, std::vector<int> slots);
    // Pieces: breaks ascending (n + 1), coefficients of (x - breaks[i])^j in rows of ascending powers.
    Law(std::vector<double> breaks, std::vector<double> coefficients, int slot);
    Law(std::shared_ptr<const Tape> tape, std::vector<int> slots);

    // Value, first and second derivative.
    template <class T>
    void evaluate(const Numbers<T>& at, const T& x, T out[3]) const;
    void evaluate(const Numbers<Lanes>& at, const Lanes& x, Lanes out[3]) const;  // one lane after the other

private:
    template <class T>
    void polynomial(const T& x, const T* c, int n, T out[3]) const;

    Kind kind_;
    std::vector<int> slots_;
    std::vector<double> breaks_, coefficients_;
    int powers_ = 0;  // coefficients of a piece
    std::shared_ptr<const Tape> tape_;
};

extern template void Law::evaluate(const Numbers<double>&, const double&, double[3]) const;
extern template void Law::evaluate(const Numbers<Dual<double>>&, const Dual<double>&, Dual<double>[3]) const;
extern template void Law::evaluate(const Numbers<HyperDual>&, const HyperDual&, HyperDual[3]) const;

}  // namespace leastaction
