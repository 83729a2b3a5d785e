#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "sections/temporal/time_functions.hpp"

namespace pdeanim {

namespace {

// Number of frequencies that are added together: their sums stay in registers.
constexpr int at_once = 4;

// Return cos x for x from 0 to pi / 2, as phi_0(x) - phi_2(x) of the series functions of order 4 at rate 1. All terms
// of each of these functions have the same sign.
double cosine(double x) {
    constexpr int terms = 14;
    const double square = x * x, power = square * square;
    std::array<double, 2> totals = {1.0, 1.0};  // sums of phi_0 and phi_2
    // Horner's scheme from the smallest term.
    for (int k = terms; k > 0; --k) {
        for (int j = 0; j < 2; ++j) {
            const int first = 4 * (k - 1) + 2 * j + 1;
            const double quotient = first * (first + 1) * (first + 2) * (first + 3);
            totals[j] = 1.0 + totals[j] * (power / quotient);
        }
    }
    return totals[0] - totals[1] * (square / 2);
}

}  // namespace

std::vector<double> cosine_wave(i64 frames) {
    const double unit = std::numbers::pi / static_cast<double>(2 * frames);
    std::vector<double> wave(4 * frames);
    for (i64 j = 0; j <= frames; ++j) wave[j] = cosine(static_cast<double>(j) * unit);
    for (i64 j = frames + 1; j <= 2 * frames; ++j) wave[j] = -wave[2 * frames - j];
    for (i64 j = 2 * frames + 1; j < 4 * frames; ++j) wave[j] = wave[4 * frames - j];
    return wave;
}

std::vector<double> transformed_values(const TimeShape &shape, std::span<const i64> quantised, double step) {
    const auto &[functions, frames, axes] = shape;
    if (shape.numbers() == 0) return {};
    const std::vector<double> wave = cosine_wave(frames);
    std::vector<double> sums(shape.numbers());  // function after function, axis after axis, frame after frame
    std::vector<double> rows(at_once * frames);
    for (i64 first = 0; first < frames; first += at_once) {
        std::array<double, at_once> scales{};
        for (i64 j = 0; j < at_once && first + j < frames; ++j) {
            const i64 frequency = first + j;
            scales[j] = std::sqrt((frequency > 0 ? 2.0 : 1.0) / static_cast<double>(frames));
            i64 at = frequency;
            for (i64 frame = 0; frame < frames; ++frame) {
                rows[j * frames + frame] = wave[at];
                at += 2 * frequency;
                if (at >= 4 * frames) at -= 4 * frames;
            }
        }
        for (i64 channel = 0; channel < functions * axes; ++channel) {
            // A frequency beyond the last, or one without amplitude, adds zero.
            const i64 *numbers = &quantised[(channel / axes * frames + first) * axes + channel % axes];
            std::array<double, at_once> amplitudes{};
            bool is_zero = true;
            for (i64 j = 0; j < at_once && first + j < frames; ++j) {
                amplitudes[j] = static_cast<double>(numbers[j * axes]) * scales[j];
                is_zero &= numbers[j * axes] == 0;
            }
            if (is_zero) continue;
            double *sum = &sums[channel * frames];
            const double *row = rows.data();
            for (i64 frame = 0; frame < frames; ++frame) {
                double total = sum[frame];
                for (i64 j = 0; j < at_once; ++j) total += amplitudes[j] * row[j * frames + frame];
                sum[frame] = total;
            }
        }
    }
    std::vector<double> values(shape.numbers());
    for (i64 channel = 0; channel < functions * axes; ++channel) {
        for (i64 frame = 0; frame < frames; ++frame) {
            const double sum = sums[channel * frames + frame];
            values[(frame * axes + channel % axes) * functions + channel / axes] = sum * step;
        }
    }
    return values;
}

namespace {

constexpr i64 units = 16;  // units of speed per step

}  // namespace

std::vector<double> values_along_lines(const TimeShape &shape, std::span<const i64> quantised, double step) {
    const auto &[functions, frames, axes] = shape;
    const double unit = step / units;
    std::vector<double> values(shape.numbers());
    for (i64 function = 0; function < functions; ++function) {
        for (i64 axis = 0; axis < axes; ++axis) {
            i64 position = 0, speed = 0;
            for (i64 frame = 0; frame < frames; ++frame) {
                const i64 number = quantised[(function * frames + frame) * axes + axis];
                if (frame > 0) speed += number;
                position += frame > 0 ? speed : number;
                values[(frame * axes + axis) * functions + function] = static_cast<double>(position) * unit;
            }
        }
    }
    return values;
}

std::vector<i64> quantise_straight(const TimeShape &shape, std::span<const double> wanted, double tolerance) {
    constexpr double infinity = std::numeric_limits<double>::infinity();
    const i64 functions = shape.functions, frames = shape.frames, axes = shape.axes;
    const double farthest = tolerance * units;
    std::vector<i64> quantised(wanted.size());
    for (i64 function = 0; function < functions; ++function) {
        for (i64 axis = 0; axis < axes; ++axis) {
            const auto at = [&](i64 frame) { return (function * frames + frame) * axes + axis; };
            const double first = wanted[at(0)];
            i64 value = std::fabs(first) <= tolerance ? 0 : static_cast<i64>(std::nearbyint(first * units));
            quantised[at(0)] = value;
            i64 speed = 0;
            for (i64 begin = 0, end; begin < frames - 1; begin = end) {
                const auto rise = [&](i64 frame) { return wanted[at(frame)] * units - static_cast<double>(value); };
                double slowest = -infinity, fastest = infinity;
                end = begin;
                for (i64 frame = begin + 1; frame < frames; ++frame) {
                    const double elapsed = static_cast<double>(frame - begin);
                    const double slower = most(slowest, (rise(frame) - farthest) / elapsed);
                    const double faster = least(fastest, (rise(frame) + farthest) / elapsed);
                    if (std::ceil(slower) > std::floor(faster)) break;
                    slowest = slower;
                    fastest = faster;
                    end = frame;
                }
                const i64 lowest = static_cast<i64>(std::ceil(slowest));
                const i64 highest = static_cast<i64>(std::floor(fastest));
                const auto is_possible = [&](i64 other) { return lowest <= other && other <= highest; };
                i64 found = speed;
                if (!is_possible(speed)) {
                    const double mean = rise(end) / static_cast<double>(end - begin);
                    found = is_possible(0) ? 0 : clamp(static_cast<i64>(std::nearbyint(mean)), lowest, highest);
                }
                quantised[at(begin + 1)] = found - speed;
                value += found * (end - begin);
                speed = found;
            }
        }
    }
    return quantised;
}

}  // namespace pdeanim
