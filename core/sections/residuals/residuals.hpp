// Section CORR: corrections of single vertices at single frames, which keep the bound.
//
// A vertex is identified by its place in the order of the patches: errors cluster in space as they do in time, and the
// coder uses both. A residual is three whole numbers of steps. If even that misses the bound, the vertex is stored raw,
// as the three float32 numbers of the input. The chunk of a group of frames is one stream of the range coder: the
// numbers of residuals and of raw vertices, whether residuals are predicted, the residuals, the raw vertices.
//
// This folder codes section CORR (15 and 16.4 of the specification). Begin here: residuals.cpp has the stream and adds
// residuals to positions, residual_model codes which vertices have a residual, and its three numbers.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "base/arithmetic.hpp"
#include "base/errors.hpp"

namespace pdeanim {

using Position = std::array<float, 3>;
using Steps = std::array<i64, 3>;

constexpr i64 largest_residual = i64{1} << 40;  // largest magnitude on each axis, in steps

// Memory of decoding, in which limits of files are expressed. Residual: place 4, steps 24, errors 12, earlier residual
// 8, and spare room. Raw vertex: place and position 16, and its copies.
constexpr i64 bytes_per_residual = 64, bytes_per_raw_vertex = 96;

// Residuals and raw vertices of consecutive frames. Those of frame f are numbered `frame_starts[f]` to `frame_starts[f
// + 1] - 1`; their places ascend within a frame.
struct Residuals {
    std::vector<i64> frame_starts{0};
    std::vector<i32> places;
    std::vector<Steps> quantised;
    std::vector<i64> raw_frame_starts{0};
    std::vector<i32> raw_places;
    std::vector<Position> raw_positions;

    i64 frames() const { return static_cast<i64>(frame_starts.size()) - 1; }
    i64 count() const { return static_cast<i64>(places.size() + raw_places.size()); }
    i64 bytes() const {  // Return the size of the vectors in memory.
        return static_cast<i64>(sizeof(i64) * (frame_starts.size() + raw_frame_starts.size()) +
                                (sizeof(i32) + sizeof(Steps)) * places.size() +
                                (sizeof(i32) + sizeof(Position)) * raw_places.size());
    }
};

// Choices of the encoder for coding residuals.
struct ResidualCoding {
    bool is_predicted = false;
    std::span<const i64> distances;  // how many frames back each frame's reference is
};

// Raise ArgumentError unless residuals are valid for a decoder, on a mesh of `vertices` vertices.
void check_residuals(const Residuals &residuals, i64 vertices);

// Return how many frames back each frame's reference is: more than 1 if an earlier frame is much more similar than the
// previous one.
std::vector<i64> reference_distances(const Residuals &residuals);

// Encode the chunk of a group; empty if there are no residuals. patches: first place of each patch, then the number of
// vertices.
std::vector<u8> encode_residuals(const Residuals &residuals, std::span<const i64> patches,
                                 const ResidualCoding &coding);

// Measure the size of such a chunk [bits]. copies: ratio of the number of residuals to that in the sample.
double measure_residuals(const Residuals &residuals, std::span<const i64> patches, const ResidualCoding &coding,
                         double copies = 1.0);

// Undo `encode_residuals`. CorruptError if the bytes are impossible or do not end with the residuals, LimitError if
// residuals take more memory than is left.
Residuals decode_residuals(std::span<const u8> data, i64 frames, std::span<const i64> patches, TakenMemory &taken);

// How residuals are added to positions.
struct ResidualScale {
    std::span<const i32> order;  // the vertex at each place; all are below the number of vertices
    double step;                 // size of a step [scene units]
};

// Add `weight` times the residuals of one frame to the positions of all vertices: in float64, rounded to float32 once.
// base: the model's positions at that frame, from which raw vertices differ; empty at the time of the frame itself,
// where raw vertices replace positions.
void add_residuals(const Residuals &residuals, i64 frame, const ResidualScale &scale, double weight,
                   std::span<const Position> base, std::span<Position> positions);

// Write the displacements of all vertices that one frame's residuals cause; `base` is needed if there are raw vertices.
void residual_displacements(const Residuals &residuals, i64 frame, const ResidualScale &scale,
                            std::span<const Position> base, std::span<std::array<double, 3>> displacements);

}  // namespace pdeanim
