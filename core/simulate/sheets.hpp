// Batches of constraints of sheets and ropes, swept with several constraints side by side.
//
// The result equals that of one constraint after another in the given order, to the last bit (see `Slots`). Only a
// sheet in two halves has another order: each batch solves the constraints within the halves first, then those across
// the middle. So two threads can solve one half each, whose particles stay in their caches, and meet only at the
// constraints across the middle. The order depends on the halves, not on the threads: a single thread gives the same
// bits.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <span>
#include <vector>

#include "base/lanes.hpp"
#include "simulate/sweeps.hpp"

namespace pdeanim::xpbd {

// A point in a vector register. In a current position the fourth number is unused; in a previous position it is the
// particle's inverse mass.
struct alignas(32) Place {
    double at[4];
};

using Register = Lanes<double, 4>;

struct Places {
    Place *positions;
    const Place *previous;
};

// Assigns particles to halves: those before `middle` to half 0, the others to half 1. In an undivided system, `middle`
// is the number of particles.
struct Halves {
    i32 particles, middle;

    int of(i32 particle) const { return particle >= middle ? 1 : 0; }
    // Return a particle that cannot move and that pads slots. Each half has its own, in a separate cache line.
    i32 filler(int half) const { return particles + 2 * half; }
    std::array<std::size_t, 2> range(int half) const {
        const auto start = static_cast<std::size_t>(half == 0 ? 0 : middle);
        return {start, static_cast<std::size_t>(half == 0 ? middle : particles)};
    }
    std::size_t places() const { return static_cast<std::size_t>(particles) + 4; }
};

class Batch {
public:
    virtual ~Batch() = default;
    // Return the number of stages in which the batch is solved. Within a stage both halves may run at the same time; a
    // stage begins when both halves have finished the stage before.
    virtual int stages() const = 0;
    virtual void solve(const Places &places, int stage, int half) = 0;
    // Set the multipliers of a half to 0; at first they have the values of the caller's array.
    virtual void clear(int half) = 0;
    virtual void store() = 0;
};

std::unique_ptr<Batch> make_distances(std::span<const i32> pairs, const Halves &halves, std::span<const double> lengths,
                                      std::span<double> multipliers, std::span<const double> inverse_masses,
                                      const Scaling &scaling);

// Make a batch of chains of `links` links each, in which all links of a chain are solved at once. Relaxation is not
// used. Chains in both halves must cross the middle once, from the first half to the second, all at the same link; else
// std::invalid_argument.
std::unique_ptr<Batch> make_chains(std::size_t links, std::span<const i32> chains, const Halves &halves,
                                   std::span<const double> lengths, std::span<double> multipliers,
                                   const Scaling &scaling);

std::unique_ptr<Batch> make_bending(std::span<const i32> stencils, const Halves &halves,
                                    std::span<const double> coefficients, std::span<double> multipliers,
                                    std::span<const double> inverse_masses, const Scaling &scaling);

// Batches that are solved in order.
class Sheets {
public:
    // middle: index of the first particle of the second half.
    Sheets(std::span<const double> inverse_masses, i32 middle);
    Sheets(const Sheets &) = delete;  // batches have one owner

    std::size_t particles() const { return inverse_masses_.size(); }
    const Halves &halves() const { return halves_; }
    std::span<const double> inverse_masses() const { return inverse_masses_; }
    void add(std::unique_ptr<Batch> batch) { batches_.push_back(std::move(batch)); }

    // Do one iteration over all batches. If `is_first`, multipliers start at 0.
    void solve(std::span<Point> positions, std::span<const Point> previous, bool is_first);
    // Do one or more substeps of Algorithm 1, with the fraction `keep` of the velocities in Eq. 4.
    void advance(std::span<Point> positions, std::span<Point> previous, std::span<Point> velocities,
                 std::span<const Point> accelerations, double substep, double keep, i64 substeps, i64 iterations,
                 int threads);
    // Write the multipliers back to the caller's arrays.
    void store();

private:
    void take(std::span<const Point> positions, std::span<const Point> previous);

