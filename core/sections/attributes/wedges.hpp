// Which elements around a point have the same value: the seams of attributes, and hard edges.
//
// Elements with the same value at one point form a wedge (Hoppe 1998, "Efficient implementation of progressive
// meshes"). Each element in turn is compared with the wedges at its corners, first with those across the two sides of
// the corner; an element that equals none begins a wedge. A border between wedges continues along an edge, bends with
// the surface, and often follows that of another attribute.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "entropy/range_coder.hpp"
#include "sections/attributes/attribute_mesh.hpp"
#include "sections/attributes/scales.hpp"

namespace pdeanim {

// Wedges are numbered in the order in which they begin.
struct Wedges {
    std::vector<i32> of_element;
    std::vector<i32> first;  // the first element of each wedge

    i64 count() const { return static_cast<i64>(first.size()); }
};

class WedgeModel {
public:
    static constexpr i64 most_corners =
        16;  // of an element, and at a point, that are examined, so that time stays linear

    WedgeModel();

    // Code the wedge of every element of a mesh.
    //
    // corners: of the mesh, over its vertices or points; has_runs: whether an element is finally compared with the one
    // before it; wanted: numbers that are equal where values are, for every element; unused when decoding.
    template <Mode mode> Wedges code(RangeCoder<mode> &coder, AttributeMesh &mesh, const CornerTable &corners,
                                     const AttributeElements &elements, bool has_runs, std::span<const i32> wanted);

private:
    // What an element is compared with: the wedge across the side before its corner, across the side after it, at any
    // other corner there; and the wedge of the previous element, since values come in runs.
    enum Kind { beside_before, beside_after, around, latest };
    enum Likeness { unsure, same, other };

    struct Comparison {
        Kind kind;
        Likeness ends, agreement;  // of the other ends of the side, and of the wedges across both sides
        int refused;               // number of wedges that the element did not equal
        int bend;                  // flatness of the edge between the two polygons
        Likeness seam;             // likeness of the wedges here in the previous attribute
    };

    static Likeness likeness(i32 one, i32 another) {
        return one < 0 || another < 0 ? unsure : one == another ? same : other;
    }

    static int bend_of(const GridPoint &one, const GridPoint &another);

    template <Mode mode> bool code_same(RangeCoder<mode> &coder, const Comparison &comparison, bool is_same);

    static constexpr int kinds = 4, likenesses = 3, bends = 8, histories = 256;

    std::vector<BitModel> by_ends_, by_bend_, by_history_;
    std::array<Weights<3>, kinds> weights_;
    int history_ = 0;  // which of the last 8 comparisons were equal, the latest in bit 0
};

// The wedges of an attribute as vertices of a mesh, and the prediction of their values from known wedges around them.
//
// Values are points of a map of the surface: texture coordinates, or colours. Across an edge with known ends, the map
// continues as on its other side (an affine map, from three known points), or without distortion, to one side of the
// edge or mirrored to the other (Isenburg and Snoeyink 2003, "Compressing texture coordinates with selective linear
// predictions", measure how often maps are of this kind). Where lengths do not help, parallelograms and the mean of the
// neighbours remain, and the other attribute's value here. The prediction with the smallest recent errors is used.
// Everything is integer arithmetic.
class WedgeField {
public:
    // Kinds of prediction; of equally good ones the first is used.
    enum Way { affine, turned, mirrored, parallelogram, neighbours, other_attribute, ways };

    // Numbers of one value, in a common unit or as lengths.
    using Row = std::array<i64, most_channels>;

    // Predictions found around a wedge.
    struct Findings {
        std::array<Row, ways> predicted{};
        std::array<i64, ways> counts{};  // number of predictions that each mean is made of
        Row expected{};                  // mean length of the neighbours' residuals
    };

    WedgeField(AttributeMesh &mesh, const AttributeElements &elements, const Wedges &wedges, Scales scales);

    i64 count() const { return count_; }
    const Scales &scales() const { return scales_; }
    int channels() const { return scales_.channels(); }

    // Wedges in coding order, and one more for corners without one.
    const std::vector<i32> &order() const { return order_; }

    // Forget all values.
    void restart();

    // Predict a wedge by every kind that applies.
    const Findings &look_around(i32 wedge);

    // Return the two kinds with the smallest recent errors; `ways` for none.
    std::pair<Way, Way> best_ways() const;

    // Score the kinds of prediction of the last wedge, whose values are set and known from now on.
    void learn(i32 wedge);

    // Value of a wedge in the common unit, and number of binary digits of its residual.
    i32 &linear(i32 wedge, int channel) { return linear_[static_cast<i64>(wedge) * channels() + channel]; }
    u8 &length(i32 wedge, int channel) { return lengths_[static_cast<i64>(wedge) * channels() + channel]; }

private:
    void continue_map(i32 a, i32 b, i32 c, i32 x, bool is_across);
    void add_parallelogram(i32 a, i32 b, i32 c);
    bool look_across(i32 x, i32 corner, bool is_before, bool has_turned);
    i32 known_at(i32 corner, i32 x) const;
    i64 value(i32 wedge, int channel) const { return linear_[static_cast<i64>(wedge) * channels() + channel]; }

    i64 count_;
    Scales scales_;
    CornerTable corners_;
    std::vector<i32> order_;
    std::vector<GridPoint> positions_;
    std::vector<i32> linear_, others_;  // values here and in another attribute
    std::vector<bool> has_other_, is_known_;
    std::vector<u8> lengths_;
    Findings findings_;
    std::array<i64, ways> scores_{};  // recent error of each kind of prediction over the best: digits [1/1024]
};

}  // namespace pdeanim
