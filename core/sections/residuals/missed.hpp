// Which vertices may miss the bound, and the residuals that bring them within.
#pragma once

#include <span>

#include "sections/residuals/residuals.hpp"

namespace pdeanim {

// Residuals of the vertices that some decoder might give beyond the bound; raw vertices where a rounded residual would
// not keep it.
//
// points, base: (frames, vertices), the input, and what the model alone decodes to before it is rounded to float32.
// order: the vertex at each place, each once. margins: of each frame, how far from `base` another decoder's coordinates
// may be before it rounds them. bound: largest Euclidean distance. step: see pdecodec/codec/sections/residuals.py.
Residuals quantise_residuals(std::span<const Position> points, std::span<const std::array<double, 3>> base,
                             std::span<const i32> order, std::span<const double> margins, double bound, double step);

// Residuals of consecutive runs of frames as those of all these frames.
Residuals join_residuals(std::span<const Residuals *const> parts);

}  // namespace pdeanim
