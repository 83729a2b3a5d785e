// Adjacency of the corners of a mesh's polygons, and the order in which vertices are best predicted.
//
// A mesh is a list of polygons, with lines cut into polygons of two corners; a corner is a position in that list.
// Everything takes time proportional to the number of corners, whatever the mesh, and nothing depends on the positions
// of vertices.
#pragma once

#include <span>
#include <vector>

#include "base/arithmetic.hpp"

namespace pdeanim {

// Faces and lines of one object; and, if solids are kept, the cells whose visible sides they are
// (`sections/connectivity/solids.hpp`).
struct Connectivity {
    i64 vertices = 0;
    std::vector<i32> face_sizes, face_indices, line_sizes, line_indices;
    std::vector<u8> cell_shapes;
    std::vector<i32> cell_sizes, cell_indices;
};

// Connectivity as views of the caller's arrays.
struct ConnectivityView {
    i64 vertices = 0;
    std::span<const i32> face_sizes, face_indices, line_sizes, line_indices;
    std::span<const u8> cell_shapes = {};
    std::span<const i32> cell_sizes = {}, cell_indices = {};
};

inline ConnectivityView view_of(const Connectivity &part) {
    return {part.vertices,     part.face_sizes,  part.face_indices, part.line_sizes,
            part.line_indices, part.cell_shapes, part.cell_sizes,   part.cell_indices};
}

// The kind of element that the values of an attribute or a field belong to.
enum class Domain : u8 { vertex, face, corner, object, cell };
constexpr int domain_count = 5;

// Return the number of elements of an object.
i64 element_count(Domain domain, const ConnectivityView &object);

// Faces of all objects, then lines as pieces of two corners. The vertices of all objects are numbered consecutively.
struct Polygons {
    std::vector<i64> starts = {0};  // polygon p has the corners starts[p] to starts[p + 1] - 1
    std::vector<i32> vertex;        // vertex of each corner
    i64 faces = 0, vertices = 0;    // polygons from `faces` on are pieces of lines
};

struct CornerTable {
    explicit CornerTable(Polygons mesh);

    i64 vertices() const { return polygons.vertices; }
    i32 vertex(i32 corner) const { return polygons.vertex[corner]; }

    Polygons polygons;
    std::vector<i32> polygon, size;   // polygon of each corner, and the polygon's number of corners
    std::vector<i32> next, previous;  // corner of the same polygon
    // The edge of a corner goes to the next corner of its face. For each corner, this is the corner of another face
    // that has the same edge; -1 if there is none. The corners of all faces on one edge form a ring, in the order in
    // which the edge's smaller vertex meets them: corner by corner, first the edge from it, then the edge to it. For a
    // piece of a line, it is the corner of the other piece at the same vertex, if exactly two pieces meet there.
    std::vector<i32> opposite;
    std::vector<i64>
        fan_starts;  // the corners at vertex v are fan[fan_starts[v]] to fan[fan_starts[v + 1] - 1], ascending
    std::vector<i32> fan;
};

// The vertices that can predict a vertex at one of its corners; -1 for those that do not exist.
struct Neighbourhood {
    i32 after = -1, before = -1;
    i32 opposite = -1;  // in a quad, the diagonally opposite corner; in a triangle, the far corner across the edge
    i32 straight_after = -1, straight_before = -1;  // straight on beyond the vertex after, and before
    bool is_triangle = false;
    // Whether the vertex before counts as a neighbour here. Inside a surface it does not: it is the vertex after of
    // another corner, and counts there.
    bool before_counts = false;
};

Neighbourhood neighbourhood_at(const CornerTable &corners, i32 corner);

// Return an order of the vertices that completes faces early: each next vertex is the missing one of as many faces as
// possible. It is the vertex of highest rank; of several, the first to reach that rank. If no vertex has a rank, it is
// the next vertex of any polygon. Vertices without polygons come last.
std::vector<i32> prediction_order(const CornerTable &corners);

}  // namespace pdeanim
