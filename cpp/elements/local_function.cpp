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

void LocalFunction::evaluate(const LocalCall<Lanes>& call) const {
    thread_local std::vector<double> room;  // grows to what the largest function needs and stays
    const int n = call.n;
    room.resize(static_cast<std::size_t>(2 * n + n * n));
    double *z = room.data(), *gradient = z + n, *hessian = gradient + n;
    for (int l = 0; l < lane_count; ++l) {
        double value = 0, scale = call.scale[l];
        for (int i = 0; i < n; ++i) z[i] = call.z[i][l];
        evaluate(LocalCall<double>{call.at.plain(), z, n, call.order, value, gradient, hessian, scale});
        call.value.set(l, value);
        call.scale.set(l, scale);
        for (int i = 0; i < n && call.order != Order::value; ++i) call.gradient[i].set(l, gradient[i]);
        for (int i = 0; i < n * n && call.order == Order::hessian; ++i) call.hessian[i].set(l, hessian[i]);
    }
}

std::shared_ptr<const LocalFunction> tape_function(std::shared_ptr<const Tape> tape, std::vector<int> slots) {
    return std::make_shared<OnAnyCall<TapeFunction>>(TapeFunction{std::move(tape), std::move(slots)});
}

}  // namespace leastaction
