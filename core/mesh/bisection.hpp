// Divides vertices into elements, which are patches of the mesh or pieces of its curves, under a partition tree.
//
// Everything is integer arithmetic, so it is the same everywhere.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "mesh/corner_table.hpp"
#include "mesh/z_order.hpp"

namespace pdeanim {

// A vertex that coincides with another one in every frame, and the first of all vertices that coincide there.
struct Tie {
    i32 vertex, first;
};

// Elements and the partition tree over them. Node 0 is the whole mesh; a node's halves come after it. If some vertices
// stand still in all frames, they are the second half of node 0.
struct Patches {
    i64 count() const { return static_cast<i64>(node_of.size()); }
    i64 size(i64 patch) const { return starts[patch + 1] - starts[patch]; }
    std::span<const i32> vertices(i64 patch) const {
        return {order.data() + starts[patch], static_cast<std::size_t>(size(patch))};
    }

    i64 vertices() const { return static_cast<i64>(order.size() + tied.size()); }

    // Compute `ascending` from the other members.
    void sort_vertices();

    // Copy rows of the vertices in `order` to the vertices that are tied to them.
    template <class Row> void copy_to_tied(std::span<Row> rows) const {
        for (const Tie &tie : tied) rows[tie.vertex] = rows[tie.first];
    }

    std::vector<i32> order;     // vertices of the mesh, patch after patch, without those that are tied to others
    std::vector<Tie> tied;      // vertices that are tied to others
    std::vector<i64> starts;    // patch p holds order[starts[p]] to order[starts[p + 1] - 1]
    std::vector<i64> begins;    // where each node of the partition tree starts in `order`
    std::vector<i64> children;  // for each node, its first half, which the second half follows; -1 for a patch
    std::vector<i64> node_of;   // the node of the tree that is each patch
    i64 moving = 0;             // number of the first patches, whose vertices move; those of all others stand still
    // The vertices of each patch in ascending order, the order in which they are written to memory, and the index of
    // each of them in the patch: ascending[starts[p] + k] is order[starts[p] + ascending_places[starts[p] + k]].
    std::vector<i32> ascending, ascending_places;
};

// Make patches of at most `points` vertices: the vertices of all objects, halved along faces and lines.
//
// A set of several components is cut between the two components that are nearest to its middle. A connected set is cut
// across: b is the vertex farthest from a, and a the vertex farthest from the set's first vertex. Vertices are sorted
// by how much closer they are to a than to b, and the closer half goes first. This runs before the reference frame is
// known; null if a vertex has no neighbour.
std::shared_ptr<Patches> early_patches(std::span<const ConnectivityView> objects, i64 points,
                                       std::span<const u8> still = {});

// Make patches of a mesh in which vertices at the same grid point are neighbours, too. Vertices without neighbours come
// last, in Z-order. ties: for each vertex the first vertex that it is tied to, empty without ties. still: whether each
// vertex stands still, empty if none does. early: the result of `early_patches`, which is returned if no vertices
// coincide.
std::shared_ptr<Patches> build_patches(std::span<const ConnectivityView> objects, std::span<const GridPoint> grid,
                                       i64 points, std::span<const i32> ties = {}, std::span<const u8> still = {},
                                       std::shared_ptr<Patches> early = nullptr);

// Cut curves into pieces of about `points` vertices, without tied vertices; the vertices that stand still are curves of
// their own. The curves follow each other in `order`; each begins at one of `starts`.
Patches cut_curves(std::vector<i32> order, std::vector<i64> starts, i64 points, std::span<const i32> ties = {},
                   std::span<const u8> still = {});

}  // namespace pdeanim
