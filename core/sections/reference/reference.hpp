// Section REST without its header: the reference frame's grid coordinates, predicted across the faces.
//
// Vertices that lie on the same point may be welded for the purpose: seams and soups of polygons then have a surface to
// predict across. Residuals may be matched with earlier ones: regular shapes repeat themselves. The encoder takes what is
// smallest.
//
// This folder codes section REST (7 of the specification). Begin here: reference.cpp has the kinds and the welds, predictor.cpp
// what is expected of a vertex and the weights of that, point_model.hpp the context models of residuals.
#pragma once

#include <array>
#include <optional>
#include <span>
#include <vector>

#include "mesh/corner_table.hpp"

namespace pdeanim {

// Prediction of a vertex of the reference frame from the known vertices around it, in integers.
//
// Four things are looked at, each the mean of what the corners at the vertex find:
//
// * parallelograms: across the edge to the next triangle, or inside a quad (Touma and Gotsman 1998; several at once,
//   Cohen-Or, Cohen and Irony 2002);
// * the crease: how far such a parallelogram bends over its own two other edges: what it is about to miss;
// * straight on: from the vertex opposite over a neighbour, along a line, over a quad, or through a triangle vertex of six;
// * the neighbours themselves, and how far the prediction missed them.
//
// The first of parallelograms, straight on and neighbours that there is is the base. The others are predictor terms:
// weights in the stream bring them in, one set in all directions and another along the surface's normal alone, where
// curvature acts.

using Vector = std::array<i64, 3>;

constexpr int most_corners = 16;  // at a vertex that are looked at: few have more, sums stay far from overflow
constexpr int fraction_bits = 4;  // of predictions: small residuals depend on where between two grid points they lie
constexpr int smooth_bits = 6;    // of smoothed grid coordinates
constexpr int grid_bits = 40;     // grid coordinates are 0 to 2^40 - 1

// The terms by their number in the stream.
enum Term { crease, straight, miss, neighbours, term_count };

// What the base is: 0 nothing known around, 1 the neighbours, 2 straight on, and from 3 on one, two or more
// parallelograms, each without and with straight on.
constexpr int kind_count = 9, first_of_parallelograms = 3;

// Weights of the terms in 1/32, -127 to 127: in all directions, and of their component along the normal.
using TermWeights = std::array<std::array<std::array<i32, term_count>, 2>, kind_count>;

// What is known around a vertex.
struct Around {
    std::array<Vector, term_count> terms{};  // [1/16]
    Vector base{}, normal{}, errors{};       // [1/16], of any length, mean size of the neighbours' residuals [1/16]
    i64 spread = 0;                          // how far the parallelograms disagree
    int parallelograms = 0, kind = 0;

    // The base and the weighted terms [1/16].
    Vector predicted(const std::array<std::array<i32, term_count>, 2> &weights) const;
};

// The vertices of a mesh on the way through its prediction order.
class Predictor {
public:
    Predictor(const CornerTable &corners, std::vector<Vector> grid)
        : grid(std::move(grid)), corners_(corners), points_(this->grid.size()), is_known_(this->grid.size()) {}

    // What is known around a vertex that comes next.
    Around look_around(i32 vertex) const;

    // Note that a vertex is known now: its grid coordinates are set; `residual` are the sizes of its residuals.
    void learn(i32 vertex, const Around &around, const Vector &residual);

    std::vector<Vector> grid;

private:
    struct Point {
        Vector miss{}, error{};  // grid coordinates minus base [1/16]; sizes of residuals
    };

    void add_normal(i32 a, i32 b, i32 d, Vector &normal) const;

    const CornerTable &corners_;
    std::vector<Point> points_;
    std::vector<u8> is_known_;        // bytes side by side, as most vertices are asked for this alone
    i32 last_ = -1, last_seed_ = -1;  // the vertex before, and the last one that nothing was known around
    Vector seed_errors_{};            // sizes of residuals of such vertices [1/16]
};

// Choose the weights that make residuals cost the fewest bits, kind by kind (encoder only, floating point). The predictor has all grid coordinates and has learnt
// nothing; it is changed.
TermWeights choose_term_weights(const std::vector<i32> &order, Predictor &points);

// Weights of smoothing in 1/16, -127 to 127: of a vertex's Laplacian and of the Laplacian of that, by the class of the vertex.
constexpr int smoothing_classes = 7;
using SmoothingWeights = std::array<std::array<i32, 2>, smoothing_classes>;

// Grid coordinates moved towards a smooth surface, each by half a step at most [1/64 steps].
std::vector<Vector> smoothed(const CornerTable &corners, std::span<const Vector> grid, const SmoothingWeights &weights);

// Weights that bring coordinates nearest to wanted ones, and the mean error that is left to that without smoothing.
struct FittedSmoothing {
    SmoothingWeights weights;
    double error_ratio;
};

// Fit them to wanted coordinates [steps]; nothing where these hardly come nearer (encoder only, floating point).
std::optional<FittedSmoothing> fit_smoothing(const CornerTable &corners, std::span<const Vector> grid,
                                             std::span<const std::array<double, 3>> wanted);

// What kinds of prediction are made of.
constexpr u8 welds_points = 1, matches_residuals = 2, smooths_points = 4;

struct CodedReference {
    u8 kind = 0;
    std::vector<u8> data;
};

// How a frame is smoothed.
struct Smoothing {
    SmoothingWeights weights{};
    std::vector<i32> point_of;  // of each vertex: smoothing goes across the welds; empty without any
    std::vector<Vector> grid;   // of the smoothed frame [1/64 steps]
    double error_ratio = 1.0;   // its mean error to that of the frame
};

// Choose how a frame is smoothed; nothing where it hardly comes nearer to what is wanted. wanted: of each vertex [steps];
// vertices of equal ones are welded.
std::optional<Smoothing> smooth_reference(const Polygons &mesh, std::span<const Vector> grid,
                                          std::span<const std::array<double, 3>> wanted);

// smoothing: none where the frame stays as it is.
CodedReference encode_reference(const Polygons &mesh, std::span<const Vector> grid, const Smoothing *smoothing);

// Undo `encode_reference`, in 1/64 steps where the kind smooths; CorruptError if the bytes are damaged.
std::vector<Vector> decode_reference(Polygons mesh, u8 kind, std::span<const u8> data);

}  // namespace pdeanim
