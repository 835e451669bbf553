#include "elements/potentials.hpp"

namespace leastaction {

Potential::Potential(std::shared_ptr<const ConfigurationFunction> coordinate, std::shared_ptr<const Law> law)
    : coordinate_(std::move(coordinate)), law_(std::move(law)) {
    support_ = coordinate_->support();
    joints_ = coordinate_->joints();
}

template <class T>
void Potential::evaluate_on(const Placement<T>& at, const T* q, Order order, LocalTaylor<T>& out) const {
    coordinate_->evaluate(at, q, order, out);
    if (!law_) return;
    T energy[3];
    law_->evaluate(at, out.value, energy);
    out.value = energy[0];
    const std::size_t m = support_.size();
    if (order == Order::hessian)
        for (std::size_t i = 0; i < m; ++i) {
            const T slope = energy[2] * out.gradient[i];
            for (std::size_t j = 0; j < m; ++j)
                out.hessian[i * m + j] = energy[1] * out.hessian[i * m + j] + slope * out.gradient[j];
        }
    if (order != Order::value)
        for (std::size_t i = 0; i < m; ++i) out.gradient[i] = energy[1] * out.gradient[i];
}

LEASTACTION_ON_ANY_SCALAR(Potential);

}  // namespace leastaction
