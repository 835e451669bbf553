// The midpoint integrator of one mechanism, for any number of threads.
#pragma once

#include <memory>

#include "discrete/midpoint.hpp"
#include "numerics/pool.hpp"

namespace leastaction {

class Midpoint {
public:
    Midpoint(std::shared_ptr<const Mechanism> mechanism, const MidpointSettings& settings)
        : mechanism_(std::move(mechanism)), settings_(settings) {}
    const Mechanism& mechanism() const { return *mechanism_; }
    // A step to work in. What it did before leaves no trace in results: those begin with place_start(), or need nothing of
    // earlier ones.
    Pool<MidpointStep>::Loan step() const {
        return steps_.lend([this] { return std::make_unique<MidpointStep>(mechanism_, settings_); });
    }

private:
    std::shared_ptr<const Mechanism> mechanism_;
    MidpointSettings settings_;
    mutable Pool<MidpointStep> steps_;
};

}  // namespace leastaction
