// Curves: every vertex in exactly one curve, as a function of connectivity and reference frame.
//
// The paper extracts its curves by hand. Here, in this order and for each object on its own:
//
// 1. polylines of three points or more, as they are;
// 2. edge loops: edges that go straight on through vertices where four quads meet, the longest loops first and with
//    them the loops beside them, so that curves lie side by side and long. Pairs of triangles that make the quads of a
//    grid count as quads (triangle_pairs.hpp);
// 3. a path cover of what remains, of irregular and triangle meshes, chains of two-point lines, polygons: paths that go
//    as straight as they can and end where they would come back beside themselves (path_cover.hpp);
// 4. isolated vertices: all those of an object are one curve, along a space-filling curve through the reference frame.
//
// Positions only decide between grids that connectivity cannot tell apart, and the order of isolated vertices. Encoder
// and decoder run the same code, so curves cost no bytes. All of it is integer arithmetic.
#pragma once

#include <span>
#include <vector>

#include "mesh/connectivity.hpp"
#include "mesh/z_order.hpp"

namespace pdeanim {

struct Curves {
    std::vector<i32> order;         // the vertices of all curves: a permutation
    std::vector<i64> starts = {0};  // curve c is order[starts[c]] to order[starts[c + 1] - 1]
};

// Curves of all objects, one object after the other. reference: the reference frame's grid coordinates, of the vertices
// of all objects.
Curves extract_curves(std::span<const ConnectivityView> objects, std::span<const GridPoint> reference);

}  // namespace pdeanim
