// What batches of sheets have in common: slots of constraints that are taken side by side.
//
// Constraints that share no particle may be taken in any order, or at once, and give the same bits. Those that do share
// one keep the order of the batch; so the width of registers does not show in a result.
#pragma once

#include <algorithm>

#include "xpbd/sheets.hpp"

namespace pdeanim::xpbd {

// How many constraints are taken side by side.
constexpr int slot_size = 8;

// Constraints of `each` particles, given in the batch's order, by slot: -1 where one is not full. `particles` is their
// number.
std::vector<i32> make_slots(std::span<const i32> members, std::size_t each, std::size_t particles);

// A number of each constraint of a slot.
using Slot = Lanes<double, slot_size>;

// A batch whose constraints have `each` particles and `rows` multipliers. What there are several of in a constraint
// stands in its slot one behind the other, each of all constraints side by side. Slots that are not full are filled up
// with constraints of `filler`, a particle without mass to move.
class SlottedBatch : public Batch {
public:
    SlottedBatch(std::span<const i32> members, std::size_t each, i32 filler, std::span<double> multipliers,
                 std::size_t rows, const Scaling &scaling)
        : items_(make_slots(members, each, static_cast<std::size_t>(filler))), scaling_(scaling), given_(multipliers),
          rows_(rows), members_(slotted(members, each, filler)),
          multipliers_(slotted(std::span<const double>(given_), rows_, 0.0)) {}

    void clear() override { std::fill(multipliers_.begin(), multipliers_.end(), 0.0); }
    void store() const override {
        for (std::size_t place = 0; place < items_.size(); ++place) {
            for (std::size_t k = 0; k < rows_ && items_[place] >= 0; ++k) {
                given_[items_[place] * rows_ + k] = multipliers_[position(place, k, rows_)];
            }
        }
    }

protected:
    // Numbers of the constraints, `each` apiece, by slot.
    template <class Number>
    std::vector<Number> slotted(std::span<const Number> numbers, std::size_t each, Number filler) const {
        std::vector<Number> found(items_.size() * each, filler);
        for (std::size_t place = 0; place < items_.size(); ++place) {
            for (std::size_t k = 0; k < each && items_[place] >= 0; ++k) {
                found[position(place, k, each)] = numbers[items_[place] * each + k];
            }
        }
        return found;
    }
    static std::size_t position(std::size_t place, std::size_t k, std::size_t each) {
        return (place / slot_size * each + k) * slot_size + place % slot_size;
    }

    std::size_t slot_count() const { return items_.size() / slot_size; }

    std::vector<i32> items_;  // constraints by slot
    Scaling scaling_;
    std::span<double> given_;
    std::size_t rows_;
    std::vector<i32> members_;
    std::vector<double> multipliers_;
};

}  // namespace pdeanim::xpbd
