#include "basis/add_multiples.hpp"

#include "instructions.hpp"
#include "multiversion.hpp"

// The loop is compiled for each width of vector registers, and the machine chooses. It is written in vectors of that width:
// of a loop over single numbers GCC makes code that takes three times as long. The sums are the same.

namespace pdeanim {

namespace {

#if defined(__GNUC__)
template <int lanes> struct Pack {
    typedef double Type __attribute__((vector_size(8 * lanes), aligned(8), may_alias));
};
template <> struct Pack<1> {
    typedef double Type;
};
#else
template <int lanes> struct Pack {
    static_assert(lanes == 1);
    typedef double Type;
};
#endif

// So many sums are kept in registers while all rows are added.
template <int lanes, int registers> PDEANIM_INLINE void add_tiles(double *total, i64 &first, i64 width,
                                                                  const double *const *rows, const double *multiples,
                                                                  i64 count) {
    using Lanes = typename Pack<lanes>::Type;
    for (; first + lanes * registers <= width; first += lanes * registers) {
        Lanes sums[registers];
        for (int j = 0; j < registers; ++j) sums[j] = reinterpret_cast<const Lanes *>(total + first)[j];
        for (i64 i = 0; i < count; ++i) {
            const Lanes *row = reinterpret_cast<const Lanes *>(rows[i] + first);
            const double multiple = multiples[i];
            for (int j = 0; j < registers; ++j) sums[j] += multiple * row[j];
        }
        for (int j = 0; j < registers; ++j) reinterpret_cast<Lanes *>(total + first)[j] = sums[j];
    }
}

template <int lanes>
PDEANIM_INLINE void add_all(double *total, i64 width, const double *const *rows, const double *multiples, i64 count) {
    i64 first = 0;
    add_tiles<lanes, 8>(total, first, width, rows, multiples, count);
    add_tiles<lanes, 2>(total, first, width, rows, multiples, count);
    add_tiles<lanes, 1>(total, first, width, rows, multiples, count);
    if constexpr (lanes > 4) add_tiles<4, 1>(total, first, width, rows, multiples, count);
    if constexpr (lanes > 2) add_tiles<2, 1>(total, first, width, rows, multiples, count);
    add_tiles<1, 1>(total, first, width, rows, multiples, count);
}

using AddMultiples = void(double *, i64, const double *const *, const double *, i64);

#if defined(PDEANIM_FOR)

PDEANIM_FOR("avx512f")
void add_by_8(double *total, i64 width, const double *const *rows, const double *multiples, i64 count) {
    add_all<8>(total, width, rows, multiples, count);
}

PDEANIM_FOR("avx2")
void add_by_4(double *total, i64 width, const double *const *rows, const double *multiples, i64 count) {
    add_all<4>(total, width, rows, multiples, count);
}

#endif

#if defined(__GNUC__)
constexpr int usual_lanes = 2;
#else
constexpr int usual_lanes = 1;
#endif

void add_by_usual(double *total, i64 width, const double *const *rows, const double *multiples, i64 count) {
    add_all<usual_lanes>(total, width, rows, multiples, count);
}

AddMultiples *widest() {
#if defined(PDEANIM_FOR)
    if (has_avx512f()) return add_by_8;
    if (has_avx2()) return add_by_4;
#endif
    return add_by_usual;
}

}  // namespace

void add_multiples(double *total, i64 width, const double *const *rows, const double *multiples, i64 count) {
    static AddMultiples *const chosen = widest();
    chosen(total, width, rows, multiples, count);
}

}  // namespace pdeanim
