// Logarithms that have the same bits on every machine; those of libraries differ in the last ones.
#pragma once

#include "base/arithmetic.hpp"

namespace pdeanim {

// To base 2, of finite numbers that are not below 2^-1022, within 2^-50 of the larger of 1 and what they are.
void binary_logarithms(double *out, const double *values, i64 count);

}  // namespace pdeanim
