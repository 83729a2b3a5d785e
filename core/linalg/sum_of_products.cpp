#include "linalg/sum_of_products.hpp"

#include "base/instructions.hpp"
#include "linalg/vectors.hpp"

namespace pdeanim {

namespace {

constexpr i64 block = 4096;  // numbers that are added up for themselves: rounding grows with their number

}  // namespace

double sum_of_products(const double *a, const double *b, i64 count) {
    double total = 0.0;
    in_widest([&](auto bytes) PDEANIM_INLINE_LAMBDA {
        const i64 whole = count / abreast * abreast;
        for (i64 i = 0; i < whole; i += block) total += dot<bytes>(a + i, b + i, least(block, whole - i));
        for (i64 i = whole; i < count; ++i) total += a[i] * b[i];
    });
    return total;
}

}  // namespace pdeanim
