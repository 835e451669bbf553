#include "numerics/large_array.hpp"

#include <algorithm>
#include <array>
#include <mutex>
#include <new>

#if defined(__unix__) || defined(__APPLE__)
#include <sys/mman.h>
#endif

namespace leastaction {

namespace {

constexpr std::size_t page = 4096;
void release(void* data) { ::operator delete(data, std::align_val_t{page}); }

constexpr std::size_t least_kept = std::size_t{1} << 23;  // bytes of a block; smaller ones the C library keeps
constexpr std::size_t most_kept = std::size_t{1} << 28;   // bytes of all of them together

// The blocks that nobody uses, the newest last. One for the process, since what is made again and again is made by a new
// object each time; no result depends on what is in it.
class Kept {
public:
    void* take(std::size_t bytes) {
        const std::lock_guard lock(lock_);
        const auto found = std::find_if(blocks_.begin(), blocks_.begin() + count_,
                                        [bytes](const Block& block) { return block.bytes == bytes; });
        if (found == blocks_.begin() + count_) return nullptr;
        void* data = found->data;
        remove(found);
        return data;
    }

    void keep(void* data, std::size_t bytes) {
        const std::lock_guard lock(lock_);
        while (count_ == blocks_.size() || (count_ > 0 && total_ + bytes > most_kept)) {
            release(blocks_.front().data);
            remove(blocks_.begin());
        }
        blocks_[count_++] = {data, bytes};
        total_ += bytes;
    }

private:
    struct Block {
        void* data;
        std::size_t bytes;
    };
    using Blocks = std::array<Block, 16>;

    void remove(Blocks::iterator block) {
        total_ -= block->bytes;
        std::move(block + 1, blocks_.begin() + count_, block);
        --count_;
    }

    std::mutex lock_;
    Blocks blocks_{};
    std::size_t count_ = 0, total_ = 0;
};

// Never destroyed: arrays may outlive everything else when a process ends.
Kept& kept() {
    static Kept* const blocks = new Kept;
    return *blocks;
}

std::size_t whole_pages(std::size_t numbers) {
    if (numbers > static_cast<std::size_t>(-1) / sizeof(double) - page) throw std::bad_alloc();
    return std::max(page, (numbers * sizeof(double) + page - 1) / page * page);
}

double* take(std::size_t bytes) {
    void* data = bytes < least_kept ? nullptr : kept().take(bytes);
    return static_cast<double*>(data ? data : ::operator new(bytes, std::align_val_t{page}));
}

}  // namespace

LargeArray::LargeArray(std::size_t size) : size_(size), data_(take(whole_pages(size)), GiveBack{whole_pages(size)}) {}

void LargeArray::GiveBack::operator()(double* data) const {
    if (bytes < least_kept || bytes > most_kept) return release(data);
#ifdef MADV_FREE
    madvise(data, bytes, MADV_FREE);
#endif
    kept().keep(data, bytes);
}

}  // namespace leastaction
