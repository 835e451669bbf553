// What rows of limits that are no single entries add to second derivatives, at one stage.
#pragma once

#include <cstddef>
#include <utility>
#include <vector>

namespace leastaction {

class LimitRows {
public:
    // `places` (c): of the columns of derivatives, in matrices of `width` columns.
    LimitRows(std::size_t rows, std::vector<std::size_t> places, std::size_t width)
        : rows_(rows), places_(std::move(places)), width_(width), sum_(places_.size() * places_.size()) {}

    // Adds J' sigma J - bent at the places, with J (rows x c), sigma (rows) and bent (c x c); no bent where it is null.
    void add(const double* J, const double* sigma, const double* bent, double* to);

private:
    std::size_t rows_;
    std::vector<std::size_t> places_;
    std::size_t width_;
    std::vector<double> sum_;  // c x c
};

}  // namespace leastaction
