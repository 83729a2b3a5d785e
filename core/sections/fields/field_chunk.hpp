// Chunks of FDAT: the values of one field in a group of frames, as whole numbers (section 24 of the specification).
//
// Values are predicted from frames already decoded and from neighbours on the mesh; the remainder is coded bit by bit
// with mixed models, which also know values that may return. Begin here, then read field_chunk.cpp, which goes through
// frames and rows. field_rows finds neighbours, field_predictor predicts, field_model codes a remainder.
#pragma once

#include <span>
#include <vector>

#include "base/arithmetic.hpp"
#include "sections/fields/field_rows.hpp"

namespace pdeanim {

// How a chunk is coded. A decoded value differs from the source by at most step / 2, rounded down; the step is odd.
struct FieldCoding {
    u8 levels = 0;  // 0: frames in order; n: first every 2^n-th frame, then those between, halving the distance
    u8 step = 1;    // 1: the source itself; above: the decoded value is a prediction plus a multiple of the step
};

constexpr i64 largest_field_value = i64{1} << 36;
constexpr int most_field_levels = 8;

// Kinds of values that are no numbers are 1 not a number, 2 infinity, 3 minus infinity. Numbers have kind 0.
constexpr int field_kinds = 4;

// Encode frames x rows x components values. `kinds` has the kind of each value, or is empty if all are numbers; of
// values that are no numbers only the kind is kept.
std::vector<u8> encode_field_chunk(const FieldRows &rows, std::span<const i64> values, std::span<const u8> kinds,
                                   i64 frames, int components, FieldCoding coding);

// Functions of time and coefficients, in whole numbers: together an approximation of a field.
struct FieldTransform {
    static constexpr int most_functions = 64, most_digits = 22;

    // Add what the functions make of the coefficients to frames of `width` values.
    void add_to(std::span<i64> values, i64 frames, i64 width) const;

    std::vector<u8> digits;         // for each function, the binary digits of its coefficients behind the point
    std::vector<i64> functions;     // frames x functions, in units
    std::vector<i64> coefficients;  // rows x components x functions, at most 2^(digits + 1) in size
};

// Encode values as functions of time, coefficients and a remainder. `functions` (frames x digits.size()) are coded to
// within two units, and `coefficients` (at most 2^digits in size) as they are.
std::vector<u8> encode_transformed_field_chunk(const FieldRows &rows, std::span<const i64> values, i64 frames,
                                               int components, FieldCoding coding, FieldTransform transform);

// Return the memory of the predictors that a chunk is decoded with [bytes]: some for each component, and as many for each
// of its functions of time.
u64 field_predictor_bytes(std::span<const u8> data, i64 rows, i64 components);

// Decode to `values` and to `kinds`, which is resized, and stays empty if all values are numbers. CorruptError if the
// bytes are damaged.
FieldCoding decode_field_chunk(const FieldRows &rows, std::span<const u8> data, i64 frames, int components,
                               std::span<i64> values, std::vector<u8> &kinds);

}  // namespace pdeanim
