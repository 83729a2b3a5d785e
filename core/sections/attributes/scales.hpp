// Codes of measured attributes: points on a grid that holds them exactly, or places among all float32 numbers.
//
// Texture coordinates and colours are seldom arbitrary float32 numbers: most are fractions of 255, of a power of two or
// of ten, or such fractions mirrored (1 - v); and many take few values. All of this is detected, without loss: a code
// restores the float32 to the last bit, including the sign of a zero and the payload of a NaN.
#pragma once

#include <span>
#include <vector>

#include "base/arithmetic.hpp"

namespace pdeanim {

constexpr int linear_bits = 30;  // bits of a linear value, in the unit in which the largest fits
constexpr i64 largest_linear = i64{1} << linear_bits;
constexpr i64 largest_code = (i64{1} << 31) - 1;  // codes have 32 bits, one of them the sign
constexpr i64 largest_shift = 127;  // values below 2^-97 are so near to 0 that their size does not help to predict them
constexpr int most_channels = 4;

// Meaning of a channel's codes: code / divisor; 1 - code / divisor; the float32 at that place in their order.
struct Scale {
    enum Kind : i64 { fraction, complement, place };

    Kind kind = fraction;
    i64 divisor = 1;

    float value_of(i32 code) const;

    // Return the value of a code times 2^shift; 0 for a NaN or a tiny value, clamped to `largest_linear`.
    i64 linear_of(i64 code, int shift) const;

    // Return a code whose value is close to linear / 2^shift, or as close as codes come.
    i64 code_near(i64 linear, int shift) const;
};

struct Scales {
    std::vector<Scale> of_channel;
    int shift = 0;  // values times 2^shift are within 2^30

    int channels() const { return static_cast<int>(of_channel.size()); }
};

// Values as codes, in rows of `channels` numbers.
struct Channels {
    std::vector<i32> codes;
    Scales scales;
};

// Scales of uint8 values, which are their own codes.
Scales byte_scales(int channels);

// Return codes of float32 values in rows; divisor: of a grid to try besides the usual ones.
Channels codes_of_floats(std::span<const float> values, int channels, i64 divisor);

// Move values to the nearest points of a grid at most `tolerance` away from any of them; return the grid's divisor. If
// there is no such grid of 32-bit codes, or values are on a coarser one, leave them.
i64 round_within(std::span<float> values, int channels, double tolerance);

}  // namespace pdeanim
