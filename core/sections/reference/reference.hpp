// Section REST without its header: the reference frame's grid coordinates, predicted across the faces.
//
// Vertices that lie on the same point may be welded for this purpose: seams and soups of polygons then have a surface
// to predict across. Residuals may be matched with earlier ones, since regular shapes repeat themselves. The encoder
// takes the combination with the fewest bytes.
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
// * crease: how far such a parallelogram bends over its own two other edges, which estimates its error;
// * straight on: from the vertex opposite over a neighbour, along a line, over a quad, or through a triangle vertex of six;
// * neighbours: the neighbours themselves, and the errors of their predictions.
//
// The base is the first available of parallelograms, straight on and neighbours. The others are predictor terms: the
// stream has two sets of weights for them, one for all directions and another for the surface's normal alone, where
// curvature acts.

using Vector = std::array<i64, 3>;

constexpr int most_corners = 16;  // corners per vertex that are used: few have more, and sums stay far from overflow
// Fraction digits of predictions: small residuals depend on where between two grid points these lie.
constexpr int fraction_bits = 4;
constexpr int smooth_bits = 6;  // fraction digits of smoothed grid coordinates
constexpr int grid_bits = 40;   // grid coordinates are 0 to 2^40 - 1

// The terms by their number in the stream.
enum Term { crease, straight, miss, neighbours, term_count };

// Kinds of base: 0 nothing known around, 1 neighbours, 2 straight on; from 3 on one, two or more parallelograms, each
// without and with straight on.
constexpr int kind_count = 9, first_of_parallelograms = 3;

// Weights of the terms in 1/32, -127 to 127: in all directions, and for their component along the normal.
using TermWeights = std::array<std::array<std::array<i32, term_count>, 2>, kind_count>;

// Known data around a vertex.
struct Around {
    std::array<Vector, term_count> terms{};  // [1/16]
    Vector base{}, normal{}, errors{};       // [1/16]; of any length; mean size of the neighbours' residuals [1/16]
    i64 spread = 0;                          // summed differences of the other parallelograms from the first
    int parallelograms = 0, kind = 0;

    // Return the base plus the weighted terms [1/16].
    Vector predicted(const std::array<std::array<i32, term_count>, 2> &weights) const;
};

// The vertices of a mesh as they become known in prediction order.
class Predictor {
public:
    Predictor(const CornerTable &corners, std::vector<Vector> grid)
        : grid(std::move(grid)), corners_(corners), points_(this->grid.size()), is_known_(this->grid.size()) {}

    // Collect the known data around the next vertex.
    Around look_around(i32 vertex) const;

    // Mark a vertex as known: its grid coordinates are set; `residual` holds the absolute values of its residuals.
    void learn(i32 vertex, const Around &around, const Vector &residual);

    std::vector<Vector> grid;

private:
    struct Point {
        Vector miss{}, error{};  // grid coordinates minus base [1/16]; absolute residuals
    };

    void add_normal(i32 a, i32 b, i32 d, Vector &normal) const;

    const CornerTable &corners_;
    std::vector<Point> points_;
    std::vector<u8> is_known_;        // separate bytes, as most vertices are asked only for this
    i32 last_ = -1, last_seed_ = -1;  // previous vertex, and last one without known neighbours
    Vector seed_errors_{};            // running mean of absolute residuals of such vertices [1/16]
};

// Choose for each kind the weights that make residuals cost the fewest bits (encoder only, floating point). The
// predictor has all grid coordinates and no vertex is known yet; it is changed.
TermWeights choose_term_weights(const std::vector<i32> &order, Predictor &points);

// Weights of smoothing in 1/16, -127 to 127: of a vertex's Laplacian and of the Laplacian's Laplacian, by the vertex's
// class.
constexpr int smoothing_classes = 7;
using SmoothingWeights = std::array<std::array<i32, 2>, smoothing_classes>;

// Move grid coordinates towards a smooth surface, each by half a step at most [1/64 steps].
std::vector<Vector> smoothed(const CornerTable &corners, std::span<const Vector> grid, const SmoothingWeights &weights);

// Weights that bring coordinates closest to the wanted ones, and the remaining error as a fraction of that without
// smoothing.
struct FittedSmoothing {
    SmoothingWeights weights;
    double error_ratio;
};

// Fit weights to wanted coordinates [steps]; nothing if these come hardly closer (encoder only, floating point).
std::optional<FittedSmoothing> fit_smoothing(const CornerTable &corners, std::span<const Vector> grid,
                                             std::span<const std::array<double, 3>> wanted);

// Bits of a kind of prediction.
constexpr u8 welds_points = 1, matches_residuals = 2, smooths_points = 4, ties_vertices = 8;
constexpr u8 reference_kinds = 16;

// Vertices that lie on the same point in every frame: of each vertex, the first one that it coincides with, mostly
// itself. Empty if no vertices are tied.
using Ties = std::span<const i32>;

struct CodedReference {
    u8 kind = 0;
    std::vector<u8> data;
};

// Smoothing of a frame.
struct Smoothing {
    SmoothingWeights weights{};
    std::vector<i32> point_of;  // welded point of each vertex: smoothing works across welds; empty without welds
    std::vector<Vector> grid;   // coordinates of the smoothed frame [1/64 steps]
    double error_ratio = 1.0;   // rms error of the smoothed frame divided by that of the frame
};

// Choose the smoothing of a frame; nothing if it comes hardly closer to the wanted positions. wanted: of each vertex
// [steps]; vertices of equal positions are welded.
std::optional<Smoothing> smooth_reference(const Polygons &mesh, std::span<const Vector> grid,
                                          std::span<const std::array<double, 3>> wanted, Ties ties);

// smoothing: null to leave the frame as it is. Tied vertices have equal coordinates.
CodedReference encode_reference(const Polygons &mesh, std::span<const Vector> grid, const Smoothing *smoothing,
                                Ties ties);

struct DecodedReference {
    std::vector<Vector> grid;  // coordinates of each vertex, in 1/64 steps if the kind smooths
    std::vector<i32> ties;     // see Ties
};

// Undo `encode_reference`; CorruptError if the bytes are damaged.
DecodedReference decode_reference(Polygons mesh, u8 kind, std::span<const u8> data);

}  // namespace pdeanim
