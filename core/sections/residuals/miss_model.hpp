// Misses: how far residuals are from what was predicted for them, or from nothing.
//
// What size is expected follows from the misses at the same place in the frame's reference, at the place before and on
// the axes before. Where it is small the size is counted up, each count a mixed bit; where it is large, some of the
// lower digits are left out of the counting: they follow after the sign.
#pragma once

#include "entropy/range_coder.hpp"
#include "sections/residuals/counted_model.hpp"

namespace pdeanim {

// Misses are remembered within 32 bits: they only say what size is expected.
constexpr i64 largest_remembered_miss = (i64{1} << 31) - 1;

// What is known of a miss before it is coded.
struct MissContext {
    int axis = 0;
    bool has_reference = false, has_before = false;  // whether the place has a residual in the reference; that before
    bool is_not_zero = false;                        // where the other two axes are zero, the last one is not
    i64 mean_size = 0;                               // of the place [1/16 of three axes]
    i64 in_time = 0, in_space = 0;                   // remembered misses in the reference, and at the place before
    i64 one_before = 0, two_before = 0;              // sizes of the misses one and two axes before
    int agreed_in_time = 0, agreed_in_space = 0;     // axes before that had the other miss's sign, less those without
};

constexpr int sign_of(i64 number) { return (number > 0) - (number < 0); }

class MissModel {
public:
    // CorruptError where the bytes hold what is out of range.
    template <Mode mode> i64 code(RangeCoder<mode> &coder, const MissContext &known, i64 miss);

private:
    static constexpr int expected_classes = 24;  // 20 of small sizes, then the fourths of an octave, whichever octave
    static constexpr int near_classes = 8;       // of a neighbour's size: 0 to 5, from 6 on, no neighbour
    static constexpr int beside_classes = 8;     // of the size on an axis before: 0 to 6, from 7 on
    static constexpr int most_counted = 18;      // sizes up to which one is counted up; the rest is a number
    static constexpr int fine_digits = 5;        // digits of `expected` up to which nothing is left out of the counting
    static constexpr int modelled_digits = 2;    // of the digits left out, the uppermost, which have bit models

    BitModel by_expected_[expected_classes][3][most_counted];
    BitModel by_near_[near_classes][near_classes][2][most_counted];
    BitModel by_beside_[beside_classes][beside_classes][3][2][most_counted];
    BitModel lower_digits_[most_counted + 1][1 << modelled_digits];
    BitModel signs_[3][3][2], signs_in_time_[3][3][3][2], signs_in_space_[3][3][3][2];
    CountedModel rest_;
    Weights<3> count_weights_[most_counted][2], sign_weights_[2];
};

}  // namespace pdeanim
