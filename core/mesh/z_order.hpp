// Points on a grid within their bounding box, and their order along a space-filling curve through it.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "base/arithmetic.hpp"

namespace pdeanim {

using GridPoint = std::array<i64, 3>;

// Bits per axis of a cell: three of them fit in 64 bits, and so do sums of some squared lengths.
constexpr int cell_bits = 20;

// Points less the least of them on each axis, without the low bits that exceed `cell_bits`.
std::vector<GridPoint> cells_in_box(std::span<const GridPoint> points);

// The order of points along the Z-order curve through their bounding box; of points in one cell, the order they have.
std::vector<i32> z_order(std::span<const GridPoint> points);

}  // namespace pdeanim
