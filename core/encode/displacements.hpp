// What is left of positions when one shape is taken away: what functions of time and space are fitted to.
#pragma once

#include <span>

#include "base/arithmetic.hpp"

namespace pdeanim {

// Write, for each vertex, its displacements: x, y, z of one frame after another. points: (frames, vertices, 3); shape:
// (vertices, 3); rows: (vertices, 3 frames). What is larger than `farthest` is no motion to be fitted, and becomes 0.
// Returns the largest magnitude that is left.
template <class Real> double take_displacements(std::span<const float> points, std::span<const double> shape,
                                                double farthest, std::span<Real> rows, int threads);

}  // namespace pdeanim
