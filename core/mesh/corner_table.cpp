#include "mesh/corner_table.hpp"

#include <array>
#include <utility>

namespace pdeanim {

i64 element_count(Domain domain, const ConnectivityView &object) {
    switch (domain) {
        case Domain::vertex: return object.vertices;
        case Domain::face: return static_cast<i64>(object.face_sizes.size());
        case Domain::corner: return static_cast<i64>(object.face_indices.size());
        case Domain::object: return 1;
        case Domain::cell: return static_cast<i64>(object.cell_sizes.size());
    }
    return 0;
}

CornerTable::CornerTable(Polygons mesh) : polygons(std::move(mesh)) {
    const std::vector<i64> &starts = polygons.starts;
    const i64 corners = static_cast<i64>(polygons.vertex.size()), vertex_count = polygons.vertices;
    polygon.resize(corners);
    size.resize(corners);
    next.resize(corners);
    previous.resize(corners);
    fan_starts.assign(vertex_count + 1, 0);
    for (i64 p = 0; p + 1 < static_cast<i64>(starts.size()); ++p) {
        const i32 first = static_cast<i32>(starts[p]), last = static_cast<i32>(starts[p + 1] - 1);
        for (i32 corner = first; corner <= last; ++corner) {
            polygon[corner] = static_cast<i32>(p);
            size[corner] = last + 1 - first;
            next[corner] = corner < last ? corner + 1 : first;
            previous[corner] = corner > first ? corner - 1 : last;
        }
    }
    for (const i32 v : polygons.vertex) ++fan_starts[v + 1];
    for (i64 v = 0; v < vertex_count; ++v) fan_starts[v + 1] += fan_starts[v];
    std::vector<i64> fill(fan_starts.begin(), fan_starts.end() - 1);
    fan.resize(corners);
    for (i32 corner = 0; corner < corners; ++corner) fan[fill[vertex(corner)]++] = corner;

    // Find the corners on each edge at the edge's smaller end. `first_seen` and `last_seen` are the first and the
    // latest corner on the edge to another vertex.
    opposite.assign(corners, -1);
    std::vector<i32> seen_from(vertex_count, -1), first_seen(vertex_count), last_seen(vertex_count);
    const i64 face_corners = starts[polygons.faces];
    for (i32 v = 0; v < vertex_count; ++v) {
        for (i64 k = fan_starts[v]; k < fan_starts[v + 1] && fan[k] < face_corners; ++k) {
            for (int side = 0; side < 2; ++side) {
                const i32 edge = side == 0 ? fan[k] : previous[fan[k]];
                const i32 other = vertex(side == 0 ? next[edge] : edge);
                if (other <= v) continue;
                if (seen_from[other] != v) {
                    seen_from[other] = v;
                    first_seen[other] = edge;
                } else {
                    opposite[last_seen[other]] = edge;
                    opposite[edge] = first_seen[other];
                }
                last_seen[other] = edge;
            }
        }
    }
    for (i32 v = 0; v < vertex_count; ++v) {
        int pieces = 0;
        i32 one = 0, two = 0;
        for (i64 k = fan_starts[v]; k < fan_starts[v + 1]; ++k) {
            if (fan[k] < face_corners) continue;
            ++pieces;
            two = one;
            one = fan[k];
        }
        if (pieces == 2) {
            opposite[one] = two;
            opposite[two] = one;
        }
    }
}

Neighbourhood neighbourhood_at(const CornerTable &corners, i32 corner) {
    const auto &opposite = corners.opposite, &next = corners.next, &previous = corners.previous, &size = corners.size;
    Neighbourhood found;
    const i32 after = next[corner], before = previous[corner];
    found.after = corners.vertex(after);
    if (size[corner] == 2) {
        if (opposite[after] >= 0) found.straight_after = corners.vertex(next[opposite[after]]);
        return found;
    }
    found.before = corners.vertex(before);
    // Inside a surface, this vertex counts at another corner, that of the neighbouring polygon, as its vertex after.
    found.before_counts = opposite[before] < 0 || corners.vertex(opposite[before]) == corners.vertex(before);
    if (size[corner] == 3) {
        found.is_triangle = true;
        const i32 across = opposite[after];
        if (across < 0 || size[across] != 3) return found;
        found.opposite = corners.vertex(previous[across]);
        const i32 over_after = opposite[next[across]], over_before = opposite[previous[across]];
        if (over_after >= 0 && size[over_after] == 3) found.straight_after = corners.vertex(previous[over_after]);
        if (over_before >= 0 && size[over_before] == 3) found.straight_before = corners.vertex(previous[over_before]);
    } else if (size[corner] == 4) {
        found.opposite = corners.vertex(next[after]);
        const i32 over_after = opposite[after], over_before = opposite[previous[before]];
        if (over_after >= 0 && size[over_after] == 4) found.straight_after = corners.vertex(next[next[over_after]]);
        if (over_before >= 0 && size[over_before] == 4) found.straight_before = corners.vertex(previous[over_before]);
    }
    return found;
}

namespace {

constexpr int last_rank = 63;  // highest rank that is distinguished: about 12 faces that lack only this vertex

// For each rank, a queue of the vertices that have it, in the order in which they reached it.
class RankQueues {
public:
    explicit RankQueues(i64 vertices) : rank_(vertices), links_(vertices) {
        first_.fill(-1);
        last_.fill(-1);
    }

