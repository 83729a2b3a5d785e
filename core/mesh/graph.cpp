#include "mesh/graph.hpp"

#include <array>

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
    // For each vertex, the last vertex that has listed it as a neighbour: an edge that occurs again is skipped, however
    // many neighbours there are.
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

namespace {

constexpr i64 look_back = 16;  // number of vertices at the end of a path whose neighbours may begin the next path
// Number of neighbours that are compared. A vertex with more neighbours is taken only if no other vertex continues the
// path.
constexpr i64 few_neighbours = 16;

class PathCover {
public:
    PathCover(const Graph &graph, CurveCover &cover) : graph_(graph), cover_(cover), vertices_(graph.vertices()) {
        for (i32 v = 0; v < graph.vertices(); ++v) {
            for (const i32 other : graph.of(v)) vertices_[v].free += !cover.is_taken[other];
        }
    }

    void cover_all() {
        for (const bool only_ends : {true, false}) {
            for (i32 v = 0; v < graph_.vertices(); ++v) {
                if (cover_.is_taken[v] || graph_.degree(v) == 0 || (only_ends && vertices_[v].free != 1)) continue;
                for (i32 seed = v; seed >= 0; seed = seed_beside()) grow_path(seed);
            }
        }
    }

private:
    struct Vertex {
        i32 free = 0;    // number of neighbours that are in no curve
        i32 beside = 0;  // number of its neighbours on the path with the number `path`
        i64 path = -1;
        i64 near_end = -1;     // the latest step at which it was a neighbour of the path's other end
        i64 near_before = -1;  // the latest step at which it was a neighbour of the path's last vertex but one
    };

    // The next vertex of a path, or -1; and whether it closes the path.
    struct Step {
        i32 vertex = -1;
        bool closes = false;
    };

    void take(i32 vertex) {
        cover_.is_taken[vertex] = true;
        for (const i32 other : graph_.of(vertex)) {
            Vertex &near = vertices_[other];
            --near.free;
            if (near.path != path_) {
                near.path = path_;
                near.beside = 0;
            }
            ++near.beside;
        }
    }

    void grow_path(i32 seed) {
        ahead_.assign(1, seed);
        behind_.clear();
        take(seed);
        if (!grow(ahead_, -1, seed)) {
            const bool is_longer = ahead_.size() > 1;
            behind_.push_back(seed);
            grow(behind_, is_longer ? ahead_[1] : -1, ahead_.back());
            cover_.order.insert(cover_.order.end(), behind_.rbegin(), behind_.rend() - 1);
        }
        cover_.order.insert(cover_.order.end(), ahead_.begin(), ahead_.end());
        cover_.starts.push_back(static_cast<i64>(cover_.order.size()));
        ++path_;
    }

    // Append vertices to one end of a path, and return whether they close it. `before` is the vertex before the last
    // one at this end, `end` the vertex at the path's other end.
    bool grow(std::vector<i32> &side, i32 before, i32 end) {
        const i64 end_mark = ++steps_;
        for (const i32 other : graph_.of(end)) vertices_[other].near_end = end_mark;
        while (true) {
            const i32 here = side.back();
            const Step step = next_step(here, before, end, end_mark);
            if (step.vertex < 0) return false;
            take(step.vertex);
            side.push_back(step.vertex);
            if (step.closes) return true;
            before = here;
        }
    }

    Step next_step(i32 here, i32 before, i32 end, i64 end_mark) {
        ++steps_;
        if (before >= 0) {
            for (const i32 other : graph_.of(before)) vertices_[other].near_before = steps_;
        }
        Step best;
        std::array<i64, 4> best_rank{};
        for (const i32 other : graph_.of(here)) {
            if (cover_.is_taken[other]) continue;
            const Vertex &vertex = vertices_[other];
            const bool is_sharp = vertex.near_before == steps_;
            const bool closes = vertex.near_end == end_mark && end != here && end != before;
            if (vertex.beside > 1 + is_sharp + closes) continue;
            i64 shared = few_neighbours + 1;
            if (graph_.degree(other) <= few_neighbours) {
                shared = 0;
                for (const i32 near : graph_.of(other)) shared += vertices_[near].near_before == steps_;
            }
            const std::array<i64, 4> rank = {is_sharp, shared, vertex.free, other};
            if (best.vertex < 0 || rank < best_rank) {
                best = {other, closes};
                best_rank = rank;
            }
        }
        return best;
    }

    // Return a free neighbour of the last vertices of the latest path, or -1.
    i32 seed_beside() const {
        const i64 end = cover_.starts.back(), begin = most(end - look_back, cover_.starts[cover_.starts.size() - 2]);
        i32 found = -1;
        for (i64 k = end - 1; k >= begin && found < 0; --k) {
            for (const i32 other : graph_.of(cover_.order[k])) {
                if (cover_.is_taken[other]) continue;
                const i32 free = vertices_[other].free;
                if (found < 0 || free < vertices_[found].free || (free == vertices_[found].free && other < found)) {
                    found = other;
                }
            }
        }
        return found;
    }

    const Graph &graph_;
    CurveCover &cover_;
    std::vector<Vertex> vertices_;
    std::vector<i32> ahead_, behind_;  // vertices of the growing path on both sides of its seed
    i64 path_ = 0, steps_ = 0;
};

}  // namespace

bool CurveCover::add_free_runs(std::span<const i32> path, i64 shortest) {
    const std::size_t curves = starts.size();
    const auto end_run = [&] {
        if (static_cast<i64>(order.size()) - starts.back() >= shortest) {
            starts.push_back(static_cast<i64>(order.size()));
            return;
        }
        for (; static_cast<i64>(order.size()) > starts.back(); order.pop_back()) is_taken[order.back()] = false;
    };
    for (const i32 vertex : path) {
        if (is_taken[vertex]) {
            end_run();
        } else {
            is_taken[vertex] = true;
            order.push_back(vertex);
        }
    }
    end_run();
    return starts.size() > curves;
}

void CurveCover::add_paths(const Graph &graph) { PathCover(graph, *this).cover_all(); }

}  // namespace pdeanim
