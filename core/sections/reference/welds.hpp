// Which vertices lie on the same point: seams and soups of polygons become surfaces again.
//
// Vertices are met polygon by polygon, then the remaining ones. Of each it is coded whether it lies on a point that is
// there already, and on which: first come those that would close a gap in the surface, then those met last.
#pragma once

#include <vector>

#include "entropy/range_coder.hpp"
#include "mesh/corner_table.hpp"

namespace pdeanim {

// Code the point of each vertex, numbered as they are met: read when encoding, written when decoding. How many points
// there are; CorruptError where the bits say a point that is not there.
template <Mode mode> i64 code_welds(RangeCoder<mode> &coder, const CornerTable &corners, std::vector<i32> &point_of);

}  // namespace pdeanim
