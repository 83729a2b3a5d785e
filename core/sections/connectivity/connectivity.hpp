// Sections CONN and ORDR: faces and lines of every object, and the original order of surfaces.
//
// The faces of an object are coded in one of two ways, whichever costs less. As a surface, they are grown across the
// sides of known faces, and the order of faces and vertices is coded separately. As polygons, they keep their order,
// which is better if a program numbered them row by row. Lines are coded as polygons. Statistics of one object help
// with the next.
//
// This folder codes sections CONN and ORDR (5 and 6 of the specification). Begin here: connectivity.cpp chooses for
// each object and codes polygons, surface grows a surface, order restores the numbering of the source.
#pragma once

#include <span>
#include <utility>
#include <vector>

#include "base/arithmetic.hpp"
#include "mesh/corner_table.hpp"

namespace pdeanim {

// Return the coded streams of sections CONN and ORDR; the latter is empty if there is no order to restore. Without
// `keep_order`, surfaces whose vertices and faces already stand in the order of `coded_orders` leave ORDR out.
std::pair<std::vector<u8>, std::vector<u8>> encode_connectivity(std::span<const ConnectivityView> parts,
                                                                bool keep_order);

// The order in which an object's vertices, faces and corners are coded, given by their numbers in the source.
struct CodedOrder {
    std::vector<i32> vertices, faces, corners;
};

// Return the order of each object's surface; empty for an object coded as polygons, which keep their order.
std::vector<CodedOrder> coded_orders(std::span<const ConnectivityView> parts);

// Undo `encode_connectivity`. vertices: number of each object; most_corners: face corners and line points of all
// objects that memory allows, LimitError for more. CorruptError if a section is damaged.
std::vector<Connectivity> decode_connectivity(std::span<const u8> conn, std::span<const u8> ordr,
                                              std::span<const i64> vertices, i64 most_corners);

}  // namespace pdeanim
