// The midpoint integrator of one mechanism, for any number of threads.
#pragma once

#include <memory>

#include "discrete/curvature.hpp"
#include "discrete/differentiate.hpp"
#include "discrete/lane_step.hpp"
#include "discrete/newton_step.hpp"
#include "discrete/parameters.hpp"
#include "numerics/pool.hpp"

namespace leastaction {

// A step and its derivatives, with all the memory that they work in; what a step alone does without is made when it is
// asked for.
class Workspace {
public:
    Workspace(std::shared_ptr<const Mechanism> mechanism, const MidpointSettings& settings)
        : step(std::move(mechanism), settings) {}
    MidpointStep step;
    FirstOrder& first() {
        if (!first_) first_ = std::make_unique<FirstOrder>(step.mechanism());
        return *first_;
    }
    SecondOrder& second() {
        if (!second_) second_ = std::make_unique<SecondOrder>(step.mechanism(), step.split());
        return *second_;
    }
    LaneStep& lanes() {
        if (!lanes_) lanes_ = std::make_unique<LaneStep>(step);
        return *lanes_;
    }
    ParameterSlopes& slopes() {
        if (!slopes_) slopes_ = std::make_unique<ParameterSlopes>(step.mechanism());
        return *slopes_;
    }

private:
    std::unique_ptr<LaneStep> lanes_;
    std::unique_ptr<ParameterSlopes> slopes_;
    std::unique_ptr<FirstOrder> first_;
    std::unique_ptr<SecondOrder> second_;
};

class Midpoint {
public:
    Midpoint(std::shared_ptr<const Mechanism> mechanism, const MidpointSettings& settings)
        : mechanism_(std::move(mechanism)), settings_(settings) {}
    const Mechanism& mechanism() const { return *mechanism_; }
    // Memory to work in. What was done there before leaves no trace in results: those begin with place_start(), or need
    // nothing of earlier ones.
    Pool<Workspace>::Loan workspace() const {
        return workspaces_.lend([this] { return std::make_unique<Workspace>(mechanism_, settings_); });
    }

private:
    std::shared_ptr<const Mechanism> mechanism_;
    MidpointSettings settings_;
    mutable Pool<Workspace> workspaces_;
};

}  // namespace leastaction
