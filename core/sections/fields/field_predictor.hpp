// Predictions of the values of a field, and tables of values that may return.
#pragma once

#include <array>
#include <vector>

#include "base/arithmetic.hpp"
#include "entropy/learning_predictor.hpp"
#include "sections/fields/field_chunk.hpp"

namespace pdeanim {

constexpr i64 largest_field_prediction = 2 * largest_field_value;

using FieldPredictor = LearningPredictor<6, largest_field_prediction>;

// For each context, the value that followed it last, and how often in a row that value was right.
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

    // Return the hash of a context that continues with a number.
    static u64 extended(u64 context, i64 number) { return (context + static_cast<u64>(number)) * factor; }

private:
    static constexpr int table_bits = 14;
    static constexpr u64 factor = 0x9E3779B97F4A7C15u;  // 2^64 over the golden ratio
    std::vector<Slot> slots_ = std::vector<Slot>(1 << table_bits);
};

}  // namespace pdeanim
