// Powers of two that bring numbers next to one, so that no square of them leaves the range of numbers.
#pragma once

#include <algorithm>
#include <cmath>

#include "base/arithmetic.hpp"

namespace pdeanim {

// Lengths below it are none, of numbers that are about one at most: their squares are numbers still.
constexpr double no_length = 1e-140;

// What the largest of some numbers divided by is about one.
inline double scale_of(const double *numbers, i64 count) {
    double largest = 0.0;
    for (i64 i = 0; i < count; ++i) largest = std::max(largest, std::abs(numbers[i]));
    int exponent = 0;
    if (largest > 0.0) std::frexp(largest, &exponent);
    return std::ldexp(1.0, clamp(exponent, -1000, 1000));
}

}  // namespace pdeanim
