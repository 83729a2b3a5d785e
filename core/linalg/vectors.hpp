// Vectors as rows of numbers, padded to a multiple of eight. They are processed eight at a time whatever the registers:
// sums, reflections.
#pragma once

#include <algorithm>
#include <cmath>

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

// Smaller lengths count as zero, for numbers of at most about one; the squares of larger lengths are normal numbers.
constexpr double no_length = 1e-140;

// Return the power of two that scales the largest of some numbers to about one, so that no square overflows or
// underflows.
inline double scale_of(const double *numbers, i64 count) {
    double largest = 0.0;
    for (i64 i = 0; i < count; ++i) largest = std::max(largest, std::abs(numbers[i]));
    int exponent = 0;
    if (largest > 0.0) std::frexp(largest, &exponent);
    return std::ldexp(1.0, clamp(exponent, -1000, 1000));
}

// A Householder reflection, I - factor v v^T.
struct Reflection {
    double factor, image;  // factor of v v^T; the only number of the reflected row that is not zero
};

// Return the reflection that maps a row, padded to a multiple of eight, to a multiple of the unit vector at `place`;
// the row becomes v. A row of zeros, or nearly so, is left unchanged, and its factor is 0. Numbers are at most about
// one.
template <int bytes> PDEANIM_INLINE Reflection reflection_of(double *row, i64 count, i64 place) {
    const double length = std::sqrt(dot<bytes>(row, row, count));
    if (!(length > no_length)) return {0.0, 0.0};
    const double shorter = 1.0 / length;
    for (i64 i = 0; i < count; i += abreast) (shorter * Eight<bytes>::at(row + i)).put(row + i);
    const double pivot = row[place], sign = pivot < 0.0 ? -1.0 : 1.0;
    row[place] = pivot + sign;
    return {1.0 / (1.0 + std::abs(pivot)), -sign * length};
}

}  // namespace pdeanim
