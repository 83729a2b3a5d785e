// Polygons in their original order, as differences of vertex numbers.
//
// The best there is for meshes that a program numbered row by row, and for lines; it takes any polygons at all. A polygon
// is a sequence of numbers: its size, unless all have the same; the difference of its first corner to the first corner of
// the polygon before; of every other corner to the corner before it. A number is, in this order, what the match model
// proposes, the vertex after the highest so far, or spelled out.
#pragma once

#include <span>

#include "entropy/match_model.hpp"
#include "entropy/numbers.hpp"
#include "sections/connectivity/order.hpp"

namespace pdeanim {

// What the coder of polygons has learnt; it goes on learning from object to object.
class PolygonModel {
public:
    PolygonModel() { new_.fill(std::vector<BitModel>(1 << new_history_bits)); }

    // Code the polygons of one object, read when encoding and written when decoding; CorruptError where the bits are not
    // those of sound polygons. common_size: of every polygon, or 0 where they differ; smallest: least size of a polygon;
    // corners are below `vertices`.
    template <Mode mode> void code(RangeCoder<mode> &coder, i32 common_size, i32 smallest, i64 vertices,
                                   std::span<i32> sizes, std::span<i32> corners);

private:
    static constexpr int last_corner_phase = 3;  // corners from this on are alike; 0 to 2 have phases of their own
    static constexpr int size_phase = 4, new_history_bits = 5;

    std::array<std::vector<BitModel>, MatchModel::phases> new_;
    std::array<SignedModel, MatchModel::phases> differences_;
    NumberModel sizes_;
    MatchModel match_;
};

}  // namespace pdeanim
