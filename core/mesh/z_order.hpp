// Points on a grid within their bounding box, and their order along a space-filling curve through it.
#pragma once

#include <algorithm>
#include <array>
#include <span>
#include <utility>
#include <vector>

#include "base/arithmetic.hpp"

namespace pdeanim {

using GridPoint = std::array<i64, 3>;

// Bits per axis of a cell: three axes fit in 64 bits, and so does a sum of some squared lengths.
constexpr int cell_bits = 20;

// Return points relative to the smallest coordinate on each axis, without the low bits that exceed `cell_bits`.
inline std::vector<GridPoint> cells_in_box(std::span<const GridPoint> points) {
    std::vector<GridPoint> cells(points.begin(), points.end());
    if (cells.empty()) return cells;
    GridPoint low = cells[0];
    for (const GridPoint &point : points) {
        for (int axis = 0; axis < 3; ++axis) low[axis] = least(low[axis], point[axis]);
    }
    i64 extent = 0;
    for (GridPoint &cell : cells) {
        for (int axis = 0; axis < 3; ++axis) {
            cell[axis] -= low[axis];
            extent = most(extent, cell[axis]);
        }
    }
    const int shift = most(bit_length(extent) - cell_bits, 0);
    for (GridPoint &cell : cells) {
        for (i64 &coordinate : cell) coordinate >>= shift;
    }
    return cells;
}

// Return the order of points along the Z-order curve through their bounding box; points in one cell keep their order.
inline std::vector<i32> z_order(std::span<const GridPoint> points) {
    std::vector<std::pair<i64, i32>> places;
    places.reserve(points.size());
    for (const GridPoint &cell : cells_in_box(points)) {
        i64 code = 0;
        for (int bit = 0; bit < cell_bits; ++bit) {
            for (int axis = 0; axis < 3; ++axis) code |= ((cell[axis] >> bit) & 1) << (3 * bit + axis);
        }
        places.emplace_back(code, static_cast<i32>(places.size()));
    }
    std::sort(places.begin(), places.end());
    std::vector<i32> order;
    order.reserve(places.size());
    for (const auto &place : places) order.push_back(place.second);
    return order;
}

}  // namespace pdeanim
