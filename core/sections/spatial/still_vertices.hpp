// Which vertices stand still in all frames of a clip: they lie at the reference frame, and no function moves them.
#pragma once

#include <span>
#include <vector>

#include "base/arithmetic.hpp"

namespace pdeanim {

// Code whether each vertex stands still. first_vertices: number of the first vertex of each object, then the number of
// all vertices.
std::vector<u8> encode_still(std::span<const u8> still, std::span<const i64> first_vertices);

// Decode the result of `encode_still`: one number per vertex, 1 if it stands still. CorruptError if the bytes do not end
// with the last object.
std::vector<u8> decode_still(std::span<const u8> data, std::span<const i64> first_vertices);

}  // namespace pdeanim
