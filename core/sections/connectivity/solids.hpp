// Cells of finite elements, and the sides that solids share.
//
// If an object has cells, its faces and lines are the visible parts of the cells: faces that are cells themselves, and
// sides that belong to a single solid. Vertices inside solids get their neighbours from the inner sides, which solids
// share.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "base/arithmetic.hpp"
#include "mesh/corner_table.hpp"
#include "sections/attributes/attribute_mesh.hpp"

namespace pdeanim {

// Shapes by their number in the file. Nodes of a cell are its corners, one node on each edge, then others, as in VTK.
enum class CellShape : u8 { polyline, line, polygon, triangle, quad, tetrahedron, pyramid, wedge, hexahedron };
constexpr int cell_shapes = 9;

// Fewest nodes of a cell of each shape.
constexpr std::array<i32, cell_shapes> smallest_cells = {1, 1, 3, 3, 4, 4, 5, 6, 8};

// Sides of all solids of an object, in the order of cells.
struct CellSides {
    std::vector<i32> cell, place;  // cell of each side, and the side's number in the cell's shape
    Numbered corners;              // numbers of the sides, equal for sides with equal corners
};

CellSides sides_of_solids(const ConnectivityView &object);

// Return the sides that several solids have, in the order of the first of these solids, as faces of an object without
// lines. A node on each edge is part of the border.
Connectivity inner_sides(const ConnectivityView &object);

// Return the objects with inner sides added after their own faces; positions are predicted on these (27.3 of the
// specification).
std::vector<Connectivity> with_inner_sides(std::span<const Connectivity> objects);

}  // namespace pdeanim
