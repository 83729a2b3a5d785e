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

std::vector<Edge> edges_of(std::span<const ConnectivityView> objects) {
    std::size_t most_edges = 0;
    for (const ConnectivityView &object : objects) {
        most_edges += object.face_indices.size() + object.line_indices.size();
    }
    std::vector<Edge> edges;
    edges.reserve(most_edges);
    i32 shift = 0;
    for (const ConnectivityView &object : objects) {
        const auto add = [&](i32 from, i32 to) { edges.push_back({from + shift, to + shift}); };
        const i32 *corner = object.face_indices.data();
        for (const i32 size : object.face_sizes) {
            for (i32 k = 0; k < size; ++k) add(corner[k], corner[k + 1 < size ? k + 1 : 0]);
            corner += size;
        }
        const i32 *point = object.line_indices.data();
        for (const i32 size : object.line_sizes) {
            for (i32 k = 0; k + 1 < size; ++k) add(point[k], point[k + 1]);
            point += size;
        }
        shift += static_cast<i32>(object.vertices);
    }
    return edges;
}

}  // namespace pdeanim
