#include "xpbd/slots.hpp"

namespace pdeanim::xpbd {

namespace {

// Slots that fill up.
class Timetable {
public:
    // The first place in the slot `earliest`, or a later one, that is free until now.
    i32 enter(i32 earliest) {
        const i32 slot = open_from(earliest), place = slot * slot_size + taken_[slot]++;
        if (taken_[slot] == slot_size) next_[slot] = slot + 1;
        return place;
    }
    std::size_t slots() const { return next_.size(); }

private:
    i32 open_from(i32 slot) {
        while (true) {
            while (static_cast<i32>(next_.size()) <= slot) {
                next_.push_back(static_cast<i32>(next_.size()));
                taken_.push_back(0);
            }
            if (next_[slot] == slot) return slot;
            const i32 ahead = next_[slot];
            if (ahead < static_cast<i32>(next_.size())) next_[slot] = next_[ahead];
            slot = ahead;
        }
    }

    std::vector<i32> next_, taken_;  // next_: the slot itself, or a later one where it is full
};

}  // namespace

std::vector<i32> make_slots(std::span<const i32> members, std::size_t each, std::size_t particles) {
    Timetable table;
    std::vector<i32> free(particles, 0);  // the first slot in which nobody before moves a particle
    std::vector<i32> places(members.size() / each);
    for (std::size_t i = 0; i < places.size(); ++i) {
        const auto own = members.subspan(i * each, each);
        i32 earliest = 0;
        for (const i32 particle : own) earliest = most(earliest, free[particle]);
        places[i] = table.enter(earliest);
        for (const i32 particle : own) free[particle] = places[i] / slot_size + 1;
    }
    std::vector<i32> items(table.slots() * slot_size, -1);
    for (std::size_t i = 0; i < places.size(); ++i) items[places[i]] = static_cast<i32>(i);
    return items;
}

}  // namespace pdeanim::xpbd
