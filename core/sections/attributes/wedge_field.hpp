// The wedges of an attribute as vertices of a mesh, and the prediction of their values from the known wedges around.
//
// Values are points of a map of the surface: texture coordinates, or colours. Across an edge whose ends are known, the map
// goes on as it did on its other side (an affine map, from three known points), or without distortion, to one side of the
// edge or mirrored to the other (Isenburg and Snoeyink 2003, "Compressing texture coordinates with selective linear
// predictions", measure how often maps are of this kind). Where lengths say nothing, parallelograms and the mean of the
// neighbours are left; and what another attribute has here. Of these ways that is taken which has missed least lately. All
// of it is integer arithmetic.
#pragma once

#include <array>
#include <vector>

#include "sections/attributes/attribute_mesh.hpp"
#include "sections/attributes/scales.hpp"
#include "sections/attributes/wedges.hpp"

namespace pdeanim {

class WedgeField {
public:
    // Ways to predict; of equal ones the first is taken.
    enum Way { affine, turned, mirrored, parallelogram, neighbours, other_attribute, ways };

    // Numbers of one value, in a common unit or as lengths.
    using Row = std::array<i64, most_channels>;

    // What is found around a wedge.
    struct Findings {
        std::array<Row, ways> predicted{};
        std::array<i64, ways> counts{};  // how many predictions each is the mean of
        Row expected{};                  // mean length of the neighbours' residuals
    };

    WedgeField(AttributeMesh &mesh, const AttributeElements &elements, const Wedges &wedges, Scales scales);

    i64 count() const { return count_; }
    const Scales &scales() const { return scales_; }
    int channels() const { return scales_.channels(); }

    // Wedges in the order of their coding, and one more for corners that are of none.
    const std::vector<i32> &order() const { return order_; }

    // Forget all values.
    void restart();

    // Predict a wedge in all ways that there are.
    const Findings &look_around(i32 wedge);

    // The best and the second best way, as they did lately; `ways` where there is none.
    std::pair<Way, Way> best_ways() const;

    // Compare the ways to predict the wedge that was looked around last; its values are set, and known from now on.
    void learn(i32 wedge);

    // Value of a wedge in the common unit, and binary digits of its residual.
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
    std::array<i64, ways> scores_{};  // how much farther off each way was lately than the best: digits [1/1024]
};

}  // namespace pdeanim
