// Vertex-disjoint curves: pieces of given paths, and paths through a graph that go straight.
#pragma once

#include <span>
#include <vector>

#include "mesh/graph.hpp"

namespace pdeanim {

// The curves found so far, and which vertices are in one.
struct CurveCover {
    explicit CurveCover(i64 vertices) : is_taken(vertices) { order.reserve(vertices); }

    // Make curves of the maximal runs of free vertices along a path, each `shortest` vertices or longer. Whether there
    // were any.
    bool add_free_runs(std::span<const i32> path, i64 shortest);

    // Cover the free vertices that have a neighbour by paths that go straight and never come back beside themselves.
    //
    // A path grows from its seed in both directions, at each step to the free neighbour of its last vertex that
    // * has no other neighbour on the path, but for the vertex before the last (a sharp turn) and the path's other end
    //   (then the path is closed, and ends);
    // * makes no sharp turn if it can be helped; shares the fewest neighbours with the vertex before the last, hence
    //   goes straightest; has the fewest free neighbours, hence runs beside what is covered; has the smallest index.
    //
    // The next seed is a free neighbour of the latest vertices, the one with the fewest free neighbours; else the first
    // free vertex, those with one free neighbour first, so that chains come out whole.
    void add_paths(const Graph &graph);

    std::vector<i32> order;         // the vertices of all curves
    std::vector<i64> starts = {0};  // curve c is order[starts[c]] to order[starts[c + 1] - 1]
    std::vector<bool> is_taken;
};

}  // namespace pdeanim
