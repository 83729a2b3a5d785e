// Read and decode parts of groups before the space basis exists: functions of time need no other section, coefficients
// only the patches.
#pragma once

#include <atomic>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <thread>
#include <vector>

#include "decode/decoded_group.hpp"

namespace pdeanim {

// Another thread reads and decodes. A caller waits only for what it requests: coefficients are decoded in parallel with
// functions of time that take longer than the space basis.
class GroupsAhead {
public:
    // Nothing is decoded ahead.
    GroupsAhead() = default;

    // Begin with these groups; container and table must outlive it.
    GroupsAhead(const Container &container, const GroupTable &table, std::span<const std::size_t> groups);

    // Return the chunks of the k-th group. Null if nothing is decoded ahead, or it failed: repeating the work raises
    // the error with its place. `values` gives, once, the result of `decode_group_times`; null if no thread has begun
    // it, and then the caller does.
    const Chunks *chunks(std::size_t k);
    std::optional<std::vector<double>> values(std::size_t k);

    // Number of threads at work.
    int busy() const { return busy_; }

    // Run a task in the same thread after the current group. Objects that it uses must outlive this.
    void insert(std::function<void()> task);

    // Return the coefficients of the first group, for the caller, a task, to decode; null if it cannot be read.
    GroupCoefficients *make_coefficients(std::shared_ptr<const SpaceLayout> layout, TakenMemory taken);

    // The coefficients of the k-th group, if they have been made.
    GroupCoefficients *coefficients(std::size_t k) const {
        return k == 0 && !is_dropped_ ? coefficients_.get() : nullptr;
    }

    // Discard these groups: the layout has changed.
    void drop_coefficients();

private:
    struct Ahead {
        Chunks chunks;
        std::vector<double> values;
        bool is_taken_over = false, is_decoded = false;
    };

    void work(const Container &container, const GroupTable &table);
    void do_inserted();
    bool takes_over(std::size_t k);

    const GroupTable *table_ = nullptr;
    std::vector<std::size_t> groups_;
    std::vector<Ahead> found_;
    std::size_t read_ = 0;  // groups whose chunks are read, from the first on
    bool is_over_ = true;   // no more will be read, nor decoded
    std::mutex lock_;
    std::condition_variable changed_;
    std::function<void()> inserted_;
    std::unique_ptr<GroupCoefficients> coefficients_;
    bool is_dropped_ = false;
    std::atomic<int> busy_ = 0;
    // Last, because they write to the others until they end; the second runs inserted tasks when the first has ended.
    std::jthread thread_, later_;
};

}  // namespace pdeanim