    void raise(i32 vertex, int by) {
        const int before = rank_[vertex], rank = least(before + by, last_rank);
        if (rank == before) return;
        if (before > 0) unlink(vertex);
        rank_[vertex] = static_cast<u8>(rank);
        links_[vertex] = {last_[rank], -1};
        (last_[rank] < 0 ? first_[rank] : links_[last_[rank]].next) = vertex;
        last_[rank] = vertex;
        best_ = most(best_, rank);
    }

    // Remove a vertex whose rank will not be raised again.
    void remove(i32 vertex) {
        if (rank_[vertex] > 0) unlink(vertex);
    }

    // Return the first vertex of the highest rank; -1 if no vertex has a rank.
    i32 best() {
        while (best_ > 0 && first_[best_] < 0) --best_;
        return best_ > 0 ? first_[best_] : -1;
    }

private:
    struct Links {
        i32 previous, next;
    };

    void unlink(i32 vertex) {
        const auto [previous, next] = links_[vertex];
        (previous < 0 ? first_[rank_[vertex]] : links_[previous].next) = next;
        (next < 0 ? last_[rank_[vertex]] : links_[next].previous) = previous;
    }

    std::vector<u8> rank_;
    std::vector<Links> links_;
    std::array<i32, last_rank + 1> first_, last_;
    int best_ = 0;
};

}  // namespace

std::vector<i32> prediction_order(const CornerTable &corners) {
    // How much a rank increases: for each face that lacks only this vertex, which predicts best, and for each edge of a
    // face to a known vertex.
    constexpr int face_lacks_one = 4, beside_known = 1;
    const std::vector<i64> &starts = corners.polygons.starts;
    const i64 vertex_count = corners.vertices();
    std::vector<i32> order;
    order.reserve(vertex_count);
    std::vector<bool> is_known(vertex_count);
    std::vector<i32> known_corners(starts.size() - 1);
    RankQueues queues(vertex_count);
    i32 seed = 0;
    while (static_cast<i64>(order.size()) < vertex_count) {
        i32 vertex = queues.best();
        if (vertex < 0) {
            while (seed < vertex_count &&
                   (is_known[seed] || corners.fan_starts[seed] == corners.fan_starts[seed + 1])) {
                ++seed;
            }
            if (seed == vertex_count) break;
            vertex = seed;
        }
        queues.remove(vertex);
        is_known[vertex] = true;
        order.push_back(vertex);
        for (i64 k = corners.fan_starts[vertex]; k < corners.fan_starts[vertex + 1]; ++k) {
            const i32 corner = corners.fan[k], polygon = corners.polygon[corner];
            i32 lacking = -1;
            if (++known_corners[polygon] == starts[polygon + 1] - starts[polygon] - 1) {
                for (i64 other = starts[polygon]; other < starts[polygon + 1]; ++other) {
                    if (!is_known[corners.polygons.vertex[other]]) lacking = corners.polygons.vertex[other];
                }
            }
            const i32 after = corners.vertex(corners.next[corner]), before = corners.vertex(corners.previous[corner]);
            for (int turn = 0; turn < 3; ++turn) {
                const i32 grown = turn == 0 ? after : turn == 1 ? before : lacking;
                if (grown < 0 || is_known[grown] || (turn == 2 && (grown == after || grown == before))) continue;
                queues.raise(grown, (turn < 2 ? beside_known : 0) + (grown == lacking ? face_lacks_one : 0));
            }
        }
    }
    for (i32 vertex = 0; vertex < vertex_count; ++vertex) {
        if (!is_known[vertex]) order.push_back(vertex);
    }
    return order;
}

}  // namespace pdeanim
