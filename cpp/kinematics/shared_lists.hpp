// Lists of which most are another one with one more entry, such as the paths from the root to every joint of a tree. What a
// list shares with the one before is stored once, so the paths of a chain take memory in proportion to its length.
#pragma once

#include <algorithm>
#include <span>
#include <utility>
#include <vector>

namespace leastaction {

class SharedLists {
public:
    // Adds the list `from` (-1: the empty one) with `last` behind it, and returns its number.
    int extend(int from, int last) {
        auto [first, end] = from < 0 ? std::pair(entries_.size(), entries_.size()) : ranges_[from];
        if (end != entries_.size()) {
            const std::size_t begin = entries_.size();
            entries_.resize(begin + (end - first));
            std::copy_n(entries_.begin() + first, end - first, entries_.begin() + begin);
            first = begin;
        }
        entries_.push_back(last);
        return push(first, entries_.size());
    }
    // Adds a list, which may be the list `like` with one more entry.
    int add(const std::vector<int>& list, int like) {
        if (list.empty()) return push(entries_.size(), entries_.size());
        const auto shared = like < 0 ? std::span<const int>{} : (*this)[like];
        if (shared.size() + 1 == list.size() && std::equal(shared.begin(), shared.end(), list.begin()))
            return extend(shared.empty() ? -1 : like, list.back());
        entries_.insert(entries_.end(), list.begin(), list.end());
        return push(entries_.size() - list.size(), entries_.size());
    }
    std::span<const int> operator[](std::size_t list) const {
        const auto [first, end] = ranges_[list];
        return {entries_.data() + first, end - first};
    }
    std::size_t size() const { return ranges_.size(); }

private:
    int push(std::size_t first, std::size_t end) {
        ranges_.emplace_back(first, end);
        return static_cast<int>(ranges_.size()) - 1;
    }
    std::vector<int> entries_;
    std::vector<std::pair<std::size_t, std::size_t>> ranges_;
};

}  // namespace leastaction
