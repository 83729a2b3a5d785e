#include "mesh/bisection.hpp"

#include <algorithm>
#include <numeric>
#include <utility>

#include "mesh/graph.hpp"

namespace pdeanim {

namespace {

// Return edges that chain the vertices at each grid point: from each vertex to the next one at the same point.
std::vector<Edge> coincident_vertices(std::span<const GridPoint> grid) {
    // Vertices at one grid point share a bucket with few others. If many points collide, the bucket is sorted, so that
    // no mesh makes this slow.
    constexpr u64 factor = 0x9E3779B97F4A7C15;  // 2^64 over the golden ratio (Knuth, volume 3, section 6.4)
    const int shift = 64 - bit_length(static_cast<i64>(grid.size()));
    std::vector<i32> buckets(grid.size()), starts((std::size_t{1} << (64 - shift)) + 1), order(grid.size());
    for (std::size_t vertex = 0; vertex < grid.size(); ++vertex) {
        u64 mixed = 0;
        for (const i64 coordinate : grid[vertex]) mixed = (mixed ^ static_cast<u64>(coordinate)) * factor;
        buckets[vertex] = static_cast<i32>(mixed >> shift);
        ++starts[buckets[vertex]];
    }
    std::partial_sum(starts.begin(), starts.end(), starts.begin());
    for (i32 vertex = static_cast<i32>(grid.size()); vertex-- > 0;) order[--starts[buckets[vertex]]] = vertex;
    std::vector<Edge> chains;
    for (std::size_t bucket = 0; bucket + 1 < starts.size(); ++bucket) {
        const auto begin = order.begin() + starts[bucket], end = order.begin() + starts[bucket + 1];
        if (end - begin < 2) continue;
        // Sorts the whole range by a heap, because that is little code.
        std::partial_sort(begin, end, end, [&](i32 a, i32 b) {
            for (int axis = 0; axis < 3; ++axis) {
                if (grid[a][axis] != grid[b][axis]) return grid[a][axis] < grid[b][axis];
            }
            return a < b;
        });
        for (auto at = begin + 1; at < end; ++at) {
            if (grid[at[-1]] == grid[*at]) chains.push_back({at[-1], *at});
        }
    }
    return chains;
}

class Bisection {
public:
    Bisection(const Graph &graph, std::vector<i32> order)
        : graph_(graph), order_(std::move(order)), near_(graph.vertices()), far_(graph.vertices()),
          visited_(order_.size() + 1), members_(order_.size()) {}

    // still: whether each vertex stands still, or empty; those vertices become the last ones.
    Patches halve(i64 points, std::span<const u8> still, std::vector<Tie> tied = {}) {
        const i64 size = static_cast<i64>(order_.size());
        i64 moving = still.empty() ? size : 0;
        if (!still.empty()) {
            i64 standing = 0;
            for (const i32 vertex : order_) (still[vertex] ? visited_[standing++] : order_[moving++]) = vertex;
            std::copy_n(visited_.begin(), standing, order_.begin() + moving);
        }
        // Continue with a half that has just been made: it is still in the processor's caches.
        std::vector<Set> sets = {{.begin = 0, .end = size}};
        std::vector<i64> waiting = {0};
        if (0 < moving && moving < size) {
            sets = {
                {.begin = 0, .end = size, .halves = 1}, {.begin = 0, .end = moving}, {.begin = moving, .end = size}};
            waiting = {2, 1};
        }
        while (!waiting.empty()) {
            const i64 own = waiting.back(), begin = sets[own].begin, end = sets[own].end;
            waiting.pop_back();
            if (end - begin <= points) continue;
            i32 farthest = sets[own].farthest;
            const i64 middle = begin + cut(begin, end - begin, farthest), first = static_cast<i64>(sets.size());
            sets[own].halves = first;
            sets.push_back({.begin = begin, .end = middle, .farthest = farthest});
            sets.push_back({.begin = middle, .end = end});
            waiting.insert(waiting.end(), {first + 1, first});
        }
        // Nodes are numbered breadth first.
        Patches found;
        std::vector<i64> numbered(sets.size());  // set of each node; the root is the first set
        i64 next = 1;
        for (i64 node = 0; node < next; ++node) {
            const Set &own = sets[numbered[node]];
            found.begins.push_back(own.begin);
            found.children.push_back(own.halves < 0 ? -1 : next);
            if (own.halves < 0) {
                found.node_of.push_back(node);
            } else {
                numbered[next++] = own.halves;
                numbered[next++] = own.halves + 1;
            }
        }
        const std::vector<i64> &begins = found.begins;
        std::sort(found.node_of.begin(), found.node_of.end(), [&](i64 a, i64 b) { return begins[a] < begins[b]; });
        for (const i64 node : found.node_of) found.starts.push_back(begins[node]);
        found.moving = std::lower_bound(found.starts.begin(), found.starts.end(), moving) - found.starts.begin();
        found.starts.push_back(size);
        found.order = std::move(order_);
        found.tied = std::move(tied);
        found.sort_vertices();
        return found;
    }

private:
    struct Set {
        i64 begin, end;     // vertices order_[begin] to order_[end - 1]
        i64 halves = -1;    // index of its first half, which the second follows; -1 for a patch
        i32 farthest = -1;  // the vertex farthest from order_[begin], or -1 if not known
    };

