// Which steps are trusted, and when an iteration is: root.cpp says why, newton_step.cpp how.
#pragma once

namespace leastaction::trust {

constexpr double small_turn = 0.2;        // rad: no more than this between two roots' Newton matrices
constexpr double medium_turn = 0.5;       // rad: nor than this, where the last step turned by as much
constexpr double turn_change = 0.1;       // rad: within this
constexpr double pivot_change = 1.5;      // factor: no pivot changes by more
constexpr double direction_change = 0.3;  // part: nor a constraint's gradient by more
constexpr double limit_part = 0x1p-20;    // part of the time step that is as good as none

constexpr double slow_contraction = 0.05;  // rate: an iteration that gains less asks for a fresh Newton matrix
constexpr double no_contraction = 0.5;     // rate: and so does one that gains less with the matrix of an earlier step
constexpr double rounding_floor = 1e-9;    // relative residual: where it stops falling below this, rounding is reached

}  // namespace leastaction::trust
