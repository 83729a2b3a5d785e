// Functions of time as straight lines from keyframe to keyframe: changes of speed, of the first frame the value itself.
//
// All in sixteenths of a step: speeds are whole numbers of them a frame, so that a line stays within half a step for 16
// frames at least.
#pragma once

#include <span>
#include <vector>

#include "sections/temporal/time_functions.hpp"

namespace pdeanim {

// From changes of speed: sums of sums, which wrap at 64 bits.
std::vector<double> values_along_lines(const TimeShape &shape, std::span<const i64> quantised, double step);

// Changes of speed for what is wanted, in steps, function after function; each line as long as it stays within a
// tolerance of half a sixteenth or more. There is a frame or more.
std::vector<i64> quantise_straight(const TimeShape &shape, std::span<const double> wanted, double tolerance);

}  // namespace pdeanim
