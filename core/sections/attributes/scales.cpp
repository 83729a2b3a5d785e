#include "sections/attributes/scales.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

namespace pdeanim {

namespace {

constexpr int float_bits = 24;  // digits of a float32's fraction: a finer grid than this would hold every float32

// Return the divisors of the grids to try, in increasing order: the usual ones and another one.
std::vector<i64> divisors_and(i64 another) {
    std::vector<i64> divisors = {255, 1023, 4095, 32767, 65535, another};
    for (int digits = 0; digits < float_bits + 7; ++digits) divisors.push_back(i64{1} << digits);
    for (i64 power = 10; power <= 100'000'000; power *= 10) divisors.push_back(power);
    std::sort(divisors.begin(), divisors.end());
    divisors.erase(std::unique(divisors.begin(), divisors.end()), divisors.end());
    return divisors;
}

// Return the code of a value on a grid, if the grid holds it exactly.
std::optional<i32> code_on(const Scale &scale, float value) {
    const double wide = value;
    const double fraction = scale.kind == Scale::complement ? 1.0 - wide : wide;
    const double code = std::nearbyint(fraction * static_cast<double>(scale.divisor));
    if (!(std::abs(code) <= static_cast<double>(largest_code))) return std::nullopt;
    const i32 found = static_cast<i32>(code);
    if (std::bit_cast<u32>(scale.value_of(found)) != std::bit_cast<u32>(value)) return std::nullopt;
    return found;
}

i32 place_of(float value) {
    const i32 bits = std::bit_cast<i32>(value);
    return bits < 0 ? -1 - (bits & INT32_MAX) : bits;
}

// One channel of an array: every `step`-th value, from `first` on.
struct Column {
    std::span<const float> values;
    std::size_t first, step;

    // Write the codes of a column's values on a grid; return whether the grid holds all values exactly.
    bool write_codes(const Scale &scale, std::vector<i32> &codes) const {
        for (std::size_t at = first; at < values.size(); at += step) {
            const std::optional<i32> code = code_on(scale, values[at]);
            if (!code) return false;
            codes[at] = *code;
        }
        return true;
    }
};

// Return the coarsest grid that holds a column exactly, if any. All values are below 2^exponent.
std::optional<Scale> grid_of(const Column &column, int exponent, std::span<const i64> divisors,
                             std::vector<i32> &codes) {
    for (const i64 divisor : divisors) {
        if (static_cast<double>(divisor) > std::ldexp(1.0, float_bits - exponent)) return std::nullopt;
        for (const Scale::Kind kind : {Scale::fraction, Scale::complement}) {
            // If values are fractions of a power of two, their complements are too: no need to try.
            if (kind == Scale::complement && std::has_single_bit(static_cast<u64>(divisor))) continue;
            const Scale scale{kind, divisor};
            if (column.write_codes(scale, codes)) return scale;
        }
    }
    return std::nullopt;
}

}  // namespace

float Scale::value_of(i32 code) const {
    if (kind == place) return std::bit_cast<float>(code < 0 ? static_cast<u32>(-1 - code) | 1u << 31 : code);
    const float value = static_cast<float>(static_cast<double>(code) / static_cast<double>(divisor));
    return kind == complement ? 1.0f - value : value;
}

i64 Scale::linear_of(i64 code, int shift) const {
    i64 value;
    if (kind == place) {
        const i64 bits = code >= 0 ? code : -1 - code, exponent = bits >> 23;
        if (exponent == 0 || exponent == 255) return 0;
        value = (bits & 0x7FFFFF) | 0x800000;
        const int up = static_cast<int>(exponent) - 150 + shift;
        value = up >= 0 ? value << least(up, linear_bits) : value >> least(-up, linear_bits);
        if (code < 0) value = -value;
    } else {
        value = floor_divide(code * (i64{1} << shift), divisor);
        if (kind == complement) value = (i64{1} << shift) - value;
    }
    return clamp(value, -largest_linear, largest_linear);
}

i64 Scale::code_near(i64 linear, int shift) const {
    linear = clamp(linear, -largest_linear, largest_linear);
    if (kind == place) {
        const i64 size = size_of(linear);
        const int length = bit_length(size), exponent = least(length + 126 - shift, 254);
        if (length == 0 || exponent <= 0) return 0;
        const i64 digits = length <= 24 ? size << (24 - length) : size >> (length - 24);
        const i64 bits = (static_cast<i64>(exponent) << 23) | (digits & 0x7FFFFF);
        return linear >= 0 ? bits : -1 - bits;
    }
    if (kind == complement) linear = (i64{1} << shift) - linear;
    return clamp((linear * divisor + ((i64{1} << shift) >> 1)) >> shift, -largest_code - 1, largest_code);
}

Scales byte_scales(int channels) { return {std::vector<Scale>(channels), linear_bits - 8}; }

Channels codes_of_floats(std::span<const float> values, int channels, i64 divisor) {
    float largest = 0;
    for (const float value : values) {
        if (std::isfinite(value)) largest = most(largest, std::abs(value));
    }
    int exponent = 0;
    std::frexp(static_cast<double>(largest), &exponent);
    Channels found;
    found.codes.resize(values.size());
    found.scales.shift = least(linear_bits - exponent, static_cast<int>(largest_shift));
    const std::vector<i64> divisors = divisors_and(divisor);
    bool any_grid = false;
    for (int k = 0; k < channels; ++k) {
        const Column column{values, static_cast<std::size_t>(k), static_cast<std::size_t>(channels)};
        std::optional<Scale> scale;
        if (linear_bits >= exponent) scale = grid_of(column, exponent, divisors, found.codes);
        any_grid = any_grid || scale;
        if (!scale) {
            scale = Scale{Scale::place, 1};
            for (std::size_t at = k; at < values.size(); at += column.step) found.codes[at] = place_of(values[at]);
        }
        found.scales.of_channel.push_back(*scale);
    }
    if (any_grid) found.scales.shift = least(found.scales.shift, linear_bits);
    return found;
}

i64 round_within(std::span<float> values, int channels, double tolerance) {
    const double wanted = std::ceil(0.5 / tolerance);
    if (!(wanted <= static_cast<double>(largest_code))) return 1;
    const i64 divisor = most<i64>(1, static_cast<i64>(wanted));
    i64 coarsest = 0;
    for (const Scale &scale : codes_of_floats(values, channels, 1).scales.of_channel) {
        coarsest = most(coarsest, scale.kind == Scale::place ? INT64_MAX : scale.divisor);
    }
    if (coarsest <= divisor) return divisor;
    double largest = 1;
    for (const float value : values) {
        if (std::isnan(value)) return divisor;
        largest = most(largest, std::abs(static_cast<double>(value)));
    }
    // Rounding to float32 may move a value by more than half a grid width. Then try a grid twice as fine.
    for (const i64 finer : {divisor, 2 * divisor}) {
        const double unit = static_cast<double>(finer);
        if (!(largest * unit <= static_cast<double>(largest_code))) continue;
        std::vector<float> rounded;
        bool is_near = true;
        for (const float value : values) {
            const double wide = value;
            rounded.push_back(static_cast<float>(std::nearbyint(wide * unit) / unit));
            is_near = is_near && std::abs(rounded.back() - wide) <= tolerance;
        }
        if (!is_near) continue;
        std::copy(rounded.begin(), rounded.end(), values.begin());
        return finer;
    }
    return divisor;
}

}  // namespace pdeanim
