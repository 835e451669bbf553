// Arrays of many megabytes, whose memory is kept for the next one of the same size.
//
// What is given back to the system has to be mapped and zeroed anew, page by page, when it is asked for again: a tenth of
// the time of an optimisation that linearises along a thousand steps. So the last few blocks are kept, up to a limit for the
// whole process. Where the system can, it is told that their contents are not needed: it takes the pages when memory is
// short, and until then they are there at once.
#pragma once

#include <cstddef>
#include <memory>

namespace leastaction {

// Memory for numbers, not initialised: whoever made it writes all of it before reading.
class LargeArray {
public:
    explicit LargeArray(std::size_t size);
    double* data() { return data_.get(); }
    const double* data() const { return data_.get(); }
    std::size_t size() const { return size_; }

private:
    struct GiveBack {
        std::size_t bytes;
        void operator()(double* data) const;
    };
    std::size_t size_;
    std::unique_ptr<double, GiveBack> data_;
};

}  // namespace leastaction
