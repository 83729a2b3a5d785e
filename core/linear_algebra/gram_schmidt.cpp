#include "linear_algebra/gram_schmidt.hpp"

#include <algorithm>

#include "instructions.hpp"
#include "linear_algebra/vectors.hpp"

namespace pdeanim {

namespace {

constexpr int rows_at_once = 4;  // their sums wait for each other less

// Add up, in `part`, what of a column lies along some rows: these are read once, for their shares and for their sum.
template <int rows>
PDEANIM_INLINE void add_part_along(const double *column, const double *first, i64 width, double *part) {
    Eight sums[rows] = {};
    for (i64 i = 0; i < width; i += abreast) {
        const Eight own = lanes_at<abreast>(column + i);
        for (int k = 0; k < rows; ++k) sums[k] += own * lanes_at<abreast>(first + k * width + i);
    }
    double shares[rows];
    for (int k = 0; k < rows; ++k) shares[k] = sum_of(sums[k]);
    for (i64 i = 0; i < width; i += abreast) {
        Eight own = lanes_at<abreast>(part + i);
        for (int k = 0; k < rows; ++k) own += shares[k] * lanes_at<abreast>(first + k * width + i);
        put_lanes(part + i, own);
    }
}

}  // namespace

i64 row_width(i64 numbers) { return whole_eights(numbers); }

void take_away_parts(double *column, const double *rows, i64 count, i64 width, double *part) {
    std::fill_n(part, width, 0.0);
    in_widest([&]() PDEANIM_INLINE_LAMBDA {
        i64 k = 0;
        for (; k + rows_at_once <= count; k += rows_at_once)
            add_part_along<rows_at_once>(column, rows + k * width, width, part);
        for (; k < count; ++k) add_part_along<1>(column, rows + k * width, width, part);
        add_multiple(column, -1.0, part, width);
    });
}

}  // namespace pdeanim