    std::vector<double> inverse_masses_;
    Halves halves_;
    std::vector<Place> positions_, previous_;
    std::vector<std::unique_ptr<Batch>> batches_;
};

// Slots of constraints that are solved side by side, for all batches of sheets.
//
// Constraints that share no particle may be solved in any order, or side by side, with the same bits. Constraints that
// share a particle keep the order of the batch, so the width of registers does not affect the result.

// Number of constraints that are solved side by side.
constexpr int slot_size = 8;

// Groups of constraints: within the first half, within the second half, across the middle.
enum Group { within_first, within_second, between, group_count };

inline Group within(int half) { return half == 0 ? within_first : within_second; }

struct Slots {
    std::vector<i32> items;                             // index of each constraint, slot after slot; -1 is padding
    std::array<std::size_t, group_count + 1> starts{};  // first slot of each group
};

// Assign constraints of `each` particles to slots.
Slots make_slots(std::span<const i32> members, std::size_t each, const Halves &halves);

// One number for each constraint of a slot, in registers of `bytes`.
template <int bytes> using Slot = Registers<double, slot_size, bytes>;

// The same in memory.
struct alignas(64) StoredSlot {
    double numbers[slot_size];

    template <int bytes> PDEANIM_INLINE operator Slot<bytes>() const { return Slot<bytes>::at(numbers); }
    template <int bytes> PDEANIM_INLINE StoredSlot &operator=(const Slot<bytes> &slot) {
        slot.put(numbers);
        return *this;
    }
};

// Data of distance constraints, slot after slot.
struct DistanceSlots {
    const i32 *members;
    const double *lengths;
    double *multipliers;
};

template <class Slot> PDEANIM_INLINE Slot square_roots(const Slot &squares) {
    return Slot::by_lane([&](int lane) PDEANIM_INLINE_LAMBDA { return std::sqrt(squares[lane]); });
}

// A vector for each constraint of a slot, axis by axis.
template <class Slot> struct Vectors {
    Slot axes[3];
};

template <class Slot> PDEANIM_INLINE Slot dot(const Vectors<Slot> &u, const Vectors<Slot> &v) {
    return u.axes[0] * v.axes[0] + u.axes[1] * v.axes[1] + u.axes[2] * v.axes[2];
}

// Transpose vectors in registers, one per constraint, to this layout.
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

// Return the inverse masses of particles.
template <class Slot> PDEANIM_INLINE Slot masses(const Places &places, const i32 *points) {
    return Slot::by_lane([&](int lane) PDEANIM_INLINE_LAMBDA { return places.previous[points[lane]].at[3]; });
}

// Layout of the multipliers of a slot: the first multiplier of all constraints side by side, then the second; or the
// axes of one constraint side by side, padded to four, then the next constraint.
enum class Multipliers { abreast, by_axes };

// A batch whose constraints have `each` particles and `rows` multipliers. If a constraint has several numbers of a
// kind, a slot has the first one of all constraints side by side, then the second. Padding consists of constraints on a
// particle that cannot move.
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

    // The second stage solves constraints across the middle, on the first half's thread.
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

    // Arrange numbers by slot; there are `each` per constraint.
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

    // Return where a group starts in an array by slot with `each` numbers per constraint.
    std::size_t first_of(Group group, std::size_t each) const { return slots_.starts[group] * each * slot_size; }

    void clear_group(Group group) { std::fill_n(multipliers_of(group), count(group) * room() * slot_size, 0.0); }

    // Return the first multiplier of a group.
    double *multipliers_of(Group group) { return multipliers_.data() + first_of(group, room()); }

    Slots slots_;
    Scaling scaling_;
    std::span<double> given_;
    std::size_t rows_;
    Multipliers layout_;
    std::vector<i32> members_;

private:
    // Return the number of values stored for the multipliers of a constraint.
    std::size_t room() const { return layout_ == Multipliers::by_axes ? 4 : rows_; }

    // Call work(multiplier in its slot, the caller's multiplier) for every multiplier.
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
