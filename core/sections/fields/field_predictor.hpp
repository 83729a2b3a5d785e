// Predictions of the values of a field, and tables of values that may return.
#pragma once

#include <array>
#include <vector>

#include "base/arithmetic.hpp"
#include "sections/fields/field_chunk.hpp"

namespace pdeanim {

constexpr i64 largest_field_prediction = 2 * largest_field_value;

// A prediction: a base plus a sum of changes, with weights that learn by normalised least mean squares, in integers.
class FieldPredictor {
public:
    static constexpr int inputs = 6, fraction_bits = 16;
    using Changes = std::array<i64, inputs>;

    explicit FieldPredictor(const Changes &weights) : weights_(weights) {}

    i64 predict(i64 base, const Changes &changes) const {
        i64 total = (base << fraction_bits) + (1 << (fraction_bits - 1));
        for (int i = 0; i < inputs; ++i) total += weights_[i] * changes[i];
        return clamp(total >> fraction_bits, -largest_field_prediction, largest_field_prediction);
    }

    // Move the weights so that they would have missed by less.
    void learn(Changes changes, i64 miss) {
        i64 largest = size_of(miss);
        for (const i64 change : changes) largest = most(largest, size_of(change));
        const int scale = most(0, bit_length(largest) - input_digits);
        i64 power = power_floor;
        for (i64 &change : changes) {
            change >>= scale;
            power += change * change;
        }
        const i64 gain = floor_divide((miss >> scale) << 20, power);
        for (int i = 0; i < inputs; ++i) {
            weights_[i] = clamp(weights_[i] + ((gain * changes[i]) >> learning_shift), -largest_weight, largest_weight);
        }
    }

private:
    static constexpr i64 largest_weight = 4 << fraction_bits;
    static constexpr int input_digits = 12;  // changes are shifted to this many digits, so that squares stay small
    static constexpr i64 power_floor = 16;   // added to the sum of squares, so that nothing is learned from noise
    static constexpr int learning_shift =
        8;  // corrects 1/16 of a miss for the same changes; 9 costs 0.5 % of the bytes

    Changes weights_;
};

// Values that followed a context: the latest one, and how often in a row it was right.
class FollowerTable {
public:
    static constexpr int most_confidence = 7;
    struct Slot {
        i64 value = 0;
        int confidence = 0;  // 0: nothing is known

        void learn(i64 next) {
            confidence = value == next ? least(confidence + 1, most_confidence) : 1;
            value = next;
        }
    };

    Slot &at(u64 context) { return slots_[((context ^ context >> 29) * factor) >> (64 - table_bits)]; }

    // A context that goes on with a number.
    static u64 extended(u64 context, i64 number) { return (context + static_cast<u64>(number)) * factor; }

private:
    static constexpr int table_bits = 14;
    static constexpr u64 factor = 0x9E3779B97F4A7C15u;  // 2^64 over the golden ratio
    std::vector<Slot> slots_ = std::vector<Slot>(1 << table_bits);
};

}  // namespace pdeanim
