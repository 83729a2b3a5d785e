#include "linalg/add_multiples.hpp"

#include "base/instructions.hpp"
#include "linalg/vectors.hpp"

namespace pdeanim {

namespace {

// So many sums are kept in registers while all rows are added.
template <int eights, int bytes> PDEANIM_INLINE void add_tiles(double *total, i64 &first, i64 width,
                                                               const double *const *rows, const double *multiples,
                                                               i64 count) {
    constexpr i64 numbers = eights * abreast;
    for (; first + numbers <= width; first += numbers) {
        Eight<bytes> sums[eights];
        for (int j = 0; j < eights; ++j) sums[j] = Eight<bytes>::at(total + first + j * abreast);
        for (i64 i = 0; i < count; ++i) {
            for (int j = 0; j < eights; ++j) sums[j] += multiples[i] * Eight<bytes>::at(rows[i] + first + j * abreast);
        }
        for (int j = 0; j < eights; ++j) sums[j].put(total + first + j * abreast);
    }
}

}  // namespace

void add_multiples(double *total, i64 width, const double *const *rows, const double *multiples, i64 count) {
    in_widest([&](auto bytes) PDEANIM_INLINE_LAMBDA {
        i64 first = 0;
        add_tiles<4, bytes>(total, first, width, rows, multiples, count);
        add_tiles<1, bytes>(total, first, width, rows, multiples, count);
        for (; first < width; ++first) {
            for (i64 i = 0; i < count; ++i) total[first] += multiples[i] * rows[i][first];
        }
    });
}

}  // namespace pdeanim
