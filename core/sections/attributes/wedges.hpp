// Find the elements around a point that have the same value: seams of attributes, and hard edges.
//
// Elements with the same value at one point form a wedge (Hoppe 1998, "Efficient implementation of progressive
// meshes"). Each element in turn is compared with the wedges at its corners, first with those across the two sides of
// the corner. An element that equals none of them begins a new wedge. A border between wedges continues along an edge,
// bends with the surface, and often follows the border of another attribute.
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
        16;  // largest number of corners of an element, and at a point, that are examined, which keeps the time linear

    WedgeModel();

    // Code the wedge of every element of a mesh.
    //
    // corners: corners of the mesh, with vertices or points; has_runs: whether an element is finally compared with the
    // previous element; wanted: for every element a number, equal for equal values; unused when decoding.
    template <Mode mode> Wedges code(RangeCoder<mode> &coder, AttributeMesh &mesh, const CornerTable &corners,
                                     const AttributeElements &elements, bool has_runs, std::span<const i32> wanted);

private:
    // Wedges that an element is compared with: the wedge across the side before its corner, the wedge across the side
    // after it, the wedges at other corners there, and the wedge of the previous element, because equal values often
    // follow each other.
    enum Kind { beside_before, beside_after, around, latest };
    enum Likeness { unsure, same, other };

    struct Comparison {
        Kind kind;
        Likeness ends, agreement;  // likeness at the other ends of the side; likeness of the wedges across both sides
        int refused;               // number of wedges that the element did not equal
        int bend;                  // class of the angle between the two polygons
        Likeness seam;             // whether the previous attribute had one wedge here
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
// continues as on the other side of the edge (an affine map, from three known points), or without distortion, turned to
// one side of the edge or mirrored to the other. (Isenburg and Snoeyink 2003, "Compressing texture coordinates with
// selective linear predictions", measure how often maps are of this kind.) Three further predictions use no lengths:
// parallelograms, the mean of the neighbours, and the value of another attribute at the same place. The prediction with
// the smallest recent errors is used. Everything is integer arithmetic.
class WedgeField {
public:
    // Kinds of prediction; of equally good ones the first is used.
    enum Way { affine, turned, mirrored, parallelogram, neighbours, other_attribute, ways };

    // One number per channel: a value in the common unit, or lengths.
    using Row = std::array<i64, most_channels>;

    // Predictions found around a wedge.
    struct Findings {
        std::array<Row, ways> predicted{};
        std::array<i64, ways> counts{};  // number of predictions in each mean
        Row expected{};                  // mean length of the neighbours' residuals
    };

    WedgeField(AttributeMesh &mesh, const AttributeElements &elements, const Wedges &wedges, Scales scales);

    i64 count() const { return count_; }
    const Scales &scales() const { return scales_; }
    int channels() const { return scales_.channels(); }

    // Return the wedges in coding order, with the additional wedge for corners without one.
    const std::vector<i32> &order() const { return order_; }

    // Forget all values.
    void restart();

    // Predict a wedge in every way that applies.
    const Findings &look_around(i32 wedge);

    // Return the two kinds of prediction with the smallest recent errors; `ways` stands for none.
    std::pair<Way, Way> best_ways() const;

    // Score the predictions of the last wedge. Its values must be set; from now on they are known.
    void learn(i32 wedge);

    // The value of a wedge in the common unit, and the number of digits of its residual.
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
    std::vector<i32> linear_, others_;  // values of this attribute and of another one
    std::vector<bool> has_other_, is_known_;
    std::vector<u8> lengths_;
    Findings findings_;
    std::array<i64, ways> scores_{};  // recent error of each kind of prediction beyond the best: digits [1/1024]
};

}  // namespace pdeanim
