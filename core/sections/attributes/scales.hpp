// What numbers of attributes that measure are: codes on a grid that holds them exactly, or places among all float32.
//
// Texture coordinates and colours are seldom any float32: most are fractions of 255, of a power of two or of ten, or were
// turned upside down (1 - v) after they were; and many take few values. All of it is found here, and nothing is lost: a
// code gives the float32 back to the last bit, the sign of a zero and the payload of what is no number included.
#pragma once

#include <span>
#include <vector>

#include "base/arithmetic.hpp"

namespace pdeanim {

constexpr int linear_bits = 30;  // of a value, in whatever unit makes the largest fit
constexpr i64 largest_linear = i64{1} << linear_bits;
constexpr i64 largest_code = (i64{1} << 31) - 1;  // codes are numbers of 32 bits, one of them the sign
constexpr i64 largest_shift = 127;  // values below 2^-97 are so near to 0 that how near does not help to predict them
constexpr int most_channels = 4;

// What the codes of a channel stand for: code / divisor; 1 - code / divisor; the float32 of that place in their order.
struct Scale {
    enum Kind : i64 { fraction, complement, place };

    Kind kind = fraction;
    i64 divisor = 1;

    float value_of(i32 code) const;

    // The value of a code times 2^shift; 0 for what is no number or too small, and within `largest_linear`.
    i64 linear_of(i64 code, int shift) const;

    // A code whose value is close to linear / 2^shift, or as close as codes come.
    i64 code_near(i64 linear, int shift) const;
};

struct Scales {
    std::vector<Scale> of_channel;
    int shift = 0;  // values times 2^shift are within 2^30

    int channels() const { return static_cast<int>(of_channel.size()); }
};

// Values as codes, in rows of so many channels.
struct Channels {
    std::vector<i32> codes;
    Scales scales;
};

// Of uint8 values, which are their own codes.
Scales byte_scales(int channels);

// Codes of float32 values in rows; divisor: of a grid that is tried beside the usual ones.
Channels codes_of_floats(std::span<const float> values, int channels, i64 divisor);

// Move values to the nearest points of a grid no farther than `tolerance` from any of them; the grid's divisor. Where there
// is no such grid of 32-bit codes, or values are on a coarser one, they stay as they are.
i64 round_within(std::span<float> values, int channels, double tolerance);

}  // namespace pdeanim
