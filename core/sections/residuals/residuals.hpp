// Section CORR: what single vertices of single frames lack, so that the bound holds.
//
// A vertex is named by its place in the order of the patches: misses gather in space as they do in time, and the coder
// counts on both. A residual is three whole numbers of steps; where even that misses the bound, the vertex is kept raw,
// as the three float32 numbers of the input. The chunk of a group of frames is one stream of the range coder: how many
// residuals and raw vertices there are, whether residuals are predicted, the residuals, the raw vertices.
//
// This folder codes section CORR (15 and 16.4 of the specification). Begin here: residuals.cpp has the stream and adds
// residuals to positions, residual_model says which vertices have one and how its three numbers are coded.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "base/arithmetic.hpp"
#include "base/errors.hpp"

namespace pdeanim {

using Position = std::array<float, 3>;
using Steps = std::array<i64, 3>;

constexpr i64 largest_residual = i64{1} << 40;  // magnitude on each axis, in steps

// Memory of decoding: place 4, steps 24, misses 12, earlier residual 8, and room to spare; for a raw vertex place and
// position 16, and its copies. Limits of files are in these units.
constexpr i64 bytes_per_residual = 64, bytes_per_raw_vertex = 96;

// Residuals and raw vertices of consecutive frames. Those of frame f are numbered `frame_starts[f]` to
// `frame_starts[f + 1] - 1`; their places ascend within a frame.
struct Residuals {
    std::vector<i64> frame_starts{0};
    std::vector<i32> places;
    std::vector<Steps> quantised;
    std::vector<i64> raw_frame_starts{0};
    std::vector<i32> raw_places;
    std::vector<Position> raw_positions;

    i64 frames() const { return static_cast<i64>(frame_starts.size()) - 1; }
    i64 count() const { return static_cast<i64>(places.size() + raw_places.size()); }
    i64 bytes() const {  // that the vectors hold
        return static_cast<i64>(sizeof(i64) * (frame_starts.size() + raw_frame_starts.size()) +
                                (sizeof(i32) + sizeof(Steps)) * places.size() +
                                (sizeof(i32) + sizeof(Position)) * raw_places.size());
    }
};

// How residuals are coded.
struct ResidualCoding {
    bool is_predicted = false;
    std::span<const i64> distances;  // of each frame: how many frames before it its reference is
};

// ArgumentError unless residuals are as the decoder will have them, on a mesh of so many vertices.
void check_residuals(const Residuals &residuals, i64 vertices);

// Distances of references: more than 1 where a frame far before is much more alike than the one before.
std::vector<i64> reference_distances(const Residuals &residuals);

// The chunk of a group; empty where there are no residuals. patches: first place of each, and the number of vertices.
std::vector<u8> encode_residuals(const Residuals &residuals, std::span<const i64> patches,
                                 const ResidualCoding &coding);

// What it takes [bits]; or, of part of a mesh, so many times as many residuals that are like these.
double measure_residuals(const Residuals &residuals, std::span<const i64> patches, const ResidualCoding &coding,
                         double copies = 1.0);

// Undo `encode_residuals`. CorruptError where the bytes say what cannot be, or do not end with the residuals;
// LimitError where these take more than is left.
Residuals decode_residuals(std::span<const u8> data, i64 frames, std::span<const i64> patches, TakenMemory &taken);

// What adding residuals depends on besides them.
struct ResidualScale {
    std::span<const i32> order;  // the vertex at each place; all below the number of vertices
    double step;                 // size of a step [scene units]
};

// Add the residuals of one frame, `weight` times each, to positions of all vertices: in float64, rounded to float32
// once. base: what the model alone decodes to at that frame; empty at the frame itself, where raw vertices are as they
// are.
void add_residuals(const Residuals &residuals, i64 frame, const ResidualScale &scale, double weight,
                   std::span<const Position> base, std::span<Position> positions);

// What the residuals of one frame add to the positions of all vertices; `base` is needed where there are raw vertices.
void residual_displacements(const Residuals &residuals, i64 frame, const ResidualScale &scale,
                            std::span<const Position> base, std::span<std::array<double, 3>> displacements);

}  // namespace pdeanim
