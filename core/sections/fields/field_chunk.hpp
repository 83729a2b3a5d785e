// Chunks of FDAT: the values of one field on a group of frames, as whole numbers (24 of the specification).
//
// Values are predicted from frames already decoded and from neighbours on the mesh, and the remainder is coded bit by
// bit with mixed models. Begin here: field_domain finds the neighbours, field_predictor predicts, field_model codes a
// remainder, field_chunk goes through frames and rows.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "base/arithmetic.hpp"
#include "sections/fields/field_domain.hpp"

namespace pdeanim {

// How a chunk is coded. Values are in units; a decoded value differs from the source by at most step / 2 (step is odd).
struct FieldCoding {
    u8 levels = 0;  // 0: frames in order; n: every 2^n-th frame first, then the frames between, halving the distance
    i64 step = 1;   // 1: the source itself; above: the decoded value is a prediction plus a multiple of the step
};

constexpr i64 largest_field_value = i64{1} << 40;
constexpr int most_field_levels = 8;

// Values that are no numbers have a kind of their own, 1 to 3; the units below them are ignored, and decode to anything.
constexpr u8 not_a_number = 1, plus_infinity = 2, minus_infinity = 3;

// Encode frames x rows x components values; `kinds` has a kind for each value, or is empty if all are numbers.
std::vector<u8> encode_field_chunk(const FieldDomain &domain, std::span<const i64> values, std::span<const u8> kinds,
                                   i64 frames, int components, FieldCoding coding);

// Decode to `values`, and to `kinds`, which is resized; it stays empty if all values are numbers. CorruptError if the
// bytes are damaged.
void decode_field_chunk(const FieldDomain &domain, std::span<const u8> data, i64 frames, int components,
                        std::span<i64> values, std::vector<u8> &kinds);

}  // namespace pdeanim
