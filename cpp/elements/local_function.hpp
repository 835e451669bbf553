// Functions of a few numbers: what a coordinate is made of places, or a force of coordinates and their rates.
#pragma once

#include <memory>

#include "elements/elements.hpp"
#include "expressions/tape.hpp"

namespace leastaction {

template <class T>
struct LocalCall {
    const Numbers<T>& at;
    const T* z;
    int n;  // values in z; gradient (n) and Hessian (n x n, row-major) have room
    Order order;
    T &value, *gradient, *hessian;
    SizeOf<T>&
        scale;  // raised to the size of the terms that cancel in the value, as far as the function knows of any but z
};
class LocalFunction {
public:
    virtual ~LocalFunction() = default;
    virtual void evaluate(const LocalCall<double>& call) const = 0;
    virtual void evaluate(const LocalCall<Dual<double>>& call) const = 0;
    virtual void evaluate(const LocalCall<HyperDual>& call) const = 0;
    void evaluate(const LocalCall<Lanes>& call) const;  // one lane after the other
};

// Lets a function state itself once, as a template on().
template <class Function>
class OnAnyCall final : public LocalFunction {
public:
    explicit OnAnyCall(Function function) : function_(std::move(function)) {}
    void evaluate(const LocalCall<double>& call) const override { function_.on(call); }
    void evaluate(const LocalCall<Dual<double>>& call) const override { function_.on(call); }
    void evaluate(const LocalCall<HyperDual>& call) const override { function_.on(call); }

private:
    Function function_;
};

// A recorded expression, whose last inputs are numbers of the mechanism.
std::shared_ptr<const LocalFunction> tape_function(std::shared_ptr<const Tape> tape, std::vector<int> slots);

}  // namespace leastaction
