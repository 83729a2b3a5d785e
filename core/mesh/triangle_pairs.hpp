// The grid in a triangulated grid: pairs of triangles that make its quads.
//
// Inside a grid of quads four quads meet at a vertex, at its border two. In a vertex's triangles this says how many
// pairs there are to be: where as many triangles are left as pairs are lacking, each belongs to another pair; where
// twice as many are left, they pair with each other. From a few pairs most others follow, whatever way the diagonals
// go. Where nothing follows, as in a grid whose diagonals all go one way, a neighbouring pair is copied, and positions
// decide between directions that connectivity cannot tell apart: the two diagonals of a rectangle are equally long.
#pragma once

#include <span>
#include <vector>

#include "mesh/corner_table.hpp"
#include "mesh/z_order.hpp"

namespace pdeanim {

// Of each corner of a mesh of faces, the corner of another face on the same edge; -1 unless exactly two faces have it.
std::vector<i32> twins(const CornerTable &corners);

// Of each face that is one of a pair, the corner whose edge is the pair's diagonal; -1 of other faces. cells: of each
// vertex, as `cells_in_box` gives them.
std::vector<i32> pair_triangles(const CornerTable &corners, std::span<const i32> twin,
                                std::span<const GridPoint> cells);

}  // namespace pdeanim
