// Vertices divided into elements, patches of the mesh or pieces of its curves, under a tree of halves.
//
// All of it is arithmetic in integers, and the same everywhere.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "mesh/corner_table.hpp"
#include "mesh/z_order.hpp"

namespace pdeanim {

// Elements and the partition tree over them. Node 0 is the whole mesh; a node's halves come after it.
struct Patches {
    i64 count() const { return static_cast<i64>(node_of.size()); }
    i64 size(i64 patch) const { return starts[patch + 1] - starts[patch]; }
    std::span<const i32> vertices(i64 patch) const {
        return {order.data() + starts[patch], static_cast<std::size_t>(size(patch))};
    }

    // Say `ascending`, once everything else is there.
    void sort_vertices();

    std::vector<i32> order;     // vertices of the mesh, patch after patch
    std::vector<i64> starts;    // patch p holds order[starts[p]] to order[starts[p + 1] - 1]
    std::vector<i64> begins;    // where in `order` each node of the partition tree begins
    std::vector<i64> children;  // first of the two halves of each node, the second follows it; -1 for a patch
    std::vector<i64> node_of;   // the node that each patch is
    // The vertices of each patch by their numbers, as what is written goes through memory, and where in the patch each of
    // them stands: ascending[starts[p] + k] is order[starts[p] + ascending_places[starts[p] + k]].
    std::vector<i32> ascending, ascending_places;
};

// Patches of at most `points` vertices: the vertices of all objects, halved along faces and lines. A set of several
// components is cut between two of them, nearest to its middle. A connected one is cut across: from the vertex b that is
// farthest from the vertex a that is farthest from the set's first vertex, vertices are sorted by how much nearer they are
// to a than to b, and the nearer half goes first.
//
// This is before the reference frame is known; none where a vertex has no neighbour.
std::shared_ptr<Patches> early_patches(std::span<const ConnectivityView> objects, i64 points);

// Patches of a mesh whose vertices at one place of the grid are neighbours, too. Vertices without neighbours come last, in
// Z-order. `early`: what `early_patches` found, which is given back unless vertices coincide.
std::shared_ptr<Patches> build_patches(std::span<const ConnectivityView> objects, std::span<const GridPoint> grid,
                                       i64 points, std::shared_ptr<Patches> early = nullptr);

// Pieces of about `points` vertices of curves that stand one after the other in `order`, from each of `starts` on.
Patches cut_curves(std::vector<i32> order, std::span<const i64> starts, i64 points);

}  // namespace pdeanim
