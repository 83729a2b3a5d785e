// Chunks of FDAT: the values of one field in a group of frames, as whole numbers (24 of the specification).
//
// Values are predicted from frames already decoded and from neighbours on the mesh. The remainders are coded bit by bit
// with mixed models, which also know candidates: values that may return. Begin here, then read field_chunk.cpp, which
// goes through frames and rows. field_rows finds neighbours, field_predictor predicts, field_model codes a remainder.
#pragma once

#include <span>
#include <vector>

#include "base/arithmetic.hpp"
#include "sections/fields/field_rows.hpp"

namespace pdeanim {

// How a chunk is coded. A decoded value differs from the source by at most half a step, rounded down; the step is odd.
struct FieldCoding {
    u8 levels = 0;  // 0: frames in order; n: first every 2^n-th frame, then the frames halfway between, and so on
    u8 step = 1;    // 1: values are exact; more: remainders are multiples of this step
};

constexpr i64 largest_field_value = i64{1} << 36;
constexpr int most_field_levels = 8;

// Number of kinds of values: 0 is a finite number, 1 not a number, 2 infinity, 3 minus infinity.
constexpr int field_kinds = 4;

// Encode values of shape (frames, rows, components). kinds: the kind of each value; empty if all are finite. Values
// that are not finite are reduced to their kind.
std::vector<u8> encode_field_chunk(const FieldRows &rows, std::span<const i64> values, std::span<const u8> kinds,
                                   i64 frames, int components, FieldCoding coding);

// Functions of time and coefficients, as whole numbers, whose products approximate a field.
struct FieldTransform {
    static constexpr int most_functions = 64, most_digits = 22;

    // Add the products to values: `frames` frames of `width` values.
    void add_to(std::span<i64> values, i64 frames, i64 width) const;

    std::vector<u8> digits;         // for each function, the number of fractional digits of its coefficients
    std::vector<i64> functions;     // (frames, functions)
    std::vector<i64> coefficients;  // (rows, components, functions), at most 2^(digits + 1) in magnitude
};

// Encode values as functions of time, coefficients and a remainder. functions: (frames, digits.size()), coded to within
// two units; coefficients: at most 2^digits in magnitude, coded exactly.
std::vector<u8> encode_transformed_field_chunk(const FieldRows &rows, std::span<const i64> values, i64 frames,
                                               int components, FieldCoding coding, FieldTransform transform);

// Return the memory of the predictors that decoding a chunk takes [bytes]: a fixed amount for each component, and as
// much for each of its functions of time.
u64 field_predictor_bytes(std::span<const u8> data, i64 rows, i64 components);

// Decode a chunk to `values` and `kinds`; `kinds` is resized, or left empty if all values are finite. CorruptError if
// the bytes are damaged.
FieldCoding decode_field_chunk(const FieldRows &rows, std::span<const u8> data, i64 frames, int components,
                               std::span<i64> values, std::vector<u8> &kinds);

}  // namespace pdeanim
