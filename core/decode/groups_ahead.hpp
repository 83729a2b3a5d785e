// What of groups is read and decoded before the space basis is there: their functions of time need no other section,
// coefficients the patches alone.
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

// Another thread reads and decodes. Who asks waits only for what is asked for: coefficients are decoded beside functions of
// time that take longer than the space basis.
class GroupsAhead {
public:
    // Nothing is decoded ahead.
    GroupsAhead() = default;

    // Begin with these groups; container and table must outlive it.
    GroupsAhead(const Container &container, const GroupTable &table, std::span<const std::size_t> groups);

    // Of the k-th of the groups its chunks, and what `decode_group_times` makes of them, which is handed over once. Nothing
    // where nothing is decoded ahead, or it failed: who does it again comes upon the error, and says where it is. No values
    // either where nobody has begun with them: then who asks does.
    const Chunks *chunks(std::size_t k);
    std::optional<std::vector<double>> values(std::size_t k);

    // Threads that are at work.
    int busy() const { return busy_; }

    // Do something else in the same thread, when it is done with a group. What it looks at must outlive this.
    void insert(std::function<void()> task);

    // The coefficients of the first group, which whoever calls this, from a task, then decodes; nothing where it cannot be
    // read.
    GroupCoefficients *make_coefficients(std::shared_ptr<const SpaceLayout> layout, TakenMemory taken);

    // Those of the k-th group, if they have been made.
    GroupCoefficients *coefficients(std::size_t k) const {
        return k == 0 && !is_dropped_ ? coefficients_.get() : nullptr;
    }

    // Give them up: the layout is another one.
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
    std::size_t read_ = 0;  // groups whose chunks are there, from the first on
    bool is_over_ = true;   // no more will be, nor will values
    std::mutex lock_;
    std::condition_variable changed_;
    std::function<void()> inserted_;
    std::unique_ptr<GroupCoefficients> coefficients_;
    bool is_dropped_ = false;
    std::atomic<int> busy_ = 0;
    // Last, for they write to the others until they end; the second does what is inserted when the first has ended.
    std::jthread thread_, later_;
};

}  // namespace pdeanim
