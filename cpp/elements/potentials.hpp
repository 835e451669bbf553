// Potential energies V(q) besides uniform gravity, which the kernel of the Lagrangian has.
#pragma once

#include <memory>

#include "elements/elements.hpp"
#include "elements/laws.hpp"

namespace leastaction {

// V = law(s(q)), or the coordinate itself where there is no law.
class Potential final : public OnAnyScalar<Potential> {
public:
    Potential(std::shared_ptr<const ConfigurationFunction> coordinate, std::shared_ptr<const Law> law);

    template <class T>
    void evaluate_on(const Placement<T>& at, const T* q, Order order, LocalTaylor<T>& out) const;

private:
    std::shared_ptr<const ConfigurationFunction> coordinate_;
    std::shared_ptr<const Law> law_;
};

}  // namespace leastaction