    // Visit all members of a set breadth first, one component after another. The first component begins with `first`,
    // each other one with its first member in the order of `members`. Vertices that are not members must have distances
    // of 0 or more.
    void visit(i32 first, std::span<const i32> members, std::vector<i32> &distance) {
        for (const i32 member : members) distance[member] = -1;
        components_.clear();
        const i64 size = static_cast<i64>(members.size());
        i64 head = 0, tail = 0, next_member = 0;
        while (tail < size) {
            i32 seed = first;
            if (!components_.empty()) {
                while (distance[members[next_member]] >= 0) ++next_member;
                seed = members[next_member];
            }
            components_.push_back(tail);
            distance[seed] = 0;
            visited_[tail++] = seed;
            while (head < tail) {
                const i32 vertex = visited_[head++];
                const i32 farther = distance[vertex] + 1;
                for (const i32 other : graph_.of(vertex)) {
                    const i32 known = distance[other];
                    // Without a branch: whether a neighbour is new is hard for processors to predict.
                    visited_[tail] = other;
                    tail += known < 0;
                    distance[other] = known < 0 ? farther : known;
                }
            }
        }
    }

    // Reorder the vertices of a set, and return the size of its first half. `farthest` is the vertex farthest from the
    // set's first vertex, or -1 if not known; on return, it is that of the first half.
    i64 cut(i64 begin, i64 size, i32 &farthest) {
        const std::span<i32> members(members_.data(), static_cast<std::size_t>(size));
        const auto own = order_.begin() + begin;
        std::copy_n(own, size, members.begin());
        i32 end_a = farthest;
        farthest = -1;
        if (end_a < 0) {
            visit(members[0], members, near_);
            if (components_.size() > 1) {
                const auto off_middle = [&](i64 at) { return size_of(2 * at - size); };
                const i64 best = *std::min_element(components_.begin() + 1, components_.end(),
                                                   [&](i64 a, i64 b) { return off_middle(a) < off_middle(b); });
                std::copy_n(visited_.begin(), size, own);
                return best;
            }
            end_a = visited_[size - 1];
        }
        visit(end_a, members, near_);
        const i32 end_b = visited_[size - 1], span = near_[end_b];
        std::copy_n(visited_.begin(), size, members.begin());
        visit(end_b, members, far_);
        // A counting sort by near - far, which is between -span and span; `members` has the order of the visit from a.
        places_.assign(2 * static_cast<std::size_t>(span) + 2, 0);
        for (const i32 member : members) ++places_[near_[member] - far_[member] + span + 1];
        std::partial_sum(places_.begin(), places_.end(), places_.begin());
        // The first half begins with a. It contains the shortest paths from a to its vertices: no vertex on such a path
        // is closer to b, or visited later. So a visit of this half from a takes its vertices in the same order, as one
        // component, and ends with its last vertex.
        const i64 half = size / 2;
        for (const i32 member : members) {
            const i64 place = places_[near_[member] - far_[member] + span]++;
            own[place] = member;
            if (place < half) farthest = member;
        }
        return half;
    }

