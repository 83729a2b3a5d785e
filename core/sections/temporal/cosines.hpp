// Functions of time as sums of cosines (DCT-II, orthonormal).
#pragma once

#include <span>
#include <vector>

#include "sections/temporal/time_functions.hpp"

namespace pdeanim {

// One period of the cosine in 4 `frames` samples, cos(2 pi j / (4 frames)) within 2^-51; the same bits on every
// machine. There is a frame or more.
std::vector<double> cosine_wave(i64 frames);

// The inverse transform of a number for each frequency, in steps.
std::vector<double> transformed_values(const TimeShape &shape, std::span<const i64> quantised, double step);

}  // namespace pdeanim
