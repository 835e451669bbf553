// Asking for memory before it is read.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <vector>

#include "optimal/stage_structure.hpp"

namespace leastaction {

// Asks for numbers of an array that are needed soon, a line of the cache at a time.
class Prefetch {
public:
    using Index = Eigen::Index;

    explicit Prefetch(Index size) : needed_((size + line - 1) / line, true) { list(); }

    // Only what stands in such parts is needed: after nothing(), of every part.
    void nothing() { std::fill(needed_.begin(), needed_.end(), false); }
    void need(Index first, Index length) {
        if (length <= 0) return;
        std::fill(needed_.begin() + first / line, needed_.begin() + (first + length - 1) / line + 1, true);
    }
    void list() {
        lines_.clear();
        for (std::size_t i = 0; i < needed_.size(); ++i) {
            if (needed_[i]) lines_.push_back(static_cast<Index>(i) * line);
        }
    }

    // What is needed of the array at `data`; null: nothing.
    void aim(const double* data) {
        data_ = data;
        next_ = data ? 0 : lines_.size();
    }
    // Asks for a part of it, of so many that are all of it together.
    void ask(Index parts) {
        const std::size_t share = (lines_.size() + parts - 1) / parts, end = std::min(next_ + share, lines_.size());
        for (; next_ < end; ++next_) Eigen::internal::prefetch(data_ + lines_[next_]);
    }

private:
    static constexpr Index line = 8;  // numbers
    std::vector<bool> needed_;
    std::vector<Index> lines_;  // where they start
    const double* data_ = nullptr;
    std::size_t next_ = 0;
};

// Of A and B of a stage: what a structure has of them.
inline void need_dynamics(const StageStructure& structure, Eigen::Index nx, Eigen::Index nu, Prefetch& A, Prefetch& B) {
    A.nothing();
    B.nothing();
    structure.each_part([&](Eigen::Index i, Eigen::Index first, Eigen::Index length) {
        const Eigen::Index in_A = std::clamp(nx - first, Eigen::Index{0}, length);
        A.need(i * nx + first, in_A);
        B.need(i * nu + std::max(first - nx, Eigen::Index{0}), length - in_A);
    });
    A.list();
    B.list();
}

}  // namespace leastaction
