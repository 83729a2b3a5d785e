// Products of matrices, shared out to threads.
#pragma once

#include "linalg/add_product.hpp"

namespace pdeanim {

// out = left * right, with rows of `right` and of `out` one after the other.
void multiply(double *out, const Strided<double> &left, const double *right, const ProductSizes &sizes, int threads);

// out (rows x columns x axes) = rows (rows x depth x axes) * factors (depth x columns) on each axis, in the precision of
// the rows.
template <class Real> void multiply_rows(Real *out, const Real *rows, const double *factors, const ProductSizes &sizes,
                                         i64 axes, int threads);

// out (columns x columns) = rows^T * rows, of a number of rows, added up in a precision block by block.
template <class Real, class Row>
void sums_of_squares(double *out, const Row *rows, i64 count, i64 columns, int threads);

// The same of other rows, out (columns x other_columns) = rows^T * others, in their precision.
template <class Real> void sums_of_products(double *out, const Real *rows, const Real *others, i64 count, i64 columns,
                                            i64 other_columns, int threads);

}  // namespace pdeanim
