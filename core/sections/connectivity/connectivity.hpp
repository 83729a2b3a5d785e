// Sections CONN and ORDR: faces and lines of every object, and the original order of surfaces.
//
// The faces of an object are coded in one of two ways, whichever costs less. As a surface, they are grown across the
// sides of known faces, and the order of faces and vertices is coded separately. As polygons, they keep their order,
// which is better if a program numbered them row by row. Lines are coded as polygons. The statistics of one object are
// kept for the next.
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

// Return the streams of sections CONN and ORDR; ORDR is empty if there is no order to restore. If `keep_order` is
// false, no order is coded for surfaces whose vertices and faces already have the order of `coded_orders`.
std::pair<std::vector<u8>, std::vector<u8>> encode_connectivity(std::span<const ConnectivityView> parts,
                                                                bool keep_order);

// The order in which an object's vertices, faces and corners are coded, as their numbers in the source.
struct CodedOrder {
    std::vector<i32> vertices, faces, corners;
};

// Return the coded order of each object's surface; empty for an object coded as polygons, which keep their order.
std::vector<CodedOrder> coded_orders(std::span<const ConnectivityView> parts);

// Undo `encode_connectivity`. vertices: number of vertices of each object; most_corners: largest number of face corners
// and line points of all objects together, LimitError if there are more. CorruptError if a section is damaged.
std::vector<Connectivity> decode_connectivity(std::span<const u8> conn, std::span<const u8> ordr,
                                              std::span<const i64> vertices, i64 most_corners);

}  // namespace pdeanim
