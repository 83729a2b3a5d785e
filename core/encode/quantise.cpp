#include "encode/quantise.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <mutex>

#include "base/parallel.hpp"

namespace pdeanim {

template <class Real> double take_displacements(std::span<const float> points, std::span<const double> shape,
                                                double farthest, std::span<Real> rows, int threads) {
    constexpr i64 block = 64;  // vertices whose rows are written together: a frame is read in whole cache lines
    const i64 vertices = static_cast<i64>(shape.size()) / 3;
    const i64 frames = vertices ? static_cast<i64>(points.size() / shape.size()) : 0;
    double largest = 0.0;
    std::mutex lock;
    in_shares((vertices + block - 1) / block, threads, [&](i64 first, i64 end) {
        double found = 0.0;
        for (i64 begin = first * block; begin < least(end * block, vertices); begin += block) {
            const i64 stop = least(begin + block, vertices);
            for (i64 frame = 0; frame < frames; ++frame) {
                const float *from = points.data() + 3 * frame * vertices;
                for (i64 vertex = begin; vertex < stop; ++vertex) {
                    Real *to = rows.data() + 3 * (vertex * frames + frame);
                    for (i64 axis = 0; axis < 3; ++axis) {
                        const double moved = static_cast<double>(from[3 * vertex + axis]) - shape[3 * vertex + axis];
                        const double kept = std::fabs(moved) <= farthest ? moved : 0.0;
                        to[axis] = static_cast<Real>(kept);
                        found = most(found, std::fabs(kept));
                    }
                }
            }
        }
        const std::lock_guard guard(lock);
        largest = most(largest, found);
    });
    return largest;
}

template double take_displacements(std::span<const float>, std::span<const double>, double, std::span<float>, int);
template double take_displacements(std::span<const float>, std::span<const double>, double, std::span<double>, int);

template <class Real> Quantised quantise_sparsely(std::span<const Real> values, i64 channels, int axes, double step,
                                                  const DeadZone &zone, int threads) {
    Quantised all{LargeArray<i64>(values.size()), std::vector<i64>(channels)};
    std::mutex lock;
    const i64 rows = channels ? static_cast<i64>(values.size()) / channels : 0;
    const double round_up = 1.0 - zone.round_up_at, alone = zone.round_up_alone_at * step;
    const double surely_zero = 0.999 * zone.round_up_at * step;  // recognises most zeros without a division
    const auto size_at = [&](i64 at) { return std::fabs(static_cast<double>(values[at])); };
    const auto magnitude = [&](i64 at) { return std::floor(size_at(at) / step + round_up); };
    const auto is_used = [&](i64 row, i64 channel) {
        return 0 <= row && row < rows && 0 <= channel && channel < channels && magnitude(row * channels + channel) != 0;
    };
    in_shares(rows, threads, [&](i64 first, i64 end) {
        std::vector<i64> largest(channels);
        for (i64 row = first; row < end; ++row) {
            std::fill_n(all.coefficients.begin() + row * channels, channels, 0);
            for (i64 channel = 0; channel < channels; ++channel) {
                const i64 at = row * channels + channel;
                if (size_at(at) < surely_zero) continue;
                const double size = magnitude(at);
                if (size == 0.0) continue;
                if (size_at(at) < alone && !is_used(row - 1, channel) && !is_used(row + 1, channel) &&
                    !is_used(row, channel - axes) && !is_used(row, channel + axes)) {
                    continue;
                }
                const i64 whole = static_cast<i64>(size);
                all.coefficients[at] = values[at] < 0 ? -whole : whole;
                largest[channel] = most(largest[channel], whole);
            }
        }
        const std::lock_guard guard(lock);
        for (i64 channel = 0; channel < channels; ++channel) {
            all.largest[channel] = most(all.largest[channel], largest[channel]);
        }
    });
    return all;
}

template Quantised quantise_sparsely(std::span<const float>, i64, int, double, const DeadZone &, int);
template Quantised quantise_sparsely(std::span<const double>, i64, int, double, const DeadZone &, int);

namespace {

double to_float32(double value) { return static_cast<double>(static_cast<float>(value)); }

// Return the larger of the distances of two values, rounded to float32, from a wanted value; infinite or NaN if one is
// not finite.
double farthest(double wanted, double low, double high) {
    const double below = std::fabs(wanted - to_float32(low)), above = std::fabs(wanted - to_float32(high));
    return above > below ? above : below;
}

// Find which vertices of a frame may miss the bound, and return whether any may. `squares` is a buffer of 3 numbers per
// vertex.
bool find_missed(const Position *wanted, const std::array<double, 3> *decoded, double margin, double bound,
                 std::span<double> squares, std::span<u8> is_missed) {
    const float *points = wanted->data();
    const double *base = decoded->data();
    // Rounding to float32 moves a coordinate by at most half a spacing. Vertices that keep the bound even with that are
    // done.
    const double farther = margin * (1.0 + 0x1p-22) + 0x1p-148, enough = bound * bound * (1.0 - 0x1p-40);
    for (std::size_t i = 0; i < squares.size(); ++i) {
        const double off =
            std::fabs(static_cast<double>(points[i]) - base[i]) + (std::fabs(base[i]) * 0x1p-24 + farther);
        squares[i] = off * off;
    }
    bool is_any = false;
    for (std::size_t vertex = 0; vertex < is_missed.size(); ++vertex) {
        is_missed[vertex] = 0;
        if (squares[3 * vertex] + squares[3 * vertex + 1] + squares[3 * vertex + 2] <= enough) continue;
        const auto &[x, y, z] = decoded[vertex];
        const double off_x = farthest(wanted[vertex][0], x - margin, x + margin);
        const double off_y = farthest(wanted[vertex][1], y - margin, y + margin);
        const double off_z = farthest(wanted[vertex][2], z - margin, z + margin);
        // Written as !(... <= ...) because the distance may be NaN.
        is_missed[vertex] = !((off_x * off_x + off_y * off_y) + off_z * off_z <= bound * bound);
        is_any |= is_missed[vertex];
    }
    return is_any;
}

void append_starts(std::vector<i64> &all, const std::vector<i64> &more) {
    const i64 before = all.back();
    for (std::size_t frame = 1; frame < more.size(); ++frame) all.push_back(before + more[frame]);
}

}  // namespace

Residuals quantise_residuals(std::span<const Position> points, std::span<const std::array<double, 3>> base,
                             std::span<const i32> order, std::span<const double> margins, double bound, double step) {
    const std::size_t vertices = margins.empty() ? 0 : base.size() / margins.size();
    std::vector<u8> is_missed(vertices);
    std::vector<double> squares(3 * vertices);
    Residuals found;
    for (std::size_t frame = 0; frame < margins.size(); ++frame) {
        const Position *wanted = &points[frame * vertices];
        const std::array<double, 3> *decoded = &base[frame * vertices];
        const double margin = margins[frame];
        const bool is_any = find_missed(wanted, decoded, margin, bound, squares, is_missed);
        for (std::size_t place = 0; is_any && place < order.size(); ++place) {
            const i32 vertex = order[place];
            if (!is_missed[vertex]) continue;
            Steps steps{};
            double square = 0.0;
            for (int axis = 0; axis < 3; ++axis) {
                const double point = wanted[vertex][axis], before = decoded[vertex][axis];
                double number = std::nearbyint((point - to_float32(before)) / step);
                if (!(std::fabs(number) <= static_cast<double>(largest_residual))) {
                    square = std::numeric_limits<double>::infinity();
                    number = 0.0;
                }
                steps[axis] = static_cast<i64>(number);
                const double distance = farthest(point, to_float32(before - margin) + number * step,
                                                 to_float32(before + margin) + number * step);
                square += distance * distance;
            }
            if (square <= bound * bound) {
                found.places.push_back(static_cast<i32>(place));
                found.quantised.push_back(steps);
            } else {
                found.raw_places.push_back(static_cast<i32>(place));
                found.raw_positions.push_back(wanted[vertex]);
            }
        }
        found.frame_starts.push_back(static_cast<i64>(found.places.size()));
        found.raw_frame_starts.push_back(static_cast<i64>(found.raw_places.size()));
    }
    return found;
}

Residuals join_residuals(std::span<const Residuals *const> parts) {
    Residuals all;
    for (const Residuals *part : parts) {
        append_starts(all.frame_starts, part->frame_starts);
        append(all.places, part->places);
        append(all.quantised, part->quantised);
        append_starts(all.raw_frame_starts, part->raw_frame_starts);
        append(all.raw_places, part->raw_places);
        append(all.raw_positions, part->raw_positions);
    }
    return all;
}

}  // namespace pdeanim
