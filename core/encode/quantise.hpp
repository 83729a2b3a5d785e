// Quantisation of coefficients with a dead zone, which is wider among zeros.
#pragma once

#include <span>
#include <vector>

#include "base/arithmetic.hpp"
#include "base/large_array.hpp"

namespace pdeanim {

struct DeadZone {
    double round_up_at;        // a number this far (in steps) beyond a whole one goes to the next
    double round_up_alone_at;  // the same of a coefficient whose neighbours are all zero
};

struct Quantised {
    LargeArray<i64> coefficients;
    std::vector<i64> largest;  // magnitude in each channel
};

// Coefficients, rows of `channels` each, in steps. Neighbours are the rows before and after, and the functions of time
// before and after, which are `axes` channels away. Of float or double.
template <class Real> Quantised quantise_sparsely(std::span<const Real> values, i64 channels, int axes, double step,
                                                  const DeadZone &zone, int threads);

}  // namespace pdeanim
