// Independent work over several threads.
#pragma once

#include <algorithm>
#include <exception>
#include <thread>
#include <vector>

namespace leastaction {

// Threads to use: as asked for, or as many as the machine has (requested <= 0) and are worth their start, which takes as
// long as a few pieces of work; never more than there is work.
inline int thread_count(int requested, int work) {
    constexpr int worth = 8;  // pieces of work a thread
    if (requested <= 0) {
        work /= worth;
        // Only where it counts: asking the machine takes microseconds.
        if (work > 1) requested = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
    }
    return std::max(1, std::min(requested, work));
}

// Calls body(begin, end) for contiguous parts of [0, n), each in a thread of its own, and waits for all of them. Where
// the machine gives no more threads, the calling one does what is left: the parts, and so the results, are the same.
// The first exception is passed on.
template <class Body>
void parallel_ranges(int n, int threads, const Body& body) {
    threads = thread_count(threads, n);
    if (threads <= 1) {
        if (n > 0) body(0, n);
        return;
    }
    std::vector<std::exception_ptr> errors(threads);
    std::vector<std::thread> pool;
    pool.reserve(threads);  // so that nothing but the start of a thread can fail while others run
    const auto run = [&](int i) {
        try {
            body(static_cast<int>(static_cast<long>(n) * i / threads),
                 static_cast<int>(static_cast<long>(n) * (i + 1) / threads));
        } catch (...) {
            errors[i] = std::current_exception();
        }
    };
    int started = 1;
    try {
        for (; started < threads; ++started) pool.emplace_back(run, started);
    } catch (const std::exception&) {  // std::system_error, or std::bad_alloc for the thread's own record
    }
    run(0);
    for (int i = started; i < threads; ++i) run(i);
    for (auto& thread : pool) thread.join();
    for (const auto& error : errors)
        if (error) std::rethrow_exception(error);
}

}  // namespace leastaction
