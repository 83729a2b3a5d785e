#include "linalg/add_product.hpp"

#include <algorithm>
#include <memory>

#include "base/instructions.hpp"
#include "base/lanes.hpp"

// A block of the right matrix is laid out as panels, each as wide as the registers of a tile, and stays in the cache next
// to the nearest; a few rows of the left one at a time are laid out in the nearest, and meet all panels. The sums of a
// tile stay in registers. After a block they are kept in `out`, from where the next block goes on: nothing is rounded on
// the way.

namespace pdeanim {

namespace {

constexpr i64 block_depth = 256, block_bytes = 2048;  // of a block of the right matrix: its rows, and the length of one

constexpr int few_rows = 4;  // of tiles for what is left of the rows

// Vectors of so many numbers; a tile of sums has so many rows of so many vectors.
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

// The same where a tile goes beyond the matrix: of a row alone, through room of its own.
template <class Shape, class Real>
PDEANIM_INLINE void add_part_of_tile(Real *out, i64 stride, i64 width, const Real *left, const Real *panel, i64 depth) {
    Real sums[Shape::rows * Shape::width] = {};
    for (int i = 0; i < Shape::rows; ++i) std::copy_n(out + i * stride, width, sums + i * Shape::width);
    add_tile<Shape>(sums, Shape::width, left, panel, depth);
    for (int i = 0; i < Shape::rows; ++i) std::copy_n(sums + i * Shape::width, width, out + i * stride);
}

// Rows of the left matrix from `first` on meet all panels of a block.
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

// A block of the right matrix as panels; what goes beyond it is zero.
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

}  // namespace pdeanim
