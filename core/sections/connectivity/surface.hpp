// Coding of a surface, face after face across the border of what is known.
//
// The surface grows from a first face. At the side that is next (mesh/border.hpp) it is coded whether there is a face
// across, how many corners it has, and where these are: at the border's next vertex on either side, at a vertex not met
// before, or at one met elsewhere. On a closed triangle mesh that is Edgebreaker's alphabet (Rossignac 1999), its symbols
// split into yes and no; a vertex is complete when the border closes over it, so what the symbols spell is the valences
// (Touma and Gotsman 1998, "Triangle mesh compression"), each with all that is known around it as context. When no side
// is left, the next face begins anew.
//
// Nothing is asked of the mesh: a face that no side leads to begins anew as well, at vertices named by their number.
// Vertices and faces come out in the order of their coding; connectivity/order.hpp restores theirs.
#pragma once

#include <span>
#include <vector>

#include "entropy/numbers.hpp"
#include "entropy/range_coder.hpp"
#include "mesh/border.hpp"

namespace pdeanim {

// Faces in the order of their coding.
struct CodedSurface {
    CodedSurface(i64 faces, i64 corners, i64 most_vertices) : sizes(faces), border(corners, most_vertices) {}

    bool has_border() const {
        for (const Border::Side &side : border.sides) {
            if (side.state == Border::closed) return true;
        }
        return false;
    }

    std::vector<i32> sizes;
    Border border;
    i32 vertex_count = 0;  // vertices that are on a face
};

// A mesh that is encoded: which sides run against each other, and what has been coded of it.
class SourceMesh {
public:
    // sizes: corners of each face, at least one face; indices: vertex of each corner.
    SourceMesh(std::span<const i32> sizes, std::span<const i32> indices);

    i64 faces() const { return static_cast<i64>(sizes_.size()); }
    i64 corners() const { return static_cast<i64>(vertex_.size()); }
    const std::vector<i32> &used() const { return used_; }  // vertices that are on a face, ascending
    std::span<const i32> sizes() const { return sizes_; }

private:
    friend struct SurfaceEncoding;
    std::span<const i32> sizes_;
    std::vector<i32> used_;
    std::vector<i32> vertex_;   // of each corner, numbered among those used
    std::vector<i32> face_;     // of each corner
    std::vector<i32> across_;   // of each corner, the group of corners whose sides run the other way, or -1
    std::vector<i32> members_;  // corners, group after group: those of a group have sides between the same vertices
    std::vector<i32> group_starts_;
    std::vector<i32> firsts_;  // first corner of each face
};

// How a coded surface's faces and vertices stood in the source.
struct SourceOrder {
    std::vector<i32> firsts;   // of each of the source's faces, the first corner
    std::vector<i32> numbers;  // of each vertex, its place among the source's vertices that are on a face
};

// What the coder of surfaces has learnt; it goes on learning from object to object.
class SurfaceModel {
public:
    SurfaceModel();

    // Encode a mesh, or measure what that costs. `has_border` is false only where coding it with true found none.
    template <Mode mode>
    CodedSurface encode(RangeCoder<mode> &coder, const SourceMesh &mesh, bool has_border, SourceOrder &order);

    // Undo `encode`; CorruptError where the bits are not those of a sound surface. common_size: corners of every face, or
    // 0 where they differ; vertices: no more can be on faces.
    CodedSurface decode(RangeCoder<Mode::decode> &coder, i32 common_size, bool has_border, i64 faces, i64 corners,
                        i64 vertices);

private:
    template <Mode mode> friend class SurfaceCoder;

    static constexpr int most_faces = 11, most_angle = 23, most_size = 7;  // counts are alike from these on
    static constexpr int told_sizes = 4;  // sizes 3, 4, 5 and those from 6 on have models of their own
    static constexpr int F = most_faces + 1, A = most_angle + 1, S = most_size + 1;

    struct SizeModels {
        std::vector<BitModel> angles = std::vector<BitModel>(A * A), recent = std::vector<BitModel>(S * S),
                              faces = std::vector<BitModel>(F * F * S);
        Weights<3> weights;
    };
    struct ClosingModels {
        std::vector<BitModel> beyond = std::vector<BitModel>(F * F * 2), opposite = std::vector<BitModel>(F * F * F),
                              recent = std::vector<BitModel>(A * S * 64);
        Weights<3> weights;
    };

    std::vector<BitModel> border_, border_recent_, border_beside_;
    Weights<3> border_weights_;
    std::array<SizeModels, told_sizes> sizes_;
    std::array<ClosingModels, 2> closings_;
    std::array<BitModel, 8> new_vertex_;
    NumberModel distance_, number_, large_size_;

    int borders_ = 0;                      // the last 8 decisions "no face across", the latest in bit 0
    int closed_recently_ = 0;              // whether the last 3 faces closed on either side, 2 bits each
    i32 last_size_ = 0, size_before_ = 0;  // of the last two faces that were told
};

}  // namespace pdeanim
