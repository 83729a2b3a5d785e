// Limits that every part of the format keeps.
#pragma once

#include "base/arithmetic.hpp"

namespace pdeanim::limits {

inline constexpr double largest_step = 0x1p160;  // positions end at 2^128, and products with it stay far from overflow
inline constexpr double largest_rate = 12.0;     // of Eqs. 12, 14 and 16 over a half-range of 1
inline constexpr i64 most_group_frames = 4096;   // an encoder holds a group in memory

}  // namespace pdeanim::limits
