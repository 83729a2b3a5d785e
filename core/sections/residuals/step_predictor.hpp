// Prediction of residuals on one axis: that of the reference, and a sum of changes nearby with weights that learn.
//
// Where nearly every vertex of every frame has a residual, residuals go on as they went at the same place in the frames
// before, and as at the places just before. Weights follow by normalised least mean squares, in integers.
#pragma once

#include <array>

#include "base/arithmetic.hpp"
#include "sections/residuals/residuals.hpp"

namespace pdeanim {

class StepPredictor {
public:
    static constexpr int inputs = 5;
    using Changes = std::array<i64, inputs>;

    // The residual that is expected where the reference has `reference`.
    i64 predict(i64 reference, const Changes &changes) const {
        i64 total = (reference << fraction_bits) + (1 << (fraction_bits - 1));
        for (int i = 0; i < inputs; ++i) total += weights_[i] * changes[i];
        return clamp(total >> fraction_bits, -largest_residual, largest_residual);
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
    static constexpr int fraction_bits = 16;
    static constexpr i64 largest_weight = 4 << fraction_bits;  // the sum for residuals of 2^40 stays within 63 bits
    static constexpr int input_digits = 12;   // changes are brought to so many before weights learn: squares stay small
    static constexpr i64 power_floor = 16;    // added to the sum of squares: nothing is learnt from noise
    static constexpr int learning_shift = 8;  // corrects 1/16 of a miss (2^-4 = 2^(20 - 8 - 16)) for the same changes

    Changes weights_{};
};

}  // namespace pdeanim
