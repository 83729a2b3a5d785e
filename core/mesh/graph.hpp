// Neighbours of the vertices of a mesh.
#pragma once

#include <span>
#include <vector>

#include "mesh/connectivity.hpp"

namespace pdeanim {

struct Edge {
    i32 tail, head;
};

struct Graph {
    // Neighbours along undirected edges, each once, in the order of the edges. An edge may be there several times; those
    // from a vertex to itself are left out.
    Graph(std::span<const Edge> edges, i64 vertices);

    i64 vertices() const { return static_cast<i64>(starts.size()) - 1; }
    i64 degree(i32 vertex) const { return starts[vertex + 1] - starts[vertex]; }
    std::span<const i32> of(i32 vertex) const {
        return {listed.data() + starts[vertex], listed.data() + starts[vertex + 1]};
    }

    std::vector<i64> starts;  // neighbours of vertex v are listed[starts[v]] to listed[starts[v + 1] - 1]
    std::vector<i32> listed;
};

// Edges of all objects, whose vertices are numbered through: of faces, corner by corner, then of lines.
std::vector<Edge> edges_of(std::span<const ConnectivityView> objects);

}  // namespace pdeanim
