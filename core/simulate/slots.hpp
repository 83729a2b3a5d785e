// What batches of sheets have in common: slots of constraints that are taken side by side.
//
// Constraints that share no particle may be taken in any order, or at once, and give the same bits. Those that do share
// one keep the order of the batch; so the width of registers does not show in a result.
#pragma once

#include <algorithm>
#include <cmath>

#include "simulate/sheets.hpp"

namespace pdeanim::xpbd {

// How many constraints are taken side by side.
constexpr int slot_size = 8;

// Constraints within the first half, within the second, and those that are of both.
enum Group { within_first, within_second, between, group_count };

inline Group within(int half) { return half == 0 ? within_first : within_second; }

struct Slots {
    std::vector<i32> items;                             // constraints, slot after slot; -1 where one is not full
    std::array<std::size_t, group_count + 1> starts{};  // slots of the groups, which follow each other
};

// Constraints of `each` particles, given in the batch's order.
Slots make_slots(std::span<const i32> members, std::size_t each, const Halves &halves);

// A number of each constraint of a slot, in registers of so many bytes,
template <int bytes> using Slot = Registers<double, slot_size, bytes>;

// and in memory.
struct alignas(64) StoredSlot {
    double numbers[slot_size];

    template <int bytes> PDEANIM_INLINE operator Slot<bytes>() const { return Slot<bytes>::at(numbers); }
    template <int bytes> PDEANIM_INLINE StoredSlot &operator=(const Slot<bytes> &slot) {
        slot.put(numbers);
        return *this;
    }
};

// Distance constraints, slot after slot.
struct DistanceSlots {
    const i32 *members;
    const double *lengths;
    double *multipliers;
};

template <class Slot> PDEANIM_INLINE Slot square_roots(const Slot &squares) {
    return Slot::by_lane([&](int lane) PDEANIM_INLINE_LAMBDA { return std::sqrt(squares[lane]); });
}

// Vectors of a slot's constraints, an axis after another.
template <class Slot> struct Vectors {
    Slot axes[3];
};

template <class Slot> PDEANIM_INLINE Slot dot(const Vectors<Slot> &u, const Vectors<Slot> &v) {
    return u.axes[0] * v.axes[0] + u.axes[1] * v.axes[1] + u.axes[2] * v.axes[2];
}

// Of a vector in each lane.
template <class Slot> PDEANIM_INLINE Vectors<Slot> vectors(const Register *each) {
    return {Slot::by_lane([&](int lane) PDEANIM_INLINE_LAMBDA { return each[lane][0]; }),
            Slot::by_lane([&](int lane) PDEANIM_INLINE_LAMBDA { return each[lane][1]; }),
            Slot::by_lane([&](int lane) PDEANIM_INLINE_LAMBDA { return each[lane][2]; })};
}

template <class Slot> PDEANIM_INLINE Vectors<Slot> vectors(const Place *places, const i32 *points) {
    return {Slot::by_lane([&](int lane) PDEANIM_INLINE_LAMBDA { return places[points[lane]].at[0]; }),
            Slot::by_lane([&](int lane) PDEANIM_INLINE_LAMBDA { return places[points[lane]].at[1]; }),
            Slot::by_lane([&](int lane) PDEANIM_INLINE_LAMBDA { return places[points[lane]].at[2]; })};
}

// Inverse ones.
template <class Slot> PDEANIM_INLINE Slot masses(const Places &places, const i32 *points) {
    return Slot::by_lane([&](int lane) PDEANIM_INLINE_LAMBDA { return places.previous[points[lane]].at[3]; });
}

// How the multipliers of a constraint stand in its slot: each of all constraints side by side, or those of the axes side by
// side, constraint after constraint, with room for a fourth.
enum class Multipliers { abreast, by_axes };

// A batch whose constraints have `each` particles and `rows` multipliers. What there are several of in a constraint
// stands in its slot one behind the other, each of all constraints side by side. Slots that are not full are filled up
// with constraints of a particle without mass to move.
class SlottedBatch : public Batch {
public:
    SlottedBatch(std::span<const i32> members, std::size_t each, const Halves &halves, std::span<double> multipliers,
                 std::size_t rows, const Scaling &scaling, Multipliers layout = Multipliers::abreast)
        : slots_(make_slots(members, each, halves)), scaling_(scaling), given_(multipliers), rows_(rows),
          layout_(layout), members_(slotted(members, each, halves.filler(0))),
          multipliers_(slots_.items.size() * room()) {
        each_multiplier([&](double &own, double &of_batch) { own = of_batch; });
        const auto begin = members_.begin();
        std::replace(begin + static_cast<std::ptrdiff_t>(slots_.starts[within_second] * each * slot_size),
                     begin + static_cast<std::ptrdiff_t>(slots_.starts[between] * each * slot_size), halves.filler(0),
                     halves.filler(1));
    }

    // Those of both halves come when each is done, all on the first one's thread.
    int stages() const override { return count(between) > 0 ? 2 : 1; }
    void solve(const Places &places, int stage, int half) override {
        if (stage == 0) {
            solve_group(places, within(half));
        } else if (half == 0) {
            solve_group(places, between);
        }
    }
    void clear(int half) override {
        clear_group(within(half));
        if (half == 0) clear_group(between);
    }
    void store() override {
        each_multiplier([](const double &own, double &of_batch) { of_batch = own; });
    }

protected:
    virtual void solve_group(const Places &places, Group group) = 0;

    // Numbers of the constraints, `each` apiece, by slot.
    template <class Number>
    std::vector<Number> slotted(std::span<const Number> numbers, std::size_t each, Number filler) const {
        const std::vector<i32> &items = slots_.items;
        std::vector<Number> found(items.size() * each, filler);
        for (std::size_t place = 0; place < items.size(); ++place) {
            for (std::size_t k = 0; k < each && items[place] >= 0; ++k) {
                found[position(place, k, each)] = numbers[items[place] * each + k];
            }
        }
        return found;
    }
    static std::size_t position(std::size_t place, std::size_t k, std::size_t each) {
        return (place / slot_size * each + k) * slot_size + place % slot_size;
    }

    std::size_t count(Group group) const { return slots_.starts[group + 1] - slots_.starts[group]; }

    // Where what there are `each` of in a constraint begins for a group.
    std::size_t first_of(Group group, std::size_t each) const { return slots_.starts[group] * each * slot_size; }

    void clear_group(Group group) { std::fill_n(multipliers_of(group), count(group) * room() * slot_size, 0.0); }

    // Where a group's multipliers begin.
    double *multipliers_of(Group group) { return multipliers_.data() + first_of(group, room()); }

    Slots slots_;
    Scaling scaling_;
    std::span<double> given_;
    std::size_t rows_;
    Multipliers layout_;
    std::vector<i32> members_;

private:
    // Numbers that a constraint's multipliers take.
    std::size_t room() const { return layout_ == Multipliers::by_axes ? 4 : rows_; }

    // Call work(multiplier in its slot, the same as it is given) for each.
    template <class Work> void each_multiplier(const Work &work) {
        for (std::size_t place = 0; place < slots_.items.size(); ++place) {
            for (std::size_t k = 0; k < rows_ && slots_.items[place] >= 0; ++k) {
                work(multipliers_[layout_ == Multipliers::by_axes ? place * room() + k : position(place, k, rows_)],
                     given_[slots_.items[place] * rows_ + k]);
            }
        }
    }

    std::vector<double> multipliers_;
};

}  // namespace pdeanim::xpbd
