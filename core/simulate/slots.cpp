#include "simulate/slots.hpp"

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

Group group_of(std::span<const i32> particles, const Halves &halves) {
    const int half = halves.of(particles[0]);
    const bool is_within =
        std::all_of(particles.begin(), particles.end(), [&](i32 one) { return halves.of(one) == half; });
    return is_within ? within(half) : between;
}

// Constraints in rounds, in each of which they share no particle.
std::vector<std::size_t> in_rounds(std::vector<std::size_t> left, std::span<const i32> members, std::size_t each,
                                   const Halves &halves) {
    std::vector<std::size_t> order, later;
    std::vector<std::size_t> last_moved(static_cast<std::size_t>(halves.particles), 0);
    for (std::size_t round = 1; !left.empty(); ++round, left.swap(later), later.clear()) {
        for (const std::size_t i : left) {
            const auto own = members.subspan(i * each, each);
            const bool is_free =
                std::none_of(own.begin(), own.end(), [&](i32 one) { return last_moved[one] == round; });
            (is_free ? order : later).push_back(i);
            for (const i32 particle : own) {
                if (is_free) last_moved[particle] = round;
            }
        }
    }
    return order;
}

}  // namespace

Slots make_slots(std::span<const i32> members, std::size_t each, const Halves &halves) {
    std::array<std::vector<std::size_t>, group_count> groups;
    for (std::size_t i = 0; i < members.size() / each; ++i) {
        groups[group_of(members.subspan(i * each, each), halves)].push_back(i);
    }
    // There are few of them, all near each other: in their order, hardly two could be taken at once.
    groups[between] = in_rounds(std::move(groups[between]), members, each, halves);
    Slots slots;
    std::vector<i32> free(static_cast<std::size_t>(halves.particles),
                          0);  // the first slot in which nobody before moves it
    for (const Group group : {within_first, within_second, between}) {
        if (group == between) std::fill(free.begin(), free.end(), 0);
        Timetable table;
        std::vector<i32> places;
        for (const std::size_t i : groups[group]) {
            const auto own = members.subspan(i * each, each);
            i32 earliest = 0;
            for (const i32 particle : own) earliest = most(earliest, free[particle]);
            places.push_back(table.enter(earliest));
            for (const i32 particle : own) free[particle] = places.back() / slot_size + 1;
        }
        const std::size_t start = slots.items.size();
        slots.items.resize(start + table.slots() * slot_size, -1);
        for (std::size_t k = 0; k < places.size(); ++k)
            slots.items[start + places[k]] = static_cast<i32>(groups[group][k]);
        slots.starts[group + 1] = slots.items.size() / slot_size;
    }
    return slots;
}

}  // namespace pdeanim::xpbd
