#include "text/obj.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace pdeanim::text {

namespace {

constexpr int most_digits = 18;          // digits that are read; the 19th changes a number by less than 1e-17 of it
constexpr int most_exponent_digits = 4;  // exponents with more digits are left to the caller
constexpr i64 largest_exponent = 60;     // 10^60 overflows; mantissas with -60 - 18 underflow
constexpr i64 exact_power = 22;          // 10^22 is the largest power of ten that a double holds exactly
constexpr i64 exact_mantissa = i64{1} << 53;  // integers up to here are exact as doubles
// Bound on the relative error of a scaled mantissa: conversion, power of ten, product and dropped digits add up to less
// than 4 units of 2^-53.
constexpr double margin = 0x1p-50;
constexpr i64 smallest_point = -3, largest_point = 9;  // 0.0001 to 999999999 are written without an exponent
constexpr std::size_t number_width = 18;  // bytes of the longest number, "-1.23456789e-38", and a separator, with room

constexpr std::array<double, largest_exponent + 1> powers{
    1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8,  1e9,  1e10, 1e11, 1e12, 1e13, 1e14, 1e15,
    1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22, 1e23, 1e24, 1e25, 1e26, 1e27, 1e28, 1e29, 1e30, 1e31,
    1e32, 1e33, 1e34, 1e35, 1e36, 1e37, 1e38, 1e39, 1e40, 1e41, 1e42, 1e43, 1e44, 1e45, 1e46, 1e47,
    1e48, 1e49, 1e50, 1e51, 1e52, 1e53, 1e54, 1e55, 1e56, 1e57, 1e58, 1e59, 1e60};

constexpr bool is_digit(u8 byte) { return byte >= '0' && byte <= '9'; }

struct Decimal {
    i64 mantissa, exponent;  // mantissa * 10^exponent
};

struct Scaled {
    float value;
    bool is_certain;
};

// Return the float32 nearest to the float64 nearest to a decimal, and whether that is certain. The mantissa is from 0
// to 10^18.
Scaled scale(const Decimal &decimal) {
    const auto [mantissa, exponent] = decimal;
    if (mantissa == 0) return {0.0f, true};
    if (exponent > largest_exponent) return {HUGE_VALF, true};
    if (exponent < -largest_exponent) return {0.0f, exponent < -largest_exponent - most_digits};
    double value = static_cast<double>(mantissa);
    if (exponent >= 0) {
        value *= powers[exponent];
    } else {
        value /= powers[-exponent];
    }
    // Both factors are exact, so one rounding gives the nearest double.
    if (mantissa <= exact_mantissa && exponent >= -exact_power && exponent <= exact_power) {
        return {static_cast<float>(value), true};
    }
    const float low = static_cast<float>(value * (1.0 - margin));
    return {low, low == static_cast<float>(value * (1.0 + margin))};
}

// Return the first significant digits of a decimal number that has neither a sign nor an exponent.
Decimal keep_digits(const u8 *at, const u8 *end) {
    Decimal found{0, 0};
    int kept = 0;
    bool after_point = false;
    for (; at < end; ++at) {
        if (*at == '.') {
            after_point = true;
        } else if (kept < most_digits) {
            found.mantissa = found.mantissa * 10 + (*at - '0');
            kept += found.mantissa > 0;
            found.exponent -= after_point;
        } else {
            found.exponent += !after_point;
        }
    }
    return found;
}

// Return the shortest decimal, of at most nine digits, that reads back to a number; nothing if nine digits do not
// suffice. The number is finite and not negative.
std::optional<Decimal> shortest(float number) {
    if (number == 0.0f) return Decimal{0, 0};
    const double wide = number;
    const i64 leading = static_cast<i64>(std::floor(std::log10(wide)));
    // Begin with six digits, which float32 always preserves. A shorter decimal shows up as six digits with zeros at the
    // end.
    for (int digits = 6; digits < 10; ++digits) {
        const i64 shift = digits - 1 - leading;
        if (shift > largest_exponent || shift < -largest_exponent) return {};
        const double scaled = shift >= 0 ? wide * powers[shift] : wide / powers[-shift];
        Decimal found{static_cast<i64>(std::nearbyint(scaled)), -shift};
        const Scaled back = scale(found);
        if (back.is_certain && back.value == number) {
            for (; found.mantissa % 10 == 0; ++found.exponent) found.mantissa /= 10;
            return found;
        }
    }
    return {};
}

// Write a decimal that is not negative; return the end.
u8 *write_decimal(const Decimal &decimal, u8 *out) {
    std::array<u8, 20> reversed;
    i64 count = 0;
    for (i64 left = decimal.mantissa; left > 0 || count == 0; left /= 10) reversed[count++] = '0' + left % 10;
    const auto digits = [&](i64 number) {
        for (; number > 0; --number) *out++ = reversed[--count];
    };
    const auto zeros = [&](i64 number) {
        for (; number > 0; --number) *out++ = '0';
    };
    const i64 point = count + decimal.exponent;  // number of digits before the decimal point
    if (point < smallest_point || point > largest_point) {
        digits(1);
        if (count > 0) *out++ = '.';
        digits(count);
        const i64 power = size_of(point - 1);
        *out++ = 'e';
        *out++ = point < 1 ? '-' : '+';
        *out++ = static_cast<u8>('0' + power / 10);
        *out++ = static_cast<u8>('0' + power % 10);
    } else if (decimal.exponent >= 0) {
        digits(count);
        zeros(decimal.exponent);
    } else {
        if (point > 0) {
            digits(point);
        } else {
            *out++ = '0';
        }
        *out++ = '.';
        zeros(-point);
        digits(count);
    }
    return out;
}

}  // namespace

