#include "mesh/graph.hpp"

namespace pdeanim {

Graph::Graph(std::span<const Edge> edges, i64 vertices) : starts(vertices + 1), listed(2 * edges.size()) {
    std::vector<i64> room(vertices + 1);
    for (const Edge &edge : edges) {
        ++room[edge.tail + 1];
        ++room[edge.head + 1];
    }
    for (i64 v = 0; v < vertices; ++v) room[v + 1] += room[v];
    std::vector<i64> fill(room.begin(), room.end() - 1);
    for (const Edge &edge : edges) {
        listed[fill[edge.tail]++] = edge.head;
        listed[fill[edge.head]++] = edge.tail;
    }
    // Which vertex listed another last: a second entry is passed over, whatever the number of neighbours.
    std::vector<i32> seen(vertices, -1);
    i64 used = 0;
    for (i32 v = 0; v < vertices; ++v) {
        for (i64 e = room[v]; e < room[v + 1]; ++e) {
            const i32 other = listed[e];
            if (other == v || seen[other] == v) continue;
            seen[other] = v;
            listed[used++] = other;
        }
        starts[v + 1] = used;
    }
    listed.resize(used);
}

}  // namespace pdeanim