    const Graph &graph_;
    std::vector<i32> order_;
    std::vector<i32> near_, far_;  // distances from a and from b [edges]
    std::vector<i32> visited_;     // vertices in the order of the visit; entries beyond the end may be overwritten
    std::vector<i32> members_;
    std::vector<i64> components_;  // for each component, the position of its first vertex in the visit
    std::vector<i64> places_;
};

bool is_tied(std::span<const i32> ties, i32 vertex) { return !ties.empty() && ties[vertex] != vertex; }

std::vector<Tie> list_tied(std::span<const i32> ties) {
    std::vector<Tie> tied;
    for (i32 vertex = 0; vertex < static_cast<i32>(ties.size()); ++vertex) {
        if (is_tied(ties, vertex)) tied.push_back({vertex, ties[vertex]});
    }
    return tied;
}

i64 vertices_of(std::span<const ConnectivityView> objects) {
    i64 vertices = 0;
    for (const ConnectivityView &object : objects) vertices += object.vertices;
    return vertices;
}

}  // namespace

void Patches::sort_vertices() {
    std::vector<i32> patch_of(vertices(), -1), place_of(vertices());
    for (i64 patch = 0; patch < count(); ++patch) {
        i32 place = 0;
        for (const i32 vertex : vertices(patch)) {
            patch_of[vertex] = static_cast<i32>(patch);
            place_of[vertex] = place++;
        }
    }
    ascending.resize(order.size());
    ascending_places.resize(order.size());
    std::vector<i64> next = starts;
    for (i32 vertex = 0; vertex < static_cast<i32>(vertices()); ++vertex) {
        if (patch_of[vertex] < 0) continue;
        const i64 at = next[patch_of[vertex]]++;
        ascending[at] = vertex;
        ascending_places[at] = place_of[vertex];
    }
}

std::shared_ptr<Patches> early_patches(std::span<const ConnectivityView> objects, i64 points,
                                       std::span<const u8> still) {
    const Graph graph(edges_of(objects), vertices_of(objects));
    std::vector<i32> order(graph.vertices());
    std::iota(order.begin(), order.end(), 0);
    if (std::any_of(order.begin(), order.end(), [&](i32 vertex) { return graph.degree(vertex) == 0; })) return {};
    return std::make_shared<Patches>(Bisection(graph, std::move(order)).halve(points, still));
}

std::shared_ptr<Patches> build_patches(std::span<const ConnectivityView> objects, std::span<const GridPoint> grid,
                                       i64 points, std::span<const i32> ties, std::span<const u8> still,
                                       std::shared_ptr<Patches> early) {
    const std::vector<Edge> coincident = coincident_vertices(grid);
    if (early && coincident.empty()) return early;
    std::vector<Edge> edges = edges_of(objects);
    edges.insert(edges.end(), coincident.begin(), coincident.end());
    if (!ties.empty()) {
        for (Edge &edge : edges) edge = {ties[edge.tail], ties[edge.head]};
    }
    const Graph graph(edges, static_cast<i64>(grid.size()));
    std::vector<i32> order, isolated;
    std::vector<GridPoint> places;
    for (i32 vertex = 0; vertex < static_cast<i32>(grid.size()); ++vertex) {
        if (is_tied(ties, vertex)) continue;
        if (graph.degree(vertex) > 0) {
            order.push_back(vertex);
        } else {
            isolated.push_back(vertex);
            places.push_back(grid[vertex]);
        }
    }
    for (const i32 k : z_order(places)) order.push_back(isolated[k]);
    return std::make_shared<Patches>(Bisection(graph, std::move(order)).halve(points, still, list_tied(ties)));
}

Patches cut_curves(std::vector<i32> order, std::vector<i64> starts, i64 points, std::span<const i32> ties,
                   std::span<const u8> still) {
    Patches found;
    found.tied = list_tied(ties);
    i64 moving = static_cast<i64>(order.size());  // number of vertices before those that stand still
    if (!found.tied.empty() || !still.empty()) {
        std::vector<i32> kept;
        std::vector<i64> kept_starts = {0};
        for (const bool is_still : {false, true}) {
            for (std::size_t curve = 0; curve + 1 < starts.size(); ++curve) {
                for (i64 at = starts[curve]; at < starts[curve + 1]; ++at) {
                    const i32 vertex = order[at];
                    const bool is_wanted = (!still.empty() && still[vertex]) == is_still;
                    if (is_wanted && !is_tied(ties, vertex)) kept.push_back(vertex);
                }
                const i64 end = static_cast<i64>(kept.size());
                if (end > kept_starts.back()) kept_starts.push_back(end);
            }
            if (!is_still) moving = static_cast<i64>(kept.size());
        }
        order = std::move(kept);
        starts = std::move(kept_starts);
    }
    for (std::size_t curve = 0; curve + 1 < starts.size(); ++curve) {
        const i64 length = starts[curve + 1] - starts[curve];
        const i64 pieces = length <= points ? 1 : (2 * length + points) / (2 * points);
        for (i64 piece = 0; piece < pieces; ++piece) found.starts.push_back(starts[curve] + piece * length / pieces);
    }
    const i64 count = static_cast<i64>(found.starts.size());
    found.moving = std::lower_bound(found.starts.begin(), found.starts.end(), moving) - found.starts.begin();
    found.starts.push_back(static_cast<i64>(order.size()));
    found.order = std::move(order);
    found.node_of.resize(count);
    // The partition tree halves the list of pieces by their number.
    std::vector<i64> begins(2 * count - 1), ends(2 * count - 1);
    ends[0] = count;
    i64 next = 1;
    for (i64 node = 0; node < next; ++node) {
        const i64 begin = begins[node], end = ends[node];
        found.begins.push_back(found.starts[begin]);
        if (end - begin == 1) {
            found.children.push_back(-1);
            found.node_of[begin] = node;
            continue;
        }
        found.children.push_back(next);
        const bool has_still = node == 0 && 0 < found.moving && found.moving < count;
        const i64 middle = has_still ? found.moving : (begin + end) / 2;
        begins[next] = begin;
        ends[next++] = middle;
        begins[next] = middle;
        ends[next++] = end;
    }
    found.sort_vertices();
    return found;
}

}  // namespace pdeanim
