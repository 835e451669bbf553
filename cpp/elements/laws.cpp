#include "elements/laws.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "elements/tape_call.hpp"
#include "numerics/dual_functions.hpp"

namespace leastaction {

namespace {

constexpr int max_powers = 16;

struct KindName {
    const char* name;
    Law::Kind kind;
    int slots;  // -1: any number
};
constexpr KindName kinds[] = {
    {"linear", Law::Kind::linear, 1},   {"spring", Law::Kind::spring, 2}, {"polynomial", Law::Kind::polynomial, -1},
    {"inverse", Law::Kind::inverse, 1}, {"tanh", Law::Kind::tanh, 2},     {"taut", Law::Kind::taut, 3}};

// log(1 + exp(y)), without overflow.
double softplus(double y) { return std::max(y, 0.0) + std::log1p(std::exp(-std::abs(y))); }
double logistic_of(double y) { return 1.0 / (1.0 + std::exp(-y)); }
template <class T>
Dual<T> logistic_of(const Dual<T>& y) {
    const T l = logistic_of(y.v);
    return {l, l * (1.0 - l) * y.d};
}
template <class T>
Dual<T> softplus(const Dual<T>& y) {
    return {softplus(y.v), logistic_of(y.v) * y.d};
}

}  // namespace

Law::Law(const std::string& kind, std::vector<int> slots) : slots_(std::move(slots)) {
    for (const KindName& known : kinds) {
        if (kind != known.name) continue;
        if (slots_.empty() || slots_.size() > max_powers ||
            (known.slots >= 0 && static_cast<int>(slots_.size()) != known.slots))
            throw std::invalid_argument("law '" + kind + "': wrong number of slots");
        kind_ = known.kind;
        return;
    }
    throw std::invalid_argument("no law '" + kind + "'");
}

Law::Law(std::vector<double> breaks, std::vector<double> coefficients, int slot)
    : kind_(Kind::piecewise),
      slots_{slot},
      breaks_(std::move(breaks)),
      coefficients_(std::move(coefficients)),
      powers_(breaks_.size() < 2 ? 0 : static_cast<int>(coefficients_.size() / (breaks_.size() - 1))) {
    if (powers_ == 0 || powers_ > max_powers || coefficients_.size() != powers_ * (breaks_.size() - 1))
        throw std::invalid_argument("piecewise law: n + 1 breaks and n rows of 16 coefficients at most are needed");
}

Law::Law(std::shared_ptr<const Tape> tape, std::vector<int> slots)
    : kind_(Kind::tape), slots_(std::move(slots)), tape_(std::move(tape)) {
    if (tape_->n_inputs() != static_cast<int>(slots_.size()) + 1)
        throw std::invalid_argument("tape law: one input, and one more for every slot, are needed");
}

// Horner's scheme for a polynomial and its first two derivatives.
template <class T>
void Law::polynomial(const T& x, const T* c, int n, T out[3]) const {
    T value{}, first{}, second{};
    for (int i = n - 1; i >= 0; --i) {
        second = second * x + first;
        first = first * x + value;
        value = value * x + c[i];
    }
    out[0] = value;
    out[1] = first;
    out[2] = 2.0 * second;
}

template <class T>
void Law::evaluate(const Numbers<T>& at, const T& x, T out[3]) const {
    const auto number = [&](int k) { return at.number(slots_[k]); };
    switch (kind_) {
        case Kind::linear:
            out[0] = number(0) * x;
            out[1] = number(0);
            out[2] = T{};
            return;
        case Kind::spring: {
            const T k = number(0), stretch = x - number(1);
            out[0] = 0.5 * (k * stretch * stretch);
            out[1] = k * stretch;
            out[2] = k;
            return;
        }
        case Kind::polynomial: {
            T c[max_powers];
            const int n = static_cast<int>(slots_.size());
            for (int i = 0; i < n; ++i) c[i] = number(i);
            polynomial(x, c, n, out);
            return;
        }
        case Kind::inverse:
            out[0] = number(0) / x;
            out[1] = -out[0] / x;
            out[2] = -2.0 * (out[1] / x);
            return;
        case Kind::tanh: {
            using std::tanh;
            const T tanh_y = tanh(T(x / number(1))), slope = 1.0 - tanh_y * tanh_y;
            out[0] = number(0) * tanh_y;
            out[1] = number(0) * slope / number(1);
            out[2] = -2.0 * (tanh_y * out[1] / number(1));
            return;
        }
        case Kind::taut: {
            const T k = number(0), width = number(2), y = (x - number(1)) / width;
            const T logistic = logistic_of(y), stretch = width * softplus(y);
            out[0] = 0.5 * (k * stretch * stretch);
            out[1] = k * stretch * logistic;
            out[2] = k * (logistic * logistic + stretch * logistic * (1.0 - logistic) / width);
            return;
        }
        case Kind::piecewise: {
            const auto above = std::upper_bound(breaks_.begin() + 1, breaks_.end() - 1, value_of(x));
            const std::size_t piece = above - breaks_.begin() - 1;
            T c[max_powers];
            for (int i = 0; i < powers_; ++i) c[i] = number(0) * coefficients_[piece * powers_ + i];
            polynomial(T(x - breaks_[piece]), c, powers_, out);
            return;
        }
        case Kind::tape:
            evaluate_tape(*tape_, slots_, at, &x, 1, Order::hessian, out[0], &out[1], &out[2]);
            return;
    }
}

void Law::evaluate(const Numbers<Lanes>& at, const Lanes& x, Lanes out[3]) const {
    for (int l = 0; l < lane_count; ++l) {
        double of_lane[3];
        evaluate(at.plain(), x[l], of_lane);
        for (int order = 0; order < 3; ++order) out[order].set(l, of_lane[order]);
    }
}

template void Law::evaluate(const Numbers<double>&, const double&, double[3]) const;
template void Law::evaluate(const Numbers<Dual<double>>&, const Dual<double>&, Dual<double>[3]) const;
template void Law::evaluate(const Numbers<HyperDual>&, const HyperDual&, HyperDual[3]) const;

}  // namespace leastaction
