// Curves: every vertex in exactly one curve, as a function of connectivity and reference frame.
//
// The paper extracts its curves by hand. Here, in this order and for each object separately:
//
// 1. polylines of three points or more, unchanged; 2. edge loops: edges that go straight on through vertices where four
// quads meet, the longest loops first and with them their neighbours, so that curves lie side by side and are long.
// Pairs of triangles that form the quads of a grid count as quads (triangle_pairs.cpp); 3. a path cover of the
// remaining vertices, of irregular and triangle meshes, chains of two-point lines, polygons: paths that go as straight
// as they can and end before they touch themselves (graph.cpp); 4. isolated vertices: those of an object form one
// curve, along a space-filling curve through the reference frame.
//
// Positions only decide between grids that connectivity cannot distinguish, and the order of isolated vertices. Encoder
// and decoder run the same code, so curves cost no bytes. Everything is integer arithmetic.
#pragma once

#include <span>
#include <vector>

#include "mesh/corner_table.hpp"
#include "mesh/z_order.hpp"

namespace pdeanim {

struct Curves {
    std::vector<i32> order;         // the vertices of all curves: a permutation
    std::vector<i64> starts = {0};  // curve c is order[starts[c]] to order[starts[c + 1] - 1]
};

// Extract the curves of all objects, one object after the other. reference: the reference frame's grid coordinates, of
// the vertices of all objects.
Curves extract_curves(std::span<const ConnectivityView> objects, std::span<const GridPoint> reference);

// The grid in a triangulated grid: pairs of triangles that form its quads.
//
// In a grid of quads, four quads meet at an inner vertex and two at a border vertex. This gives the number of pairs
// that a vertex with triangles lacks. If the vertex has as many unpaired triangles as it lacks pairs, no two of them
// pair with each other; if it has twice as many, they all do. Most pairs follow from a few, whatever the direction of
// the diagonals. If nothing follows, as in a grid whose diagonals all have one direction, a neighbouring pair is
// copied. Positions then decide between directions that connectivity cannot distinguish: the two diagonals of a
// rectangle are equally long.
//
// `twins` returns, for each corner of a mesh of faces, the corner of another face on the same edge; -1 unless exactly
// two faces have the edge.
std::vector<i32> twins(const CornerTable &corners);

// Return, for each face of a pair, the corner whose edge is the pair's diagonal; -1 for other faces. cells: of each
// vertex, from `cells_in_box`.
std::vector<i32> pair_triangles(const CornerTable &corners, std::span<const i32> twin,
                                std::span<const GridPoint> cells);

}  // namespace pdeanim
