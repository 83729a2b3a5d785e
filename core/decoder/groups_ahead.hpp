// What of groups is read and decoded before the space basis is there: their functions of time need no other section.
#pragma once

#include <condition_variable>
#include <mutex>
#include <optional>
#include <span>
#include <thread>
#include <vector>

#include "decoder/group_table.hpp"

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
    // where nothing is decoded ahead, or it failed: who does it again comes upon the error, and says where it is.
    const Chunks *chunks(std::size_t k);
    std::optional<std::vector<double>> values(std::size_t k);

private:
    struct Ahead {
        Chunks chunks;
        std::vector<double> values;
    };

    void work(const Container &container, const GroupTable &table);
    void count(std::size_t &done);
    bool wait(const std::size_t &done, std::size_t k);

    std::vector<std::size_t> groups_;
    std::vector<Ahead> found_;
    std::size_t read_ = 0, decoded_ = 0;  // groups that are there, from the first on
    bool is_over_ = true;                 // no more will be
    std::mutex lock_;
    std::condition_variable changed_;
    std::jthread thread_;  // last, for it writes to the others until it ends
};

}  // namespace pdeanim
