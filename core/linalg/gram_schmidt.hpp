// A pass of the Gram-Schmidt process.
#pragma once

#include <span>

#include "base/arithmetic.hpp"

namespace pdeanim {

// So wide is a row of so many numbers, zeros after them.
i64 row_width(i64 numbers);

// Take away from each column what of it lies along `count` orthonormal rows; all are as wide.
void take_away_parts(std::span<double *const> columns, const double *rows, i64 count, i64 width);

}  // namespace pdeanim
