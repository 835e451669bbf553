// Work spaces that are lent out, and kept for whoever asks next, in any thread.
#pragma once

#include <memory>
#include <mutex>
#include <utility>
#include <vector>

namespace leastaction {

template <class Space>
class Pool {
public:
    // A work space of one's own until the end of the scope; must not outlive the pool.
    class Loan {
    public:
        Loan(Pool& pool, std::unique_ptr<Space> space) : pool_(pool), space_(std::move(space)) {}
        ~Loan() {
            if (!space_) return;
            const std::lock_guard lock(pool_.lock_);
            pool_.idle_.push_back(std::move(space_));
        }
        Loan(const Loan&) = delete;
        Loan& operator=(const Loan&) = delete;
        Space& operator*() const { return *space_; }
        Space* operator->() const { return space_.get(); }
        // For a space in which something went wrong: nobody else gets it.
        void discard() { space_.reset(); }

    private:
        Pool& pool_;
        std::unique_ptr<Space> space_;
    };

    // One that is idle, or else what make() returns.
    template <class Make>
    Loan lend(const Make& make) {
        std::unique_ptr<Space> space;
        {
            const std::lock_guard lock(lock_);
            if (!idle_.empty()) {
                space = std::move(idle_.back());
                idle_.pop_back();
            } else {
                idle_.reserve(++made_);  // so that no one fails at giving back
            }
        }
        return {*this, space ? std::move(space) : make()};
    }

private:
    std::mutex lock_;
    std::vector<std::unique_ptr<Space>> idle_;
    std::size_t made_ = 0;
};

}  // namespace leastaction
