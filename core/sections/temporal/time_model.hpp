// Context models of quantised functions of time.
//
// Of each number comes its exponent, beginning with the one that its neighbours (in time or frequency, among axes,
// among functions) make likely and going up or down from there, so that large numbers cost few decisions; then the bits
// below the leading one, and the sign.
#pragma once

#include <type_traits>

#include "entropy/range_coder.hpp"
#include "sections/temporal/time_functions.hpp"

namespace pdeanim {

// Code all numbers, read when encoding or measuring, written when decoding: magnitudes are 2^40 - 2 at most.
template <Mode mode> void code_time_numbers(RangeCoder<mode> &coder, const TimeShape &shape,
                                            std::conditional_t<mode == Mode::decode, i64, const i64> *quantised);

}  // namespace pdeanim
