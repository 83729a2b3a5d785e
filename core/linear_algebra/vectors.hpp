// Sums over rows of numbers that are a multiple of eight long, eight numbers side by side whatever registers there are.
#pragma once

#include "arithmetic.hpp"
#include "lanes.hpp"

namespace pdeanim {

constexpr int abreast = 8;
using Eight = Lanes<double, abreast>;

constexpr i64 whole_eights(i64 count) { return (count + abreast - 1) / abreast * abreast; }

PDEANIM_INLINE double sum_of(const Eight &eight) {
    return ((eight[0] + eight[4]) + (eight[2] + eight[6])) + ((eight[1] + eight[5]) + (eight[3] + eight[7]));
}

PDEANIM_INLINE double dot(const double *a, const double *b, i64 count) {
    Eight sums[2] = {};
    i64 i = 0;
    for (; i + 2 * abreast <= count; i += 2 * abreast) {
        for (int k = 0; k < 2; ++k)
            sums[k] += lanes_at<abreast>(a + i + k * abreast) * lanes_at<abreast>(b + i + k * abreast);
    }
    if (i < count) sums[0] += lanes_at<abreast>(a + i) * lanes_at<abreast>(b + i);
    return sum_of(sums[0] + sums[1]);
}

PDEANIM_INLINE void add_multiple(double *total, double multiple, const double *row, i64 count) {
    for (i64 i = 0; i < count; i += abreast)
        put_lanes(total + i, lanes_at<abreast>(total + i) + multiple * lanes_at<abreast>(row + i));
}

}  // namespace pdeanim
