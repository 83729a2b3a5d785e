// Smoothing of the decoded grid coordinates (7.7 of the specification): an adaptive filter, like the loop filters of
// video codecs (Tsai et al. 2013, "Adaptive loop filtering for video coding").
//
// A vertex moves by a weighted sum of its Laplacian, which is the mean of its neighbours minus itself, and of the
// Laplacian of the Laplacian. The magnitude of the Laplacian gives the vertex's class, which selects the weights. A
// Laplacian much smaller than the quantisation step is mostly quantisation noise; a large one belongs to the shape.
#include <algorithm>
#include <cmath>

#include "sections/reference/reference.hpp"

namespace pdeanim {

namespace {

constexpr i64 unit = i64{1} << smooth_bits;
constexpr int smoothing_weight_bits = 4;  // fraction bits of weights
constexpr double largest_smoothing = 127.0;

// Smallest magnitude of the Laplacian in each class but the first [1/64 steps].
constexpr std::array<i64, smoothing_classes - 1> class_sizes = {16, 32, 48, 64, 96, 160};

// Largest ratio of the errors with and without smoothing at which the weights are worth their bytes.
constexpr double worthwhile_ratio = 0.97;

struct Neighbours {
    explicit Neighbours(const CornerTable &corners) {
        starts.reserve(corners.vertices() + 1);
        for (i64 vertex = 0; vertex < corners.vertices(); ++vertex) {
            const i64 begin = corners.fan_starts[vertex];
            const i64 end = least(corners.fan_starts[vertex + 1], begin + most_corners);
            for (i64 row = begin; row < end; ++row) {
                const i32 corner = corners.fan[row], before = corners.previous[corner];
                vertices.push_back(corners.vertex(corners.next[corner]));
                // Inside a surface, the vertex before is also the vertex after of the adjacent corner, and is added
                // there.
                if (neighbourhood_at(corners, corner).before_counts) vertices.push_back(corners.vertex(before));
            }
            starts.push_back(static_cast<i64>(vertices.size()));
        }
    }

    // Return the mean of the neighbours minus the vertex itself, times `scale`, rounded; 0 for a vertex without
    // neighbours.
    std::vector<Vector> laplacian(std::span<const Vector> values, i64 scale) const {
        std::vector<Vector> found(values.size());
        for (std::size_t v = 0; v < values.size(); ++v) {
            const i64 count = starts[v + 1] - starts[v];
            if (count == 0) continue;
            for (int axis = 0; axis < 3; ++axis) {
                i64 sum = 0;
                for (i64 k = starts[v]; k < starts[v + 1]; ++k) sum += values[vertices[k]][axis] - values[v][axis];
                found[v][axis] = floor_divide(2 * scale * sum + count, 2 * count);
            }
        }
        return found;
    }

    std::vector<i64> starts{0};
    std::vector<i32> vertices;
};

// The two quantities that smoothing moves vertices by.
struct Bends {
    Bends(const CornerTable &corners, std::span<const Vector> grid) {
        const Neighbours neighbours(corners);
        first = neighbours.laplacian(grid, unit);
        second = neighbours.laplacian(first, 1);
    }

    int class_of(std::size_t v) const {
        const i64 size = most(size_of(first[v][0]), most(size_of(first[v][1]), size_of(first[v][2])));
        return static_cast<int>(std::upper_bound(class_sizes.begin(), class_sizes.end(), size) - class_sizes.begin());
    }

    i64 move(const std::array<i32, 2> &weights, std::size_t v, int axis) const {
        const i64 sum = weights[0] * first[v][axis] + weights[1] * second[v][axis];
        return clamp((sum + (1 << (smoothing_weight_bits - 1))) >> smoothing_weight_bits, -unit / 2, unit / 2);
    }

    std::vector<Vector> first, second;  // the Laplacian, and the Laplacian of the Laplacian [1/64 steps]
};

i32 rounded_weight(double weight) {
    return static_cast<i32>(
        clamp(std::nearbyint(weight * (1 << smoothing_weight_bits)), -largest_smoothing, largest_smoothing));
}

// Sums for a least squares fit of two weights.
struct Fit {
    double first = 0.0, both = 0.0, second = 0.0, first_target = 0.0, second_target = 0.0;

    void add(double a, double b, double target) {
        first += a * a;
        both += a * b;
        second += b * b;
        first_target += a * target;
        second_target += b * target;
    }

    std::array<i32, 2> weights() const {
        constexpr double dependent = 1e-6;
        const double determinant = first * second - both * both;
        if (!(first > 0.0)) return {};
        if (!(determinant > dependent * first * second)) return {rounded_weight(first_target / first), 0};
        return {rounded_weight((first_target * second - second_target * both) / determinant),
                rounded_weight((second_target * first - first_target * both) / determinant)};
    }
};

}  // namespace

std::vector<Vector> smoothed(const CornerTable &corners, std::span<const Vector> grid,
                             const SmoothingWeights &weights) {
    const Bends bends(corners, grid);
    std::vector<Vector> found(grid.begin(), grid.end());
    for (std::size_t v = 0; v < grid.size(); ++v) {
        const auto &own = weights[bends.class_of(v)];
        for (int axis = 0; axis < 3; ++axis) found[v][axis] = unit * grid[v][axis] + bends.move(own, v, axis);
    }
    return found;
}

std::optional<FittedSmoothing> fit_smoothing(const CornerTable &corners, std::span<const Vector> grid,
                                             std::span<const std::array<double, 3>> wanted) {
    const Bends bends(corners, grid);
    const auto away = [&](std::size_t v, int axis) {
        return (wanted[v][axis] - static_cast<double>(grid[v][axis])) * unit;
    };
    std::array<Fit, smoothing_classes> fits;
    for (std::size_t v = 0; v < grid.size(); ++v) {
        Fit &own = fits[bends.class_of(v)];
        for (int axis = 0; axis < 3; ++axis) {
            own.add(static_cast<double>(bends.first[v][axis]), static_cast<double>(bends.second[v][axis]),
                    away(v, axis));
        }
    }
    SmoothingWeights weights;
    std::transform(fits.begin(), fits.end(), weights.begin(), [](const Fit &fit) { return fit.weights(); });
    double before = 0.0, after = 0.0;
    for (std::size_t v = 0; v < grid.size(); ++v) {
        const auto &own = weights[bends.class_of(v)];
        for (int axis = 0; axis < 3; ++axis) {
            const double left = away(v, axis), moved = left - static_cast<double>(bends.move(own, v, axis));
            before += left * left;
            after += moved * moved;
        }
    }
    const double ratio = before > 0.0 ? std::sqrt(after / before) : 1.0;
    if (ratio > worthwhile_ratio) return std::nullopt;
    return FittedSmoothing{weights, ratio};
}

}  // namespace pdeanim
