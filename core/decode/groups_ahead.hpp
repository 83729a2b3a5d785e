// Reads and decodes parts of groups while the space basis is being built: functions of time need no other section, and
// coefficients need only the patches.
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

// Groups that another thread reads and decodes. A caller waits only for the parts that it requests: coefficients are
// decoded in parallel with functions of time, which may take longer than the space basis.
class GroupsAhead {
public:
    // Decode nothing ahead.
    GroupsAhead() = default;

    // Begin to read and decode these groups; `container` and `table` must outlive this object.
    GroupsAhead(const Container &container, const GroupTable &table, std::span<const std::size_t> groups);

    // Return the chunks of the k-th group. Null if nothing is decoded ahead, or reading failed: the caller then reads
    // them itself, and so raises the error with its position.
    const Chunks *chunks(std::size_t k);
    std::optional<std::vector<double>> values(std::size_t k);

    // Return the number of threads that are at work.
    int busy() const { return busy_; }

    // Run a task in the same thread after the current group. The objects that it uses must outlive this object.
    void insert(std::function<void()> task);

    // Return the coefficients of the first group, which the caller, a task, must decode; null if its chunks cannot be
    // read.
    GroupCoefficients *make_coefficients(std::shared_ptr<const SpaceLayout> layout, TakenMemory taken);

    // Return the coefficients of the k-th group; null if `make_coefficients` has not made them.
    GroupCoefficients *coefficients(std::size_t k) const {
        return k == 0 && !is_dropped_ ? coefficients_.get() : nullptr;
    }

    // Discard the coefficients: their layout turned out to be wrong.
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
    std::size_t read_ = 0;  // number of groups whose chunks are read
    bool is_over_ = true;   // whether the thread has stopped reading and decoding
    std::mutex lock_;
    std::condition_variable changed_;
    std::function<void()> inserted_;
    std::unique_ptr<GroupCoefficients> coefficients_;
    bool is_dropped_ = false;
    std::atomic<int> busy_ = 0;
    // Declared last, so that they end before the members they write to are destroyed. The second thread runs a task
    // that is inserted after the first one has ended.
    std::jthread thread_, later_;
};

}  // namespace pdeanim
