// Memory for arrays that Eigen computes in.
#pragma once

#include <Eigen/Core>
#include <vector>

namespace leastaction {

// Starts where Eigen's widest packet may. In products of few rows and columns, Eigen rounds the entries that stand before
// the first such place differently, so that elsewhere the last bits would depend on what was allocated before.
using AlignedVector = std::vector<double, Eigen::aligned_allocator<double>>;

}  // namespace leastaction
