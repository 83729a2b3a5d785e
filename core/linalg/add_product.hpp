// The loop that nearly all of this folder's time goes to: products of matrices.
#pragma once

#include "base/arithmetic.hpp"

namespace pdeanim {

// A matrix whose numbers lie so far from each other, from row to row and from column to column. It may be transposed.
template <class Real> struct Strided {
    const Real *numbers;
    i64 row, column;
};

struct ProductSizes {
    i64 rows, depth, columns;
};

// out += left * right, of (rows x depth) and (depth x columns); rows of `right` and of `out` are strides apart.
//
// Each number is one sum: what was there, and product after product in order of depth, multiplied, then added. So its bits
// depend neither on the width of vector registers nor on how rows and columns are shared out.
template <class Real> void add_product(Real *out, i64 out_stride, const Strided<Real> &left, const Real *right,
                                       i64 right_stride, const ProductSizes &sizes);

}  // namespace pdeanim
