// A pass of the classical Gram-Schmidt process.
#pragma once

#include "arithmetic.hpp"

namespace pdeanim {

// So wide is a row of so many numbers, zeros after them.
i64 row_width(i64 numbers);

// Take away from a column what of it lies along `count` orthonormal rows, each as wide as the column; `part`: room for
// one more.
void take_away_parts(double *column, const double *rows, i64 count, i64 width, double *part);

}  // namespace pdeanim
