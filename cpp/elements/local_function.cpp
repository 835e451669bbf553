#include "elements/local_function.hpp"

#include "elements/tape_call.hpp"

namespace leastaction {

namespace {

struct TapeFunction {
    std::shared_ptr<const Tape> tape;
    std::vector<int> slots;

    template <class T>
    void on(const LocalCall<T>& call) const {
        evaluate_tape(*tape, slots, call.at, call.z, call.n, call.order, call.value, call.gradient, call.hessian,
                      &call.scale);
    }
};

}  // namespace

std::shared_ptr<const LocalFunction> tape_function(std::shared_ptr<const Tape> tape, std::vector<int> slots) {
    return std::make_shared<OnAnyCall<TapeFunction>>(TapeFunction{std::move(tape), std::move(slots)});
}

}  // namespace leastaction