ReadNumber read_number(const u8 *at) {
    const bool is_negative = *at == '-';
    if (is_negative || *at == '+') ++at;
    const u8 *start = at;
    u64 mantissa = 0;  // may overflow if there are too many digits, which are then read again
    for (; is_digit(*at); ++at) mantissa = mantissa * 10 + (*at - '0');
    i64 digits = at - start;
    i64 exponent = 0;
    if (*at == '.') {
        const u8 *point = ++at;
        for (; is_digit(*at); ++at) mantissa = mantissa * 10 + (*at - '0');
        exponent = point - at;
        digits += at - point;
    }
    // Usually the digits fit a double, or there are only too many because of leading zeros.
    const Decimal kept = digits > most_digits ? keep_digits(start, at) : Decimal{static_cast<i64>(mantissa), exponent};
    bool is_plain = digits > 0;
    i64 power = 0;
    if (*at == 'e' || *at == 'E') {
        ++at;
        const bool is_below_one = *at == '-';
        if (is_below_one || *at == '+') ++at;
        start = at;
        for (; is_digit(*at) && at - start <= most_exponent_digits; ++at) power = power * 10 + (*at - '0');
        is_plain = is_plain && at > start && at - start <= most_exponent_digits;
        if (is_below_one) power = -power;
    }
    if (!is_plain || !(*at == '\n' || is_blank(*at))) return {0.0f, false, at};
    const Scaled scaled = scale({kept.mantissa, kept.exponent + power});
    return {is_negative ? -scaled.value : scaled.value, scaled.is_certain, at};
}

std::optional<std::vector<u8>> write_rows(std::span<const float> numbers, std::size_t columns, std::string_view word) {
    const std::size_t rows = columns > 0 ? numbers.size() / columns : 0;
    std::vector<u8> lines(rows * (word.size() + 1 + columns * number_width));
    u8 *out = lines.data();
    for (std::size_t row = 0; row < rows; ++row) {
        out = std::copy(word.begin(), word.end(), out);
        for (const float number : numbers.subspan(row * columns, columns)) {
            *out++ = ' ';
            if (std::signbit(number)) *out++ = '-';
            const std::optional<Decimal> decimal = shortest(std::abs(number));
            if (!decimal) return {};
            out = write_decimal(*decimal, out);
        }
        *out++ = '\n';
    }
    lines.resize(out - lines.data());
    return lines;
}

}  // namespace pdeanim::text
