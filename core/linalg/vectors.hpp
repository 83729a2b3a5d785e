// Sums over rows of numbers that are a multiple of eight long, eight numbers side by side whatever registers there are.
#pragma once

#include "base/arithmetic.hpp"
#include "base/lanes.hpp"

namespace pdeanim {

constexpr int abreast = 8;
template <int bytes> using Eight = Registers<double, abreast, bytes>;

constexpr i64 whole_eights(i64 count) { return (count + abreast - 1) / abreast * abreast; }

template <int bytes> PDEANIM_INLINE double sum_of(const Eight<bytes> &eight) {
    return ((eight[0] + eight[4]) + (eight[2] + eight[6])) + ((eight[1] + eight[5]) + (eight[3] + eight[7]));
}

template <int bytes> PDEANIM_INLINE double dot(const double *a, const double *b, i64 count) {
    using Eight = pdeanim::Eight<bytes>;
    Eight sums[2] = {};
    i64 i = 0;
    for (; i + 2 * abreast <= count; i += 2 * abreast) {
        for (int k = 0; k < 2; ++k) sums[k] += Eight::at(a + i + k * abreast) * Eight::at(b + i + k * abreast);
    }
    if (i < count) sums[0] += Eight::at(a + i) * Eight::at(b + i);
    return sum_of<bytes>(sums[0] + sums[1]);
}

template <int bytes> PDEANIM_INLINE void add_multiple(double *total, double multiple, const double *row, i64 count) {
    using Eight = pdeanim::Eight<bytes>;
    for (i64 i = 0; i < count; i += abreast) (Eight::at(total + i) + multiple * Eight::at(row + i)).put(total + i);
}

}  // namespace pdeanim
