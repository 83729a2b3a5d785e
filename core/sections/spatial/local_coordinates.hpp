// Local coordinates of an element: about its mean, along its principal axes, the widest first.
//
// They are found by one-sided Jacobi rotations in integers, so that everyone finds the same. Coordinates that are hardly
// correlated are left as they are: axes of equal width have no direction of their own, and where rounding chose one, every
// element would have another.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "mesh/z_order.hpp"

namespace pdeanim {

// The largest integer whose square is at most `square`, 0 to 2^62.
i64 integer_root(i64 square);

struct LocalCoordinates {
    // Find those of these vertices; how many of the coordinates, from the first, are more than rounding.
    int locate(std::span<const GridPoint> grid, std::span<const i32> vertices);

    std::array<std::vector<i64>, 3> axes;
};

}  // namespace pdeanim
