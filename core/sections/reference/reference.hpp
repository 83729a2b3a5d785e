// Section REST without its header: the reference frame's grid coordinates, predicted across the faces.
//
// Vertices that lie on the same point may be welded for the purpose: seams and soups of polygons then have a surface to
// predict across. Residuals may be matched with earlier ones: regular shapes repeat themselves. The encoder takes what is
// smallest.
//
// This folder codes section REST (7 of the specification). Begin here: reference.cpp has the kinds and the welds, predictor
// what is expected of a vertex and the weights of that, point_model.hpp the context models of residuals.
#pragma once

#include <span>
#include <vector>

#include "mesh/corner_table.hpp"
#include "sections/reference/predictor.hpp"

namespace pdeanim {

// What kinds of prediction are made of.
constexpr u8 welds_points = 1, matches_residuals = 2;

struct CodedReference {
    u8 kind = 0;
    std::vector<u8> data;
};

CodedReference encode_reference(const Polygons &mesh, std::span<const Vector> grid);

// Undo `encode_reference`; CorruptError if the bytes are damaged.
std::vector<Vector> decode_reference(Polygons mesh, u8 kind, std::span<const u8> data);

}  // namespace pdeanim
