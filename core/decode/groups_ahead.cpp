#include "decode/groups_ahead.hpp"

#include <utility>

#include "decode/decoded_group.hpp"

namespace pdeanim {

GroupsAhead::GroupsAhead(const Container &container, const GroupTable &table, std::span<const std::size_t> groups)
    : table_(&table), groups_(groups.begin(), groups.end()), found_(groups.size()), is_over_(false), busy_(1),
      thread_([&container, &table, this] {
          work(container, table);
          --busy_;
      }) {}

void GroupsAhead::work(const Container &container, const GroupTable &table) {
    try {
        for (std::size_t k = 0; k < groups_.size(); ++k) {
            found_[k].chunks = table.chunks(container, groups_[k]);
            const std::lock_guard guard(lock_);
            ++read_;
            changed_.notify_all();
        }
        for (std::size_t k = 0; k < groups_.size(); ++k) {
            if (takes_over(k)) {
                found_[k].values = decode_group_times(table.groups()[groups_[k]], found_[k].chunks[0]);
                const std::lock_guard guard(lock_);
                found_[k].is_decoded = true;
                changed_.notify_all();
            }
            do_inserted();
        }
    } catch (...) {
        // Ignored: the caller repeats the work, which raises the error.
    }
    {
        const std::lock_guard guard(lock_);
        is_over_ = true;
        changed_.notify_all();
    }
    do_inserted();
}

// Return whether the caller is the first to decode the functions of time of the k-th group.
bool GroupsAhead::takes_over(std::size_t k) {
    const std::lock_guard guard(lock_);
    return !std::exchange(found_[k].is_taken_over, true);
}

const Chunks *GroupsAhead::chunks(std::size_t k) {
    std::unique_lock guard(lock_);
    changed_.wait(guard, [&] { return read_ > k || is_over_; });
    return read_ > k ? &found_[k].chunks : nullptr;
}

void GroupsAhead::insert(std::function<void()> task) {
    const std::lock_guard guard(lock_);
    inserted_ = std::move(task);
    if (!is_over_) return;
    ++busy_;
    later_ = std::jthread([this] {
        do_inserted();
        --busy_;
    });
}

void GroupsAhead::do_inserted() {
    std::function<void()> task;
    {
        const std::lock_guard guard(lock_);
        std::swap(task, inserted_);
    }
    if (task) task();
}

GroupCoefficients *GroupsAhead::make_coefficients(std::shared_ptr<const SpaceLayout> layout, TakenMemory taken) {
    const Chunks *read = chunks(0);
    if (!read) return nullptr;
    const std::span<const u8> chunk = (*read)[1];
    coefficients_ =
        std::make_unique<GroupCoefficients>(table_->groups()[groups_[0]], chunk, std::move(layout), std::move(taken));
    return coefficients_.get();
}

void GroupsAhead::drop_coefficients() {
    is_dropped_ = true;
    if (coefficients_) coefficients_->stop();
}

std::optional<std::vector<double>> GroupsAhead::values(std::size_t k) {
    if (found_.empty() || takes_over(k)) return {};
    std::unique_lock guard(lock_);
    changed_.wait(guard, [&] { return found_[k].is_decoded || is_over_; });
    if (!found_[k].is_decoded) return {};
    return std::move(found_[k].values);
}

}  // namespace pdeanim
