#include <algorithm>
#include <memory>
#include <type_traits>
#include <vector>

#include "base/lanes.hpp"
#include "base/parallel.hpp"
#include "encode/matrices.hpp"
#include "linalg/products.hpp"
#include "linalg/vectors.hpp"

namespace pdeanim {

namespace {

// Number of rows of a product that are computed together, and number of multiplications from which several threads pay
// off.
constexpr i64 rows_at_once = 192, worth_sharing = i64{1} << 22;

// Sums of products over rows: the rows are divided into spans, and each pass handles several columns. Within a span,
// blocks of rows are summed in the type of the rows, and the sums of blocks are added in double.
constexpr i64 spans = 4, columns_at_once = 32;
template <class Real> constexpr i64 block_rows = std::is_same_v<Real, float> ? 512 : 1024;

int threads_for(const ProductSizes &sizes, i64 times, int threads) {
    return sizes.rows * sizes.depth * sizes.columns * times < worth_sharing ? 1 : threads;
}

struct SumSizes {
    i64 count, columns, other_columns;
};

// Sum the products of each column of `rows` with each column of `others`. If both are the same matrix, only the upper
// triangle is computed.
template <class Real, class Row, bool is_triangle>
void sums(double *out, const Row *rows, const Row *others, const SumSizes &sizes, int threads) {
    const i64 count = sizes.count, columns = sizes.columns, other_columns = sizes.other_columns;
    const i64 size = columns * other_columns;
    std::vector<double> of_spans(spans * size);
    in_shares(spans, threads_for({count, columns, other_columns}, 1, threads), [&](i64 span, i64 end) {
        InPrecision<Real> own, other;
        const auto found = std::make_unique_for_overwrite<Real[]>(columns * columns_at_once);
        for (; span < end; ++span) {
            const i64 last = count * (span + 1) / spans;
            for (i64 begin = count * span / spans; begin < last; begin += block_rows<Real>) {
                const i64 some = least(block_rows<Real>, last - begin);
                const Real *block = own.of(rows + begin * columns, some * columns), *right = block;
                if constexpr (!is_triangle) {
                    right = other.of(others + begin * other_columns, some * other_columns);
                }
                for (i64 first = 0; first < other_columns; first += columns_at_once) {
                    const i64 width = least(columns_at_once, other_columns - first);
                    const i64 height = is_triangle ? first + width : columns;
                    std::fill_n(found.get(), height * width, Real{0});
                    add_product(found.get(), width, Strided<Real>{block, 1, columns}, right + first, other_columns,
                                {height, some, width});
                    double *total = of_spans.data() + span * size + first;
                    for (i64 i = 0; i < height; ++i) {
                        for (i64 j = 0; j < width; ++j) total[i * other_columns + j] += found[i * width + j];
                    }
                }
            }
        }
    });
    for (i64 i = 0; i < size; ++i) {
        double total = 0.0;
        for (i64 span = 0; span < spans; ++span) total += of_spans[span * size + i];
        out[i] = total;
    }
}

}  // namespace

void multiply(double *out, const Strided<double> &left, const double *right, const ProductSizes &sizes, int threads) {
    const i64 columns = sizes.columns;
    in_shares((sizes.rows + rows_at_once - 1) / rows_at_once, threads_for(sizes, 1, threads), [&](i64 share, i64 end) {
        const i64 first = share * rows_at_once, count = least(end * rows_at_once, sizes.rows) - first;
        std::fill_n(out + first * columns, count * columns, 0.0);
        const Strided<double> some{left.numbers + first * left.row, left.row, left.column};
        add_product(out + first * columns, columns, some, right, columns, {count, sizes.depth, columns});
    });
}

template <class Real> void multiply_rows(Real *out, const Real *rows, const double *factors, const ProductSizes &sizes,
                                         i64 axes, int threads) {
    const i64 columns = sizes.columns, length = sizes.depth * axes;
    InPrecision<Real> own;
    const Real *right = own.of(factors, sizes.depth * columns);
    const i64 blocks = (sizes.rows + rows_at_once - 1) / rows_at_once;
    in_shares(blocks, threads_for(sizes, axes, threads), [&](i64 share, i64 end) {
        const auto room = std::make_unique_for_overwrite<Real[]>(least(rows_at_once, sizes.rows) * columns);
        for (i64 block = share; block < end; ++block) {
            const i64 first = block * rows_at_once, count = least(rows_at_once, sizes.rows - first);
            Real *found = out + first * columns * axes, *sums = axes == 1 ? found : room.get();
            for (i64 axis = 0; axis < axes; ++axis) {
                std::fill_n(sums, count * columns, Real{0});
                add_product(sums, columns, Strided<Real>{rows + first * length + axis, length, axes}, right, columns,
                            {count, sizes.depth, columns});
                if (axes == 1) break;
                for (i64 i = 0; i < count * columns; ++i) found[i * axes + axis] = sums[i];
            }
        }
    });
}

template <class Real, class Row>
void sums_of_squares(double *out, const Row *rows, i64 count, i64 columns, int threads) {
    sums<Real, Row, true>(out, rows, rows, {count, columns, columns}, threads);
    for (i64 i = 0; i < columns; ++i) {
        for (i64 j = 0; j < i; ++j) out[i * columns + j] = out[j * columns + i];
    }
}

template <class Real> void sums_of_products(double *out, const Real *rows, const Real *others, i64 count, i64 columns,
                                            i64 other_columns, int threads) {
    sums<Real, Real, false>(out, rows, others, {count, columns, other_columns}, threads);
}

template void multiply_rows(float *, const float *, const double *, const ProductSizes &, i64, int);
template void multiply_rows(double *, const double *, const double *, const ProductSizes &, i64, int);
template void sums_of_squares<float, float>(double *, const float *, i64, i64, int);
template void sums_of_squares<double, float>(double *, const float *, i64, i64, int);
template void sums_of_squares<float, double>(double *, const double *, i64, i64, int);
template void sums_of_squares<double, double>(double *, const double *, i64, i64, int);
template void sums_of_products(double *, const float *, const float *, i64, i64, i64, int);
template void sums_of_products(double *, const double *, const double *, i64, i64, i64, int);

namespace {

// Columns are stored as rows, `length` apart. The reflection of a column acts on its numbers from the diagonal on. The
// numbers before the diagonal are moved to the triangle, and zeroed.
template <int bytes>
PDEANIM_INLINE void reduce(double *columns, double *factors, double *triangle, i64 length, i64 count) {
    for (i64 j = 0; j < count; ++j) {
        double *own = columns + j * length;
        const i64 first = j / abreast * abreast, left = length - first;
        std::copy_n(own, j, triangle + j * count);
        std::fill_n(own, j, 0.0);
        const Reflection found = reflection_of<bytes>(own + first, left, j - first);
        factors[j] = found.factor;
        triangle[j * count + j] = found.image;
        for (i64 k = j + 1; k < count; ++k) {
            double *other = columns + k * length;
            // From `first` on: this column's numbers before its diagonal are zero.
            add_multiple<bytes>(other + first, -found.factor * dot<bytes>(other + first, own + first, left),
                                own + first, left);
        }
    }
}

template <int bytes>
PDEANIM_INLINE void expand(double *vectors, const double *columns, const double *factors, i64 length, i64 count) {
    for (i64 j = count; j-- > 0;) {
        const double *own = columns + j * length;
        const i64 first = j / abreast * abreast, left = length - first;
        vectors[j * length + j] = 1.0;
        for (i64 k = j; k < count; ++k) {
            double *other = vectors + k * length;
            add_multiple<bytes>(other + first, -factors[j] * dot<bytes>(other + first, own + first, left), own + first,
                                left);
        }
    }
}

}  // namespace

OrthonormalColumns orthonormal_columns(const double *matrix, i64 rows, i64 columns) {
    const i64 length = whole_eights(rows);
    std::vector<double> reduced(columns * length), vectors(columns * length), factors(columns),
        turned(columns * columns);
    const double scale = scale_of(matrix, rows * columns), down = 1.0 / scale;
    for (i64 i = 0; i < rows; ++i) {
        for (i64 j = 0; j < columns; ++j) reduced[j * length + i] = down * matrix[i * columns + j];
    }
    in_widest([&](auto bytes) PDEANIM_INLINE_LAMBDA {
        reduce<bytes>(reduced.data(), factors.data(), turned.data(), length, columns);
        expand<bytes>(vectors.data(), reduced.data(), factors.data(), length, columns);
    });
    OrthonormalColumns found{std::vector<double>(columns * rows), std::vector<double>(columns * columns)};
    for (i64 j = 0; j < columns; ++j) {
        std::copy_n(vectors.data() + j * length, rows, found.vectors.data() + j * rows);
        for (i64 i = 0; i <= j; ++i) found.triangle[i * columns + j] = scale * turned[j * columns + i];
    }
    return found;
}

}  // namespace pdeanim
