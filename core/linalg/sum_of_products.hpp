// Sums of products of two long rows of numbers.
#pragma once

#include "base/arithmetic.hpp"

namespace pdeanim {

double sum_of_products(const double *a, const double *b, i64 count);

}  // namespace pdeanim
