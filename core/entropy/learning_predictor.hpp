// Predicts a number as a base plus a weighted sum of changes. The weights learn by normalised least mean squares, in
// integers.
#pragma once

#include <array>

#include "base/arithmetic.hpp"

namespace pdeanim {

template <int input_count, i64 largest_prediction> class LearningPredictor {
public:
    static constexpr int inputs = input_count, fraction_bits = 16;
    using Changes = std::array<i64, inputs>;

    LearningPredictor() = default;
    explicit LearningPredictor(const Changes &weights) : weights_(weights) {}

    i64 predict(i64 base, const Changes &changes) const {
        i64 total = (base << fraction_bits) + (1 << (fraction_bits - 1));
        for (int i = 0; i < inputs; ++i) total += weights_[i] * changes[i];
        return clamp(total >> fraction_bits, -largest_prediction, largest_prediction);
    }

    // Move the weights in the direction that makes the miss smaller.
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
    static constexpr i64 largest_weight = 4 << fraction_bits;  // with changes up to 2^40 the sum has at most 63 bits
    static constexpr int input_digits = 12;  // changes are shifted to this many digits, so that squares stay small
    static constexpr i64 power_floor = 16;   // added to the sum of squares, so that nothing is learned from noise
    // A weight step corrects 1/16 of a miss (2^-4 = 2^(20 - 8 - 16)) if the same changes occur again. With 9 the bytes
    // of fields grow by 0.5 %.
    static constexpr int learning_shift = 8;

    Changes weights_{};
};

}  // namespace pdeanim
