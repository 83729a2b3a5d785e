#include "sections/spatial/local_coordinates.hpp"

#include <cmath>
#include <utility>

namespace pdeanim {

namespace {

constexpr int sum_bits = 61;          // of a sum of squares of one coordinate: three of them stay below 2^63
constexpr int moment_bits = 30;       // of moments as rotations are chosen by them: products of two stay below 2^63
constexpr int turn_bits = 30;         // fraction bits of sines and cosines
constexpr int uncorrelated_bits = 8;  // two are turned where their correlation's square exceeds 2 to minus this
constexpr i64 floor_moment = 16;      // added to moments that are compared: rounding is not correlated with anything
constexpr int most_sweeps = 8;        // of rotations; three or four are enough
constexpr int thinnest_bits = 20;     // a coordinate with less of all sums of squares is none: it is mostly rounding

using Axis = std::vector<i64>;

i64 moment(const Axis &a, const Axis &b) {
    i64 total = 0;
    for (std::size_t i = 0; i < a.size(); ++i) total += a[i] * b[i];
    return total;
}

void turn(Axis &a, Axis &b, i64 cosine, i64 sine) {
    for (std::size_t i = 0; i < a.size(); ++i) {
        const i64 before = a[i], after = b[i];
        a[i] = (cosine * before - sine * after) >> turn_bits;
        b[i] = (sine * before + cosine * after) >> turn_bits;
    }
}

// Turn two coordinates so that they are not correlated; false where they hardly are.
bool decorrelate(Axis &a, Axis &b, int shift) {
    const i64 first = moment(a, a), second = moment(b, b), mixed = moment(a, b);
    const i64 apart = ((first >> shift) + floor_moment) * ((second >> shift) + floor_moment) >> uncorrelated_bits;
    if ((mixed >> shift) * (mixed >> shift) <= apart) return false;
    // Half of the angle whose cosine and sine are |across| / root and along / root.
    const i64 across = (second - first) >> shift, along = (2 * mixed) >> shift;
    const i64 root = integer_root(across * across + along * along);
    const i64 twice = (size_of(across) << turn_bits) / root;
    const i64 cosine = integer_root(((i64{1} << turn_bits) + twice) << (turn_bits - 1));
    const i64 sine = floor_divide(floor_divide(along << (turn_bits - 1), root) << turn_bits, cosine);
    turn(a, b, cosine, across >= 0 ? sine : -sine);
    return true;
}

}  // namespace

i64 integer_root(i64 square) {
    i64 root = static_cast<i64>(std::sqrt(static_cast<double>(square)));
    while (root * root > square) --root;
    while ((root + 1) * (root + 1) <= square) ++root;
    return root;
}

int LocalCoordinates::locate(std::span<const GridPoint> grid, std::span<const i32> vertices) {
    const i64 size = static_cast<i64>(vertices.size());
    // About their mean, with as many binary digits as sum_bits has room for.
    i64 largest = 0;
    for (int k = 0; k < 3; ++k) {
        axes[k].resize(size);
        i64 total = 0;
        for (i64 i = 0; i < size; ++i) {
            axes[k][i] = grid[vertices[i]][k] - grid[vertices[0]][k];
            total += axes[k][i];
        }
        for (i64 &value : axes[k]) {
            value = size * value - total;
            largest = most(largest, size_of(value));
        }
    }
    const int excess = bit_length(largest) - (sum_bits - bit_length(size)) / 2;
    for (Axis &axis : axes) {
        for (i64 &value : axis) value = excess > 0 ? value >> excess : value << -excess;
    }
    const i64 all_three = moment(axes[0], axes[0]) + moment(axes[1], axes[1]) + moment(axes[2], axes[2]);
    const int shift = most(bit_length(all_three) - moment_bits, 0);
    for (int sweep = 0; sweep < most_sweeps; ++sweep) {
        bool is_turned = false;
        for (int p = 0; p < 2; ++p) {
            for (int q = p + 1; q < 3; ++q) is_turned |= decorrelate(axes[p], axes[q], shift);
        }
        if (!is_turned) break;
    }
    for (const int k : {0, 1, 0}) {
        if (moment(axes[k], axes[k]) < moment(axes[k + 1], axes[k + 1])) std::swap(axes[k], axes[k + 1]);
    }
    int count = 0;
    while (count < 3 && moment(axes[count], axes[count]) >> shift >= i64{1} << (moment_bits - thinnest_bits)) ++count;
    return count;
}

}  // namespace pdeanim
