// Linear algebra with the same bits on every machine: matrix products, which take most of the time, and sums over rows.
//
// Begin here. linalg/vectors.hpp has the building blocks of the loops, encode/matrices.hpp the functions that only the
// encoder needs.
#pragma once

#include <algorithm>
#include <span>
#include <type_traits>
#include <vector>

#include "base/arithmetic.hpp"

namespace pdeanim {

// A matrix with strides between rows and between columns. It may be transposed.
template <class Real> struct Strided {
    const Real *numbers;
    i64 row, column;
};

struct ProductSizes {
    i64 rows, depth, columns;
};

// out += left * right, for matrices of (rows x depth) and (depth x columns). Rows of `right` and of `out` are strides
// apart.
//
// Each number of `out` is one sum: the old value, then product after product in order of depth, multiplied, then added.
// So its bits depend neither on the width of vector registers nor on how rows and columns are divided among threads.
template <class Real> void add_product(Real *out, i64 out_stride, const Strided<Real> &left, const Real *right,
                                       i64 right_stride, const ProductSizes &sizes);

// Gives numbers in another precision: converted, or unchanged if they have it already.
template <class Real> class InPrecision {
public:
    // Return the numbers in that precision; valid until the next call.
    template <class Given> const Real *of(const Given *given, i64 count) {
        if constexpr (std::is_same_v<Given, Real>) {
            return given;
        } else {
            kept_.resize(count);
            std::transform(given, given + count, kept_.begin(), [](Given number) { return static_cast<Real>(number); });
            return kept_.data();
        }
    }

private:
    std::vector<Real> kept_;
};

// total += multiples[0] * rows[0] + multiples[1] * rows[1] + ..., added in this order, for `width` numbers side by side.
void add_multiples(double *total, i64 width, const double *const *rows, const double *multiples, i64 count);

// Return the sum of products of two long rows of numbers.
double sum_of_products(const double *a, const double *b, i64 count);

// Return the length of a row of `numbers` numbers, padded with zeros for `take_away_parts`.
i64 row_width(i64 numbers);

// One pass of the Gram-Schmidt process: subtract from each column its part along `count` orthonormal rows of the same
// width.
void take_away_parts(std::span<double *const> columns, const double *rows, i64 count, i64 width);

// Compute logarithms to base 2 of finite numbers of at least 2^-1022. The error is at most 2^-50 times the larger of 1
// and the result. (The logarithms of libraries differ in their last bits from machine to machine.)
void binary_logarithms(double *out, const double *values, i64 count);

}  // namespace pdeanim
