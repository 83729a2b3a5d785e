#include "text/normals.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "base/lanes.hpp"

namespace pdeanim {

namespace {

// Number of corners of a block, whose data then stay in the first-level cache; a block with a single face may have
// more.
constexpr i64 block_corners = 128;

// atan(q) / q for q from 0 to 1, as a polynomial of q^2 fitted at Chebyshev's points: relative error at most 2e-8.
constexpr double arctangent[] = {0.999999984242636,  -0.333330667806907,  0.199924835784912,
                                 -0.142025705116405, 0.106367540979346,   -0.0749544544299354,
                                 0.0425876074622067, -0.0160050305020123, 0.00283406429872349};

using Numbers = std::vector<double>;

struct Vectors {
    Numbers x, y, z;

    explicit Vectors(std::size_t count) : x(count), y(count), z(count) {}
};

double length_of(double x, double y, double z) { return std::sqrt(x * x + y * y + z * z); }

// Compute angles from their sines and cosines, both multiplied by the same factor; sines are not negative. There are no
// branches, so that several angles are computed at once.
PDEANIM_INLINE void find_angles(const double *sines, const double *cosines, double *angles, i64 count) {
    for (i64 i = 0; i < count; ++i) {
        const double size = std::abs(cosines[i]);
        const double high = size > sines[i] ? size : sines[i], low = size > sines[i] ? sines[i] : size;
        const double q = low / (high > 0 ? high : 1), square = q * q;
        double sum = arctangent[std::size(arctangent) - 1];
        for (int k = static_cast<int>(std::size(arctangent)) - 2; k >= 0; --k) sum = sum * square + arctangent[k];
        const double acute = size > sines[i] ? q * sum : std::numbers::pi / 2 - q * sum;
        const double angle = cosines[i] < 0 ? std::numbers::pi - acute : acute;
        angles[i] = high == 0 ? 0 : angle;
    }
}

}  // namespace

CornerNormals::CornerNormals(std::span<const i32> face_sizes, std::span<const i32> vertices, std::span<const i32> rows,
                             i64 sums)
    : face_sizes_(face_sizes), vertices_(vertices), rows_(rows), sums_(sums), next_(vertices.size()),
      previous_(vertices.size()) {
    Block block{};
    for (const i32 size : face_sizes) {
        const i64 within = block.end_corner - block.first_corner;
        for (i32 k = 0; k < size; ++k) {
            next_[block.end_corner + k] = static_cast<i32>(within + (k + 1 == size ? 0 : k + 1));
            previous_[block.end_corner + k] = static_cast<i32>(within + (k == 0 ? size - 1 : k - 1));
        }
        block.end_corner += size;
        ++block.end_face;
        if (within + size >= block_corners) {
            blocks_.push_back(block);
            block.first_face = block.end_face;
            block.first_corner = block.end_corner;
        }
    }
    if (block.end_face > block.first_face) blocks_.push_back(block);
    for (const Block &one : blocks_) largest_block_ = std::max(largest_block_, one.end_corner - one.first_corner);
}

void CornerNormals::find(const float *points, float *normals) const {
    Numbers sums(3 * sums_);
    Vectors at(largest_block_), product(largest_block_);
    Numbers sines(largest_block_), cosines(largest_block_), angles(largest_block_);
    for (const Block &block : blocks_) {
        const i64 count = block.end_corner - block.first_corner;
        for (i64 i = 0; i < count; ++i) {
            const float *point = points + 3 * static_cast<i64>(vertices_[block.first_corner + i]);
            at.x[i] = point[0], at.y[i] = point[1], at.z[i] = point[2];
        }
        for (i64 i = 0; i < count; ++i) {
            const i32 next = next_[block.first_corner + i], previous = previous_[block.first_corner + i];
            const double ax = at.x[next] - at.x[i], ay = at.y[next] - at.y[i], az = at.z[next] - at.z[i];
            const double bx = at.x[previous] - at.x[i], by = at.y[previous] - at.y[i], bz = at.z[previous] - at.z[i];
            product.x[i] = ay * bz - az * by;
            product.y[i] = az * bx - ax * bz;
            product.z[i] = ax * by - ay * bx;
            cosines[i] = ax * bx + ay * by + az * bz;
        }
        in_wide([&](auto) PDEANIM_INLINE_LAMBDA {
            const double *x = product.x.data(), *y = product.y.data(), *z = product.z.data();
            double *found = sines.data();
            for (i64 i = 0; i < count; ++i) found[i] = std::sqrt(x[i] * x[i] + y[i] * y[i] + z[i] * z[i]);
            find_angles(found, cosines.data(), angles.data(), count);
        });
        i64 first = 0;
        for (i64 face = block.first_face; face < block.end_face; ++face) {
            const i32 size = face_sizes_[face];
            double x = product.x[first], y = product.y[first], z = product.z[first], length = sines[first];
            if (size > 3) {
                // Coordinates are relative to the first corner, so that nothing cancels far from the origin.
                x = y = z = 0;
                for (i64 k = first + 1; k + 1 < first + size; ++k) {
                    const double ax = at.x[k] - at.x[first], ay = at.y[k] - at.y[first], az = at.z[k] - at.z[first];
                    const double bx = at.x[k + 1] - at.x[first], by = at.y[k + 1] - at.y[first],
                                 bz = at.z[k + 1] - at.z[first];
                    x += ay * bz - az * by;
                    y += az * bx - ax * bz;
                    z += ax * by - ay * bx;
                }
                length = length_of(x, y, z);
            }
            const bool has_direction = length > 0 && length < std::numeric_limits<double>::infinity();
            const double scale = has_direction ? 1 / length : 0;
            for (i64 i = first; i < first + size && has_direction; ++i) {
                double *sum = sums.data() + 3 * static_cast<i64>(rows_[block.first_corner + i]);
                const double weight = angles[i] * scale;
                sum[0] += x * weight;
                sum[1] += y * weight;
                sum[2] += z * weight;
            }
            first += size;
        }
    }
    for (i64 row = 0; row < sums_; ++row) {
        const double *sum = sums.data() + 3 * row;
        const double length = length_of(sum[0], sum[1], sum[2]);
        const bool has_direction = length > 0 && length < std::numeric_limits<double>::infinity();
        const double scale = has_direction ? 1 / length : 0;
        normals[3 * row] = static_cast<float>(has_direction ? sum[0] * scale : 0);
        normals[3 * row + 1] = static_cast<float>(has_direction ? sum[1] * scale : 0);
        normals[3 * row + 2] = static_cast<float>(has_direction ? sum[2] * scale : 1);
    }
}

}  // namespace pdeanim
