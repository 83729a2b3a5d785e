#include "linalg/logarithm.hpp"

#include <bit>

#include "base/instructions.hpp"

namespace pdeanim {

namespace {

// The number is 2^k m with m between the roots of 1/2 and 2, and log m = 2 (s + s^3 / 3 + s^5 / 5 + ...) with
// s = (m - 1) / (m + 1), which is below 0.172.
PDEANIM_INLINE double binary_logarithm(double value) {
    constexpr u64 one = u64{0x3ff} << 52, root_of_half = 0x3fe6a09e667f3bcd, exponents = u64{0xfff} << 52;
    constexpr double whole = 4503599627370496.0;  // 2^52: in its last digits a number stands as it is
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
    in_widest([&](auto) PDEANIM_INLINE_LAMBDA {
        for (i64 i = 0; i < count; ++i) out[i] = binary_logarithm(values[i]);
    });
}

}  // namespace pdeanim
