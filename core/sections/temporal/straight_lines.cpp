#include "sections/temporal/straight_lines.hpp"

#include <cmath>
#include <limits>

namespace pdeanim {

namespace {

constexpr i64 units = 16;  // of a step

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
