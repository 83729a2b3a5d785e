// Section REST without its header: the reference frame's grid coordinates, predicted across the faces.
//
// Coincident vertices may be welded for prediction, so that there is a surface across seams and between loose polygons.
// Residuals may be predicted by earlier ones, because regular shapes repeat themselves. The encoder takes the
// combination with the fewest bytes.
//
// This folder codes section REST (7 of the specification). Begin here: reference.cpp has the kinds and the welds,
// predictor.cpp the prediction of a vertex and its weights, point_model.hpp the context models of residuals.
#pragma once

#include <array>
#include <optional>
#include <span>
#include <vector>

#include "mesh/corner_table.hpp"

namespace pdeanim {

// Prediction of a vertex of the reference frame from the known vertices around it, in integers.
//
// Four quantities are used, each the mean over the corners at the vertex:
//
// * parallelograms: across the edge to the next triangle, or inside a quad (Touma and Gotsman 1998; several at once,
//   Cohen-Or, Cohen and Irony 2002);
// * crease: how far such a parallelogram bends at its two other edges, which estimates its error;
// * straight on: from the opposite vertex across a neighbour, along a line, over a quad, or through a vertex of six
//   triangles;
// * neighbours: the neighbours themselves, and the errors of their predictions.
//
// The base is the first of parallelograms, straight on and neighbours that is available. The others are predictor
// terms. The stream has two sets of weights for them, one for all directions and another for the direction of the
// surface's normal alone, in which the surface curves.

using Vector = std::array<i64, 3>;

constexpr int most_corners = 16;  // corners per vertex that are used; few have more, and sums stay far from overflow
// Fractional digits of predictions. Residuals are smaller if a prediction's position between two grid points is known.
constexpr int fraction_bits = 4;
constexpr int smooth_bits = 6;  // fraction digits of smoothed grid coordinates
constexpr int grid_bits = 40;   // grid coordinates are 0 to 2^40 - 1

// Predictor terms, with their numbers in the stream.
enum Term { crease, straight, miss, neighbours, term_count };

// Number of kinds of base: 0 nothing known around, 1 neighbours, 2 straight on; from 3 on one, two or more
// parallelograms, each without and with straight on.
constexpr int kind_count = 9, first_of_parallelograms = 3;

// Weights of the terms [1/32], -127 to 127: in all directions, and for the component along the normal.
using TermWeights = std::array<std::array<std::array<i32, term_count>, 2>, kind_count>;

// The known data around a vertex.
struct Around {
    std::array<Vector, term_count> terms{};  // [1/16]
    Vector base{}, normal{}, errors{};       // [1/16]; of any length; mean absolute residuals of the neighbours [1/16]
    i64 spread = 0;                          // sum of the differences of the other parallelograms from the first
    int parallelograms = 0, kind = 0;

    // Return the base plus the weighted terms [1/16].
    Vector predicted(const std::array<std::array<i32, term_count>, 2> &weights) const;
};

// The vertices of a mesh, which become known one after another in prediction order.
class Predictor {
public:
    Predictor(const CornerTable &corners, std::vector<Vector> grid)
        : grid(std::move(grid)), corners_(corners), points_(this->grid.size()), is_known_(this->grid.size()) {}

    // Collect the known data around the next vertex.
    Around look_around(i32 vertex) const;

    // Mark a vertex as known; its grid coordinates must be set. residual: absolute values of its residuals.
    void learn(i32 vertex, const Around &around, const Vector &residual);

    std::vector<Vector> grid;

private:
    struct Point {
        Vector miss{}, error{};  // grid coordinates minus base [1/16]; absolute residuals
    };

    void add_normal(i32 a, i32 b, i32 d, Vector &normal) const;

    const CornerTable &corners_;
    std::vector<Point> points_;
    std::vector<u8> is_known_;        // bytes, not bits of a struct: most vertices are asked only for this
    i32 last_ = -1, last_seed_ = -1;  // previous vertex, and previous vertex without known neighbours
    Vector seed_errors_{};            // running mean of absolute residuals of vertices without known neighbours [1/16]
};

// Choose for each kind of base the weights with which residuals cost the fewest bits (encoder only, floating point).
// `points` must have all grid coordinates and no known vertex; it is changed.
TermWeights choose_term_weights(const std::vector<i32> &order, Predictor &points);

// Weights of smoothing [1/16], -127 to 127, by the class of a vertex: of the vertex's Laplacian, and of the Laplacian
// of the Laplacian.
constexpr int smoothing_classes = 7;
using SmoothingWeights = std::array<std::array<i32, 2>, smoothing_classes>;

// Return grid coordinates [1/64 steps] that are moved towards a smooth surface, each by at most half a step.
std::vector<Vector> smoothed(const CornerTable &corners, std::span<const Vector> grid, const SmoothingWeights &weights);

// The weights that bring coordinates closest to the wanted ones, and the remaining error divided by the error without
// smoothing.
struct FittedSmoothing {
    SmoothingWeights weights;
    double error_ratio;
};

// Fit weights to wanted coordinates [steps]; nothing if smoothing helps too little (encoder only, floating point).
std::optional<FittedSmoothing> fit_smoothing(const CornerTable &corners, std::span<const Vector> grid,
                                             std::span<const std::array<double, 3>> wanted);

// Flags of a reference frame.
constexpr u8 welds_points = 1, matches_residuals = 2, smooths_points = 4, ties_vertices = 8;
constexpr u8 reference_kinds = 16;

// For each vertex, the first vertex that it coincides with in every frame, which is usually the vertex itself. Empty if
// no vertices are tied.
using Ties = std::span<const i32>;

struct CodedReference {
    u8 kind = 0;
    std::vector<u8> data;
};

// The smoothing of a reference frame.
struct Smoothing {
    SmoothingWeights weights{};
    std::vector<i32> point_of;  // welded point of each vertex: smoothing works across welds; empty without welds
    std::vector<Vector> grid;   // coordinates of the smoothed frame [1/64 steps]
    double error_ratio = 1.0;   // rms error of the smoothed frame divided by that of the frame before smoothing
};

// Choose the smoothing of a frame; nothing if smoothing hardly brings it closer to the wanted positions. wanted:
// coordinates of each vertex [steps]. Vertices with equal positions are welded.
std::optional<Smoothing> smooth_reference(const Polygons &mesh, std::span<const Vector> grid,
                                          std::span<const std::array<double, 3>> wanted, Ties ties);

// smoothing: null to leave the frame unchanged. Tied vertices must have equal coordinates.
CodedReference encode_reference(const Polygons &mesh, std::span<const Vector> grid, const Smoothing *smoothing,
                                Ties ties);

struct DecodedReference {
    std::vector<Vector> grid;  // coordinates of each vertex; in 1/64 steps if the frame is smoothed
    std::vector<i32> ties;     // see Ties
};

// Undo `encode_reference`; CorruptError if the bytes are damaged.
DecodedReference decode_reference(Polygons mesh, u8 kind, std::span<const u8> data);

}  // namespace pdeanim
