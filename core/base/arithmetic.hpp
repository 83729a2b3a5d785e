// Exact arithmetic: integers that every compiler computes alike, and floating point that must not be contracted.
//
// The file format's integers follow Python: division and shifts round towards minus infinity; shifts of negative numbers
// are arithmetic (C++20). A decoder computes in u64 where a sum or product may wrap at 64 bits.
#pragma once

#include <bit>
#include <cfloat>
#include <cstddef>
#include <cstdint>

namespace pdeanim {

static_assert(FLT_EVAL_METHOD == 0, "sums must be rounded to the precision that they are declared with");

using i16 = std::int16_t;
using i32 = std::int32_t;
using i64 = std::int64_t;
using u8 = std::uint8_t;
using u16 = std::uint16_t;
using u32 = std::uint32_t;
using u64 = std::uint64_t;

// Number of binary digits of a number; 0 if it is not positive.
constexpr int bit_length(i64 number) { return number > 0 ? 64 - std::countl_zero(static_cast<u64>(number)) : 0; }

// Quotient rounded towards minus infinity; the divisor is not zero.
constexpr i64 floor_divide(i64 number, i64 divisor) {
    const i64 quotient = number / divisor;
    return quotient - ((number % divisor != 0 && (number < 0) != (divisor < 0)) ? 1 : 0);
}

template <class T> constexpr T clamp(T value, T low, T high) { return value < low ? low : value > high ? high : value; }
template <class T> constexpr T least(T a, T b) { return b < a ? b : a; }
template <class T> constexpr T most(T a, T b) { return a < b ? b : a; }
constexpr i64 size_of(i64 number) { return number < 0 ? -number : number; }

}  // namespace pdeanim
