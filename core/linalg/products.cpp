#include "linalg/products.hpp"

#include <algorithm>
#include <bit>
#include <memory>

#include "base/lanes.hpp"
#include "linalg/vectors.hpp"

// A block of the right matrix is stored as panels. Each panel is as wide as the registers of a tile, and the panels
// stay in the second-level cache. A few rows of the left matrix are kept in the first-level cache and multiplied with
// all panels. The sums of a tile stay in registers. After a block they go to `out`, where the next block continues:
// nothing is rounded in between.

namespace pdeanim {

namespace {

constexpr i64 block_depth = 256,
              block_bytes = 2048;  // depth of a block of the right matrix; length of its rows [bytes]

constexpr int few_rows = 4;  // number of rows of tiles for the last rows of a matrix

// A tile of sums: `of_rows` rows of `of_columns` vectors, each of `of_lanes` numbers.
template <int of_lanes, int of_rows, int of_columns> struct Tile {
    static constexpr int lanes = of_lanes, rows = of_rows, columns = of_columns, width = of_lanes * of_columns;
};

template <class Shape, class Real>
PDEANIM_INLINE void add_tile(Real *out, i64 stride, const Real *left, const Real *panel, i64 depth) {
    constexpr int lanes = Shape::lanes;
    Lanes<Real, lanes> sums[Shape::rows][Shape::columns];
    for (int i = 0; i < Shape::rows; ++i) {
        for (int j = 0; j < Shape::columns; ++j) sums[i][j] = lanes_at<lanes>(out + i * stride + j * lanes);
    }
    for (i64 k = 0; k < depth; ++k) {
        for (int i = 0; i < Shape::rows; ++i) {
            for (int j = 0; j < Shape::columns; ++j) sums[i][j] += left[i] * lanes_at<lanes>(panel + j * lanes);
        }
        left += Shape::rows;
        panel += Shape::width;
    }
    for (int i = 0; i < Shape::rows; ++i) {
        for (int j = 0; j < Shape::columns; ++j) put_lanes(out + i * stride + j * lanes, sums[i][j]);
    }
}

// Multiply one row of a tile that extends beyond the edge of the matrix, through a buffer.
template <class Shape, class Real>
PDEANIM_INLINE void add_part_of_tile(Real *out, i64 stride, i64 width, const Real *left, const Real *panel, i64 depth) {
    Real sums[Shape::rows * Shape::width] = {};
    for (int i = 0; i < Shape::rows; ++i) std::copy_n(out + i * stride, width, sums + i * Shape::width);
    add_tile<Shape>(sums, Shape::width, left, panel, depth);
    for (int i = 0; i < Shape::rows; ++i) std::copy_n(sums + i * Shape::width, width, out + i * stride);
}

// Multiply rows of the left matrix, from `first` on, with all panels of a block.
template <class Shape, class Real> PDEANIM_INLINE void add_rows(Real *out, i64 out_stride, const Strided<Real> &left,
                                                                i64 &first, const Real *panels,
                                                                const ProductSizes &sizes) {
    Real rows[Shape::rows * block_depth];
    for (; first + Shape::rows <= sizes.rows; first += Shape::rows) {
        for (i64 k = 0; k < sizes.depth; ++k) {
            const Real *column = left.numbers + first * left.row + k * left.column;
            if (left.row == 1) {
                std::copy_n(column, Shape::rows, rows + k * Shape::rows);
            } else {
                for (int i = 0; i < Shape::rows; ++i) rows[k * Shape::rows + i] = column[i * left.row];
            }
        }
        Real *row = out + first * out_stride;
        const Real *panel = panels;
        i64 j = 0;
        for (; j + Shape::width <= sizes.columns; j += Shape::width) {
            add_tile<Shape>(row + j, out_stride, rows, panel, sizes.depth);
            panel += Shape::width * sizes.depth;
        }
        if (j < sizes.columns) {
            add_part_of_tile<Shape>(row + j, out_stride, sizes.columns - j, rows, panel, sizes.depth);
        }
    }
}

// Store a block of the right matrix as panels, padded with zeros.
template <int width, class Real>
PDEANIM_INLINE void lay_out(Real *panels, const Real *right, i64 stride, i64 depth, i64 columns) {
    for (i64 first = 0; first < columns; first += width) {
        const i64 some = least<i64>(width, columns - first);
        for (i64 k = 0; k < depth; ++k, panels += width) {
            const Real *row = right + k * stride + first;
            if (some == width) {
                std::copy_n(row, width, panels);
            } else {
                std::fill(std::copy_n(row, some, panels), panels + width, Real{0});
            }
        }
    }
}

template <class Shape, class Real> PDEANIM_INLINE void add_all(Real *out, i64 out_stride, const Strided<Real> &left,
                                                               const Real *right, i64 right_stride,
                                                               const ProductSizes &sizes) {
    constexpr i64 most_columns = block_bytes / sizeof(Real) / Shape::width * Shape::width;
    const i64 room = least(most_columns, (sizes.columns + Shape::width - 1) / Shape::width * Shape::width);
    const auto panels = std::make_unique_for_overwrite<Real[]>(least(block_depth, sizes.depth) * room);
    for (i64 j = 0; j < sizes.columns; j += most_columns) {
        const i64 columns = least(most_columns, sizes.columns - j);
        for (i64 k = 0; k < sizes.depth; k += block_depth) {
            const i64 depth = least(block_depth, sizes.depth - k);
            lay_out<Shape::width>(panels.get(), right + k * right_stride + j, right_stride, depth, columns);
            const Strided<Real> some{left.numbers + k * left.column, left.row, left.column};
            i64 first = 0;
            const ProductSizes block{sizes.rows, depth, columns};
            add_rows<Shape>(out + j, out_stride, some, first, panels.get(), block);
            if constexpr (Shape::rows > few_rows) {
                add_rows<Tile<Shape::lanes, few_rows, Shape::columns>>(out + j, out_stride, some, first, panels.get(),
                                                                       block);
            }
            add_rows<Tile<Shape::lanes, 1, Shape::columns>>(out + j, out_stride, some, first, panels.get(), block);
        }
    }
}

template <class Real> struct AddProduct {
    using Function = void(Real *, i64, const Strided<Real> &, const Real *, i64, const ProductSizes &);

#if defined(PDEANIM_FOR)
    PDEANIM_FOR("avx512f")
    static void by_64(Real *out, i64 out_stride, const Strided<Real> &left, const Real *right, i64 right_stride,
                      const ProductSizes &sizes) {
        add_all<Tile<64 / sizeof(Real), 12, 1>>(out, out_stride, left, right, right_stride, sizes);
    }

    PDEANIM_FOR("avx2")
    static void by_32(Real *out, i64 out_stride, const Strided<Real> &left, const Real *right, i64 right_stride,
                      const ProductSizes &sizes) {
        add_all<Tile<32 / sizeof(Real), 6, 2>>(out, out_stride, left, right, right_stride, sizes);
    }
#endif

    static void by_16(Real *out, i64 out_stride, const Strided<Real> &left, const Real *right, i64 right_stride,
                      const ProductSizes &sizes) {
        add_all<Tile<16 / sizeof(Real), 4, 2>>(out, out_stride, left, right, right_stride, sizes);
    }

    static Function *widest() {
#if defined(PDEANIM_FOR)
        if (has_avx512f()) return by_64;
        if (has_avx2()) return by_32;
#endif
        return by_16;
    }
};

}  // namespace

template <class Real> void add_product(Real *out, i64 out_stride, const Strided<Real> &left, const Real *right,
                                       i64 right_stride, const ProductSizes &sizes) {
    static const auto chosen = AddProduct<Real>::widest();
    if (sizes.rows > 0 && sizes.depth > 0 && sizes.columns > 0) {
        chosen(out, out_stride, left, right, right_stride, sizes);
    }
}

template void add_product(float *, i64, const Strided<float> &, const float *, i64, const ProductSizes &);
template void add_product(double *, i64, const Strided<double> &, const double *, i64, const ProductSizes &);

void add_multiples(double *total, i64 width, const double *const *rows, const double *multiples, i64 count) {
    for (i64 i = 0; i < count; ++i) {
        for (i64 j = 0; j < width; ++j) total[j] += multiples[i] * rows[i][j];
    }
}

double sum_of_products(const double *a, const double *b, i64 count) {
    constexpr i64 block = 4096;  // numbers per sum that joins the total: rounding errors grow with it
    const i64 whole = count / abreast * abreast;
    double total = 0.0;
    for (i64 i = 0; i < whole; i += block) total += dot<usual_bytes>(a + i, b + i, least(block, whole - i));
    for (i64 i = whole; i < count; ++i) total += a[i] * b[i];
    return total;
}

namespace {

// Number of rows whose sums are computed together. Their sums do not wait for each other, and share loaded numbers.
constexpr int rows_at_once = 4;

// Number of columns whose sums stay in registers: there are 32 of the widest registers, and 16 of others.
template <int bytes> constexpr int columns_at_once = bytes == 64 ? 4 : 2;

// Compute the products of columns with rows. If eight numbers take several registers, these are summed one after the
// other; for a single column two at a time, so that sums do not wait for each other.
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
    // The last few rows are subtracted column by column, which takes less code.
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

namespace {

// The number is 2^k m with m between the square roots of 1/2 and 2, and log m = 2 (s + s^3 / 3 + s^5 / 5 + ...) with s
// = (m - 1) / (m + 1), which is below 0.172.
double binary_logarithm(double value) {
    constexpr u64 one = u64{0x3ff} << 52, root_of_half = 0x3fe6a09e667f3bcd, exponents = u64{0xfff} << 52;
    constexpr double whole =
        4503599627370496.0;  // 2^52: added to a smaller integer, it leaves that integer in the last digits
    const u64 bits = std::bit_cast<u64>(value), above = bits - root_of_half + one;
    const double k = std::bit_cast<double>((above >> 52) | std::bit_cast<u64>(whole)) - (whole + 1023.0);
    const double m = std::bit_cast<double>(bits - (above & exponents) + one);
    const double s = (m - 1.0) / (m + 1.0), square = s * s;
    double sum = 1.0 / 21.0;
    for (int odd = 19; odd > 0; odd -= 2) sum = sum * square + 1.0 / odd;
    constexpr double twice_base = 2.8853900817779268147;  // 2 / log 2
    return k + twice_base * (s * sum);
}

}  // namespace

void binary_logarithms(double *out, const double *values, i64 count) {
    for (i64 i = 0; i < count; ++i) out[i] = binary_logarithm(values[i]);
}

}  // namespace pdeanim
