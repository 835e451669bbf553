#include "optimal/limit_rows.hpp"

#include <algorithm>

namespace leastaction {

void LimitRows::add(const double* J, const double* sigma, const double* bent, double* to) {
    const std::size_t c = places_.size();
    if (bent)
        std::transform(bent, bent + c * c, sum_.begin(), [](double value) { return -value; });
    else
        std::fill(sum_.begin(), sum_.end(), 0.0);
    for (std::size_t r = 0; r < rows_; ++r, J += c) {
        for (std::size_t a = 0; a < c; ++a) {
            const double weighed = sigma[r] * J[a];
            if (weighed == 0.0) continue;  // such as strings, each of which depends on few entries
            double* row = sum_.data() + a * c;
            for (std::size_t b = 0; b < c; ++b) row[b] += weighed * J[b];
        }
    }
    for (std::size_t a = 0; a < c; ++a) {
        double* row = to + places_[a] * width_;
        for (std::size_t b = 0; b < c; ++b) row[places_[b]] += sum_[a * c + b];
    }
}

}  // namespace leastaction
