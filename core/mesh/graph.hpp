// Graphs: neighbours of the vertices of a mesh, and vertex-disjoint curves that cover them.
#pragma once

#include <span>
#include <vector>

#include "mesh/corner_table.hpp"

namespace pdeanim {

struct Edge {
    i32 tail, head;
};

// Neighbours of the vertices of a mesh.
struct Graph {
    // Collect the neighbours of each vertex along undirected edges, each once, in the order of the edges. An edge may
    // occur several times; edges from a vertex to itself are left out.
    Graph(std::span<const Edge> edges, i64 vertices);

    i64 vertices() const { return static_cast<i64>(starts.size()) - 1; }
    i64 degree(i32 vertex) const { return starts[vertex + 1] - starts[vertex]; }
    std::span<const i32> of(i32 vertex) const {
        return {listed.data() + starts[vertex], listed.data() + starts[vertex + 1]};
    }

    std::vector<i64> starts;  // neighbours of vertex v are listed[starts[v]] to listed[starts[v + 1] - 1]
    std::vector<i32> listed;
};

// Return the edges of all objects, whose vertices are numbered consecutively: edges of faces, corner by corner, then
// edges of lines.
std::vector<Edge> edges_of(std::span<const ConnectivityView> objects);

// The vertex-disjoint curves found so far, and which vertices are in them. Curves are pieces of given paths, and
// straight paths through a graph.
struct CurveCover {
    explicit CurveCover(i64 vertices) : is_taken(vertices) { order.reserve(vertices); }

    // Make curves of the longest runs of free vertices along a path, if they have at least `shortest` vertices. Return
    // whether there were any.
    bool add_free_runs(std::span<const i32> path, i64 shortest);

    // Cover the free vertices that have a neighbour by paths that go straight and never touch themselves.
    //
    // A path grows from its seed in both directions, at each step to the free neighbour of its last vertex that
    // * has no other neighbour on the path, except the vertex before the last (a sharp turn) and the path's other end
    //   (the path is then closed, and ends);
    // * avoids a sharp turn if possible; shares the fewest neighbours with the vertex before the last, so it goes
    //   straightest; has the fewest free neighbours, so it runs along covered vertices; has the smallest index.
    //
    // The next seed is a free neighbour of the latest vertices, the one with the fewest free neighbours; otherwise the
    // first free vertex, those with one free neighbour first, so that chains come out whole.
    void add_paths(const Graph &graph);

    std::vector<i32> order;         // the vertices of all curves
    std::vector<i64> starts = {0};  // curve c is order[starts[c]] to order[starts[c + 1] - 1]
    std::vector<bool> is_taken;
};

}  // namespace pdeanim
