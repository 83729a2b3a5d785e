#include "sections/residuals/missed.hpp"

#include <cmath>
#include <limits>

namespace pdeanim {

namespace {

double to_float32(double value) { return static_cast<double>(static_cast<float>(value)); }

// The larger distance of two values in float32 from a third; infinite, or NaN, where one is not finite.
double farthest(double wanted, double low, double high) {
    const double below = std::fabs(wanted - to_float32(low)), above = std::fabs(wanted - to_float32(high));
    return above > below ? above : below;
}

// Whether each vertex of a frame may miss the bound; returns whether any may. `squares` is room for 3 numbers a vertex.
bool find_missed(const Position *wanted, const std::array<double, 3> *decoded, double margin, double bound,
                 std::span<double> squares, std::span<u8> is_missed) {
    const float *points = wanted->data();
    const double *base = decoded->data();
    // Rounding to float32 takes half a spacing at most. What keeps the bound with all of that needs no closer look.
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
        // Not the other way round: a distance may be NaN.
        is_missed[vertex] = !((off_x * off_x + off_y * off_y) + off_z * off_z <= bound * bound);
        is_any |= is_missed[vertex];
    }
    return is_any;
}

template <class T> void append(std::vector<T> &all, const std::vector<T> &more) {
    all.insert(all.end(), more.begin(), more.end());
}

void append_starts(std::vector<i64> &all, const std::vector<i64> &more) {
    const i64 before = all.back();
    for (std::size_t frame = 1; frame < more.size(); ++frame) all.push_back(before + more[frame]);
}

}  // namespace

Residuals quantise_residuals(std::span<const Position> points, std::span<const std::array<double, 3>> base,
                             std::span<const i32> order, std::span<const double> margins, double bound, double step) {
    const std::size_t vertices = order.size();
    std::vector<u8> is_missed(vertices);
    std::vector<double> squares(3 * vertices);
    Residuals found;
    for (std::size_t frame = 0; frame < margins.size(); ++frame) {
        const Position *wanted = &points[frame * vertices];
        const std::array<double, 3> *decoded = &base[frame * vertices];
        const double margin = margins[frame];
        const bool is_any = find_missed(wanted, decoded, margin, bound, squares, is_missed);
        for (std::size_t place = 0; is_any && place < vertices; ++place) {
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
