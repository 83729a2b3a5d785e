#include "linalg/gram_schmidt.hpp"

#include "base/instructions.hpp"
#include "linalg/vectors.hpp"

namespace pdeanim {

namespace {

// Their sums wait for each other less, and what is read is used for several.
constexpr int rows_at_once = 4;

// So many columns that their sums stay in registers, of which the widest are 32, others 16.
template <int bytes> constexpr int columns_at_once = bytes == 64 ? 4 : 2;

// The products of columns with rows. Parts of eight numbers that are longer than registers are added up one after the
// other; of a single column two beside each other, or sums would wait for themselves.
template <int columns, int rows, int bytes>
PDEANIM_INLINE void multiply(double (&products)[columns][rows], double *const *column, const double *first, i64 width) {
    constexpr int size = Eight<bytes>::size, parts = Eight<bytes>::parts;
    constexpr int together = columns == 1 && parts > 1 ? 2 : 1;
    using Some = Registers<double, together * size, bytes>;
    Eight<bytes> totals[columns][rows];
    for (int part = 0; part < parts; part += together) {
        Some sums[columns][rows] = {};
        for (i64 i = part * size; i < width; i += abreast) {
            Some row[rows];
            for (int r = 0; r < rows; ++r) row[r] = Some::at(first + r * width + i);
            for (int c = 0; c < columns; ++c) {
                const Some own = Some::at(column[c] + i);
                for (int r = 0; r < rows; ++r) sums[c][r] += own * row[r];
            }
        }
        for (int c = 0; c < columns; ++c) {
            for (int r = 0; r < rows; ++r) {
                for (int k = 0; k < together; ++k) totals[c][r].part[part + k] = sums[c][r].part[k];
            }
        }
    }
    for (int c = 0; c < columns; ++c) {
        for (int r = 0; r < rows; ++r) products[c][r] = sum_of<bytes>(totals[c][r]);
    }
}

template <int columns, int rows, int bytes>
PDEANIM_INLINE void take_away(double *const *column, const double *first, i64 width) {
    double shares[columns][rows];
    multiply<columns, rows, bytes>(shares, column, first, width);
    constexpr int size = Eight<bytes>::size;
    using Some = Registers<double, size, bytes>;
    for (i64 i = 0; i < width; i += size) {
        Some row[rows];
        for (int r = 0; r < rows; ++r) row[r] = Some::at(first + r * width + i);
        for (int c = 0; c < columns; ++c) {
            Some own = Some::at(column[c] + i);
            for (int r = 0; r < rows; ++r) own -= shares[c][r] * row[r];
            own.put(column[c] + i);
        }
    }
}

template <int columns, int bytes>
PDEANIM_INLINE void take_away_all(double *const *column, const double *rows, i64 count, i64 width) {
    i64 k = 0;
    for (; k + rows_at_once <= count; k += rows_at_once)
        take_away<columns, rows_at_once, bytes>(column, rows + k * width, width);
    // The few that are left are taken away from one column after the other, which is less code.
    for (; k < count; ++k) {
        for (int c = 0; c < columns; ++c) take_away<1, 1, bytes>(column + c, rows + k * width, width);
    }
}

}  // namespace

i64 row_width(i64 numbers) { return whole_eights(numbers); }

void take_away_parts(std::span<double *const> columns, const double *rows, i64 count, i64 width) {
    in_widest([&](auto bytes) PDEANIM_INLINE_LAMBDA {
        constexpr int at_once = columns_at_once<bytes>;
        const i64 total = static_cast<i64>(columns.size());
        i64 c = 0;
        for (; c + at_once <= total; c += at_once)
            take_away_all<at_once, bytes>(columns.data() + c, rows, count, width);
        if constexpr (at_once > 2) {
            for (; c + 2 <= total; c += 2) take_away_all<2, bytes>(columns.data() + c, rows, count, width);
        }
        for (; c < total; ++c) take_away_all<1, bytes>(columns.data() + c, rows, count, width);
    });
}

}  // namespace pdeanim
