// Which elements around a point have the same value: the seams of attributes, and hard edges.
//
// Elements that have the same value at one point form a wedge (Hoppe 1998, "Efficient implementation of progressive
// meshes"). Each element in turn is compared with the wedges at its corners, first with those across the two sides of the
// corner: an element that equals none begins a wedge. A border between wedges that has begun goes on along an edge, bends
// with the surface, and often follows that of another attribute.
#pragma once

#include <span>
#include <vector>

#include "entropy/range_coder.hpp"
#include "sections/attributes/attribute_mesh.hpp"

namespace pdeanim {

// Wedges are numbered as they begin.
struct Wedges {
    std::vector<i32> of_element;
    std::vector<i32> first;  // the element that each one begins with

    i64 count() const { return static_cast<i64>(first.size()); }
};

class WedgeModel {
public:
    static constexpr i64 most_corners = 16;  // of an element, and at a point, that are looked at: time stays linear

    WedgeModel();

    // Code the wedge of every element of a mesh.
    //
    // corners: of the mesh, over its vertices or points; has_runs: whether an element is compared with the one before it in
    // the end; wanted: numbers that are equal where values are, of every element; not needed for decoding.
    template <Mode mode> Wedges code(RangeCoder<mode> &coder, AttributeMesh &mesh, const CornerTable &corners,
                                     const AttributeElements &elements, bool has_runs, std::span<const i32> wanted);

private:
    // What an element is compared with: the wedge across the side before its corner, across the side after it, at any other
    // corner there; and the wedge of the element before, for values come in runs.
    enum Kind { beside_before, beside_after, around, latest };
    enum Likeness { unsure, same, other };

    struct Comparison {
        Kind kind;
        Likeness ends, agreement;  // of the other ends of the side, and of the wedges across both sides
        int refused;               // wedges that the element was not equal to
        int bend;                  // how flat the two polygons lie to each other
        Likeness seam;             // of the wedges here in the attribute before
    };

    static Likeness likeness(i32 one, i32 another) {
        return one < 0 || another < 0 ? unsure : one == another ? same : other;
    }

    static int bend_of(const GridPoint &one, const GridPoint &another);

    template <Mode mode> bool code_same(RangeCoder<mode> &coder, const Comparison &comparison, bool is_same);

    static constexpr int kinds = 4, likenesses = 3, bends = 8, histories = 256;

    std::vector<BitModel> by_ends_, by_bend_, by_history_;
    std::array<Weights<3>, kinds> weights_;
    int history_ = 0;  // of the last 8 comparisons, which were equal; the latest in bit 0
};

}  // namespace pdeanim
