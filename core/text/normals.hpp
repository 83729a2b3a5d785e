// Normals of moving meshes, for writers of other formats.
#pragma once

#include <span>
#include <vector>

#include "base/arithmetic.hpp"

namespace pdeanim {

// Computes unit normals for the frames of a mesh: the normals of faces are summed over corners, weighted by the angle
// at the corner.
//
// The arguments, which the caller keeps, are the sizes of faces, and for each corner, face after face, its vertex and
// the sum that it belongs to (0 to `sums` - 1).
class CornerNormals {
public:
    CornerNormals(std::span<const i32> face_sizes, std::span<const i32> vertices, std::span<const i32> rows, i64 sums);

    // Compute normals (sums, 3) at positions (vertices, 3). Faces without a direction are left out; an empty sum gives
    // (0, 0, 1).
    void find(const float *points, float *normals) const;

private:
    // Consecutive faces whose corners are processed together.
    struct Block {
        i64 first_face, end_face, first_corner, end_corner;
    };

    std::span<const i32> face_sizes_, vertices_, rows_;
    i64 sums_;
    std::vector<Block> blocks_;
    i64 largest_block_ = 0;
    std::vector<i32> next_, previous_;  // next and previous corner, as positions within a block
};

}  // namespace pdeanim
