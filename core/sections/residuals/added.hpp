// Residuals and raw vertices, added to what the model alone decodes to.
#pragma once

#include <span>

#include "sections/residuals/residuals.hpp"

namespace pdeanim {

// What adding residuals depends on besides them.
struct ResidualScale {
    std::span<const i32> order;  // the vertex at each place; all below the number of vertices
    double step;                 // size of a step [scene units]
};

// Add the residuals of one frame, `weight` times each, to positions of all vertices: in float64, rounded to float32
// once. base: what the model alone decodes to at that frame; empty at the frame itself, where raw vertices are as they
// are.
void add_residuals(const Residuals &residuals, i64 frame, const ResidualScale &scale, double weight,
                   std::span<const Position> base, std::span<Position> positions);

// What the residuals of one frame add to the positions of all vertices; `base` is needed where there are raw vertices.
void residual_displacements(const Residuals &residuals, i64 frame, const ResidualScale &scale,
                            std::span<const Position> base, std::span<std::array<double, 3>> displacements);

}  // namespace pdeanim
