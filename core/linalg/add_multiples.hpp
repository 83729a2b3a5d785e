// Multiples of some rows, added up.
#pragma once

#include "base/arithmetic.hpp"

namespace pdeanim {

// total += multiples[0] * rows[0] + multiples[1] * rows[1] + ..., added in this order, for `width` numbers side by side.
void add_multiples(double *total, i64 width, const double *const *rows, const double *multiples, i64 count);

}  // namespace pdeanim
