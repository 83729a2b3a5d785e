// Normals of moving meshes, for writers of other formats.
#pragma once

#include <span>
#include <vector>

#include "base/arithmetic.hpp"

namespace pdeanim {

// Unit normals of frames of a mesh: sums over corners of the normals of their faces, weighted by the angles there.
//
// The caller keeps what a mesh is made of: sizes of faces, and face after face the vertex of each corner and the sum, from 0
// to `sums` - 1, that it belongs to.
class CornerNormals {
public:
    CornerNormals(std::span<const i32> face_sizes, std::span<const i32> vertices, std::span<const i32> rows, i64 sums);

    // Normals (sums, 3) at positions (vertices, 3). Faces without a direction count for nothing, and a sum of nothing is
    // (0, 0, 1).
    void find(const float *points, float *normals) const;

private:
    // Faces whose corners are worked on together.
    struct Block {
        i64 first_face, end_face, first_corner, end_corner;
    };

    std::span<const i32> face_sizes_, vertices_, rows_;
    i64 sums_;
    std::vector<Block> blocks_;
    i64 largest_block_ = 0;
    std::vector<i32> next_, previous_;  // places within a block
};

}  // namespace pdeanim
