#include "linalg/orthonormal_columns.hpp"

#include <algorithm>

#include "base/instructions.hpp"
#include "linalg/reflection.hpp"

namespace pdeanim {

namespace {

// Columns stand as rows, `length` apart. A column's reflection acts on its numbers from the diagonal on; what stands before
// is set aside in the triangle, and zero.
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
            // Numbers of the other column before the diagonal meet zeros.
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
