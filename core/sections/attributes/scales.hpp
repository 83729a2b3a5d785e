// Codes of measured attributes: points on a grid that holds the values exactly, or ranks among all float32 numbers.
//
// Texture coordinates and colours are seldom arbitrary float32 numbers. Most are fractions of 255, of a power of two or
// of ten, or such fractions mirrored (1 - v); and many take few values. All of this is detected, without loss: a code
// restores the float32 to the last bit, including the sign of a zero and the payload of a NaN.
#pragma once

#include <span>
#include <vector>

#include "base/arithmetic.hpp"

namespace pdeanim {

constexpr int linear_bits = 30;  // digits of a linear value; the unit is chosen so that the largest one fits
constexpr i64 largest_linear = i64{1} << linear_bits;
constexpr i64 largest_code = (i64{1} << 31) - 1;  // codes have 32 bits, one of them the sign
constexpr i64 largest_shift = 127;                // for prediction, values below 2^-97 count as 0
constexpr int most_channels = 4;

// Meaning of a channel's codes: the value is code / divisor, or 1 - code / divisor, or the float32 of that rank among
// all float32 numbers.
struct Scale {
    enum Kind : i64 { fraction, complement, place };

    Kind kind = fraction;
    i64 divisor = 1;

    float value_of(i32 code) const;

    // Return the value of a code times 2^shift, clamped to `largest_linear`; 0 for a NaN or a tiny value.
    i64 linear_of(i64 code, int shift) const;

    // Return the code whose value is about linear / 2^shift.
    i64 code_near(i64 linear, int shift) const;
};

struct Scales {
    std::vector<Scale> of_channel;
    int shift = 0;  // unit of linear values: values times 2^shift are within 2^30

    int channels() const { return static_cast<int>(of_channel.size()); }
};

// Values as codes, in rows of `channels` numbers.
struct Channels {
    std::vector<i32> codes;
    Scales scales;
};

// Return the scales of uint8 values, which are their own codes.
Scales byte_scales(int channels);

// Return the codes of float32 values in rows. divisor: divisor of a grid to try in addition to the usual ones.
Channels codes_of_floats(std::span<const float> values, int channels, i64 divisor);

// Move all values to the nearest points of a grid, each by at most `tolerance`; return the grid's divisor. Values stay
// unchanged if no such grid has 32-bit codes, or if they already lie on a coarser grid.
i64 round_within(std::span<float> values, int channels, double tolerance);

}  // namespace pdeanim
