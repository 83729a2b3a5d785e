// Divide work on many items among threads.
//
// Each thread writes only data that no other thread reads, so no result depends on the number of threads.
#pragma once

#include <atomic>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

#include "base/arithmetic.hpp"

namespace pdeanim {

// Call work(first, end) on several threads, for ranges that together cover the items 0 to count - 1 once. Ranges are
// equal in size, not in work: a thread that is done takes the next one.
template <class Work> void in_shares(i64 count, int threads, const Work &work, i64 shares_a_thread = 4) {
    const i64 workers = least<i64>(threads, count);
    if (workers < 2) {
        if (count > 0) work(i64{0}, count);
        return;
    }
    const i64 shares = least(shares_a_thread * workers, count);
    std::atomic<i64> next = 0;
    std::exception_ptr failure;
    std::mutex lock;
    const auto take = [&] {
        try {
            for (i64 share = next++; share < shares; share = next++) {
                work(count * share / shares, count * (share + 1) / shares);
            }
        } catch (...) {
            const std::lock_guard guard(lock);
            failure = std::current_exception();
        }
    };
    {
        std::vector<std::jthread> others;
        for (i64 other = 1; other < workers; ++other) others.emplace_back(take);
        take();
    }
    if (failure) std::rethrow_exception(failure);
}

}  // namespace pdeanim
