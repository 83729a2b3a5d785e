#include "linear_algebra/gram_schmidt.hpp"

#include "instructions.hpp"
#include "linear_algebra/vectors.hpp"

namespace pdeanim {

namespace {

// Their sums wait for each other less, and what is read is used for several.
constexpr int rows_at_once = 4, columns_at_once = 4;

template <int columns, int rows> PDEANIM_INLINE void take_away(double *const *column, const double *first, i64 width) {
    Eight sums[columns][rows] = {};
    for (i64 i = 0; i < width; i += abreast) {
        Eight row[rows];
        for (int r = 0; r < rows; ++r) row[r] = lanes_at<abreast>(first + r * width + i);
        for (int c = 0; c < columns; ++c) {
            const Eight own = lanes_at<abreast>(column[c] + i);
            for (int r = 0; r < rows; ++r) sums[c][r] += own * row[r];
        }
    }
    double shares[columns][rows];
    for (int c = 0; c < columns; ++c) {
        for (int r = 0; r < rows; ++r) shares[c][r] = sum_of(sums[c][r]);
    }
    for (i64 i = 0; i < width; i += abreast) {
        Eight row[rows];
        for (int r = 0; r < rows; ++r) row[r] = lanes_at<abreast>(first + r * width + i);
        for (int c = 0; c < columns; ++c) {
            Eight own = lanes_at<abreast>(column[c] + i);
            for (int r = 0; r < rows; ++r) own -= shares[c][r] * row[r];
            put_lanes(column[c] + i, own);
        }
    }
}

template <int columns>
PDEANIM_INLINE void take_away_all(double *const *column, const double *rows, i64 count, i64 width) {
    i64 k = 0;
    for (; k + rows_at_once <= count; k += rows_at_once)
        take_away<columns, rows_at_once>(column, rows + k * width, width);
    for (; k < count; ++k) take_away<columns, 1>(column, rows + k * width, width);
}

}  // namespace

i64 row_width(i64 numbers) { return whole_eights(numbers); }

void take_away_parts(std::span<double *const> columns, const double *rows, i64 count, i64 width) {
    in_widest([&]() PDEANIM_INLINE_LAMBDA {
        const i64 total = static_cast<i64>(columns.size());
        i64 c = 0;
        for (; c + columns_at_once <= total; c += columns_at_once)
            take_away_all<columns_at_once>(columns.data() + c, rows, count, width);
        for (; c + 2 <= total; c += 2) take_away_all<2>(columns.data() + c, rows, count, width);
        for (; c < total; ++c) take_away_all<1>(columns.data() + c, rows, count, width);
    });
}

}  // namespace pdeanim
