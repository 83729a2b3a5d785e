// Sections CONN and ORDR: faces and lines of every object, and the order that surfaces had.
//
// The faces of an object are coded in one of two ways, whichever costs less: as a surface, grown across its sides, with
// the order of its faces and vertices apart; or as polygons in their order, which is better where a program numbered them
// row by row. Lines are polygons. What the coder learns from one object helps it with the next.
//
// This folder codes sections CONN and ORDR (5 and 6 of the specification). Begin here: connectivity.cpp chooses for each
// object and codes polygons, surface grows a surface, order restores the numbering that the source had.
#pragma once

#include <span>
#include <utility>
#include <vector>

#include "base/arithmetic.hpp"
#include "mesh/corner_table.hpp"

namespace pdeanim {

// The coded streams of sections CONN and ORDR; the latter is empty where there is no order to restore. Without `keep_order`
// surfaces whose vertices and faces stand in the order of their coding (`coded_order`) leave ORDR out.
std::pair<std::vector<u8>, std::vector<u8>> encode_connectivity(std::span<const ConnectivityView> parts,
                                                                bool keep_order);

// The order in which an object's vertices, faces and corners are coded: of each, its number in the source.
struct CodedOrder {
    std::vector<i32> vertices, faces, corners;
};

// For each object, the order of its surface; empty where it is coded as polygons, which keep theirs.
std::vector<CodedOrder> coded_orders(std::span<const ConnectivityView> parts);

// Undo `encode_connectivity`. vertices: of each object; most_corners: face corners and line points of all objects that
// there is room for, LimitError for more. CorruptError where a section is damaged.
std::vector<Connectivity> decode_connectivity(std::span<const u8> conn, std::span<const u8> ordr,
                                              std::span<const i64> vertices, i64 most_corners);

}  // namespace pdeanim
