// Codes a surface face after face, growing across the border of the known part.
//
// The surface grows from a first face. At the next side (`Border`) the coder tells whether there is a face across, how
// many corners it has, and where these lie: at the border's next vertex on either side, at a new vertex, or at an
// earlier vertex elsewhere. On a closed triangle mesh this is Edgebreaker's alphabet (Rossignac 1999), with its symbols
// split into yes-or-no decisions. A vertex is complete when the border closes over it, so the symbols amount to the
// valences (Touma and Gotsman 1998, "Triangle mesh compression"), each with its known surroundings as context. If no
// side is left, the next face begins a new component.
//
// Any mesh can be coded: a face that no side leads to also begins a new component, at vertices given by their numbers.
// Vertices and faces come out in the order in which they are coded; connectivity/order.hpp restores the original order.
#pragma once

#include <span>
#include <vector>

#include "base/arithmetic.hpp"
#include "entropy/numbers.hpp"
#include "entropy/range_coder.hpp"

namespace pdeanim {

// The border of a growing surface: rings of sides that have no face across them yet, and queues that determine the next
// side.
//
// Faces are numbered as they are added, and so are their corners. The side of a corner runs from its vertex to the
// vertex of the next corner of its face. Sides without a face across form rings: every side is followed by a side that
// begins where it ends. On a manifold surface the rings are its borders; for arbitrary input nothing more is known.
//
// The next side is the one where the surface is closest to closing, measured by the angles that regular polygons would
// have there. (Alliez and Desbrun 2001, "Valence-driven connectivity encoding for 3D meshes", choose by valence.) A
// surface that grows in this way has no bays, whose two shores would meet later, at vertices that are expensive to
// identify.
class Border {
public:
    // open: may have a face across; closed: has none; inner: has one, and is in no ring
    enum State : i32 { open, closed, inner };

    struct Side {
        i32 origin = 0;                    // vertex at which it begins
        i32 before = 0;                    // side of the previous corner of its face
        i32 following = 0, preceding = 0;  // neighbours in its ring
        i32 state = open;
        i32 opposite = 0;            // the side across, or -1
        i32 later = 0, earlier = 0;  // neighbours in the queue of its priority, or -1
        i32 priority = 0;            // -1 if not queued
    };

    struct Vertex {
        i32 faces = 0;    // number of corners at the vertex
        i32 angle = 0;    // sum of the corners' angles, in units of 15 degrees
        i32 border = -1;  // a side that begins at the vertex and was in a ring when last checked, or -1
    };

    Border(i64 corners, i64 vertices) : sides(corners), vertices(vertices), queues_(priorities, -1) {}

    // Take the front side of the highest queue that is not empty; -1 if all queues are empty.
    i32 next_side();

    // Make a ring of the sides of a face that no side leads to. The origins of its corners must be set.
    void start_ring(i32 first, i32 size);

    // Attach a face across the side `gate`, which is in no queue, and update the rings. The side of the face's first
    // corner lies across the gate. The corners `begin` to `end` - 1 do not lie at neighbours of the gate in its ring.
    // If the vertex of such a corner is in a ring already, the rings are cut there and joined crosswise.
    void attach(i32 gate, i32 first, i32 size, i32 begin, i32 end);

    std::vector<Side> sides;
    std::vector<Vertex> vertices;

private:
    // Number of queues. Two adjacent vertices, each with five triangles (5 * 4), have priority 60; the last queue holds
    // all sides of higher priorities.
    static constexpr i32 priorities = 128;
    static constexpr i32 most_angle = 1 << 16;  // far above all queues; keeps sums within 32 bits for any file

    void enqueue(i32 side);
    void dequeue(i32 side);
    void place_corners(i32 first, i32 size);
    void link(i32 side, i32 following);
    bool is_one_edge(i32 side, i32 following) const;
    void join(i32 side, i32 following);
    void requeue(i32 side);

    std::vector<i32> queues_;  // front side of each queue, or -1
    i32 highest_ = 0;          // queues above this one are empty
};

// Faces in the order in which they are coded.
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

// A mesh to encode, with the pairs of its sides that run in opposite directions along an edge.
class SourceMesh {
public:
    // sizes: number of corners of each face, of which there is at least one; indices: vertex of each corner.
    SourceMesh(std::span<const i32> sizes, std::span<const i32> indices);

    i64 faces() const { return static_cast<i64>(sizes_.size()); }
    i64 corners() const { return static_cast<i64>(vertex_.size()); }
    const std::vector<i32> &used() const { return used_; }  // Return the vertices that are on a face, ascending.
    std::span<const i32> sizes() const { return sizes_; }

private:
    friend struct SurfaceEncoding;
    std::span<const i32> sizes_;
    std::vector<i32> used_;
    std::vector<i32> vertex_;   // vertex of each corner, numbered among the vertices that are used
    std::vector<i32> face_;     // face of each corner
    std::vector<i32> across_;   // for each corner, the group of corners whose sides run opposite to its own, or -1
    std::vector<i32> members_;  // corners by group: the sides of a group run from the same vertex to the same vertex
    std::vector<i32> group_starts_;
    std::vector<i32> firsts_;  // first corner of each face
};

// The source's order in terms of the coded surface.
struct SourceOrder {
    std::vector<i32> firsts;   // coded corner that comes first in each source face
    std::vector<i32> numbers;  // number of each coded vertex among the source's vertices that are on a face
};

// Statistics of the surface coder, which are kept from object to object.
class SurfaceModel {
public:
    SurfaceModel();

    // Encode a mesh, or measure the cost. `has_border` may be false only if coding with true has found no border.
    template <Mode mode>
    CodedSurface encode(RangeCoder<mode> &coder, const SourceMesh &mesh, bool has_border, SourceOrder &order);

    // Undo `encode`; CorruptError if the surface is not valid. common_size: number of corners of every face, or 0 if
    // they differ; vertices: upper bound on the number of vertices on faces.
    CodedSurface decode(RangeCoder<Mode::decode> &coder, i32 common_size, bool has_border, i64 faces, i64 corners,
                        i64 vertices);

private:
    template <Mode mode> friend class SurfaceCoder;

    static constexpr int most_faces = 11, most_angle = 23, most_size = 7;  // contexts clamp these counts
    static constexpr int told_sizes = 4;  // sizes 3, 4, 5, and 6 or more have their own models
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
    int closed_recently_ = 0;              // on which sides the last 3 faces closed, 2 bits per face
    i32 last_size_ = 0, size_before_ = 0;  // sizes of the last two faces whose size was coded
};

}  // namespace pdeanim
