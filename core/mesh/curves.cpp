#include "mesh/curves.hpp"

#include <algorithm>
#include <numeric>
#include <span>
#include <utility>
#include <vector>

#include "mesh/corner_table.hpp"
#include "mesh/graph.hpp"

namespace pdeanim {

namespace {

// Edge loops: edges that go straight on through vertices where four quads meet.
//
// An edge is identified by the smaller of its corners. Pairs of triangles count as quads, and their diagonals are no
// edges.
class EdgeLoops {
public:
    // corners: of faces only; twin: from `twins`; diagonal: from `pair_triangles`.
    EdgeLoops(const CornerTable &corners, std::span<const i32> twin, std::span<const i32> diagonal);

    i32 count() const { return static_cast<i32>(edge_starts_.size()) - 1; }

    // Return the vertices of a loop from end to end; a closed loop does not repeat its first vertex.
    std::span<const i32> path(i32 loop) const {
        return {path_.data() + path_starts_[loop], path_.data() + path_starts_[loop + 1]};
    }

    // Call visit(other loop) for each edge that lies across a quad from an edge of this loop.
    template <class Visit> void for_each_beside(i32 loop, Visit visit) const {
        for (i64 k = edge_starts_[loop]; k < edge_starts_[loop + 1]; ++k) {
            for (const i32 side : {edges_[k], twin_[edges_[k]]}) {
                const i32 across = side >= 0 ? opposite_edge(side) : -1;
                if (across >= 0 && loop_of_[across] >= 0) visit(loop_of_[across]);
            }
        }
    }

private:
    i32 edge_of(i32 corner) const { return twin_[corner] >= 0 ? least(corner, twin_[corner]) : corner; }
    i32 other_end(i32 edge, i32 vertex) const;
    i32 turn(i32 corner, i32 vertex) const;
    i32 straight_on(i32 corner, i32 vertex) const;
    i32 opposite_edge(i32 corner) const;
    void walk_from(i32 first);

    const CornerTable &mesh_;
    std::span<const i32> twin_, diagonal_;
    std::vector<i64> edge_starts_ = {0}, path_starts_ = {0};
    std::vector<i32> edges_, path_;  // edges of all loops, and vertices of their paths
    std::vector<i32> loop_of_;       // the loop of each edge, or -1
};

EdgeLoops::EdgeLoops(const CornerTable &corners, std::span<const i32> twin, std::span<const i32> diagonal)
    : mesh_(corners), twin_(twin), diagonal_(diagonal), loop_of_(corners.next.size(), -1) {
    for (i32 corner = 0; corner < static_cast<i32>(loop_of_.size()); ++corner) {
        const bool is_edge = edge_of(corner) == corner && diagonal_[mesh_.polygon[corner]] != corner;
        if (is_edge && loop_of_[corner] < 0 && mesh_.vertex(corner) != mesh_.vertex(mesh_.next[corner])) {
            walk_from(corner);
        }
    }
}

void EdgeLoops::walk_from(i32 first) {
    // Go back to one end of the loop, or all the way round.
    i32 edge = first, vertex = mesh_.vertex(first);
    while (true) {
        const i32 onward = straight_on(edge, vertex);
        if (onward < 0 || onward == first) break;
        edge = onward;
        vertex = other_end(edge, vertex);
    }
    // Go forward from there.
    const i32 begin = edge;
    path_.push_back(vertex);
    while (true) {
        loop_of_[edge] = count();
        edges_.push_back(edge);
        vertex = other_end(edge, vertex);
        edge = straight_on(edge, vertex);
        if (edge == begin) break;
        path_.push_back(vertex);
        if (edge < 0) break;
    }
    path_starts_.push_back(static_cast<i64>(path_.size()));
    edge_starts_.push_back(static_cast<i64>(edges_.size()));
}

i32 EdgeLoops::other_end(i32 edge, i32 vertex) const {
    const i32 tail = mesh_.vertex(edge);
    return tail != vertex ? tail : mesh_.vertex(mesh_.next[edge]);
}

// Return the corner of the face's other edge at a vertex; a pair of triangles counts as one face.
i32 EdgeLoops::turn(i32 corner, i32 vertex) const {
    for (int step = 0; step < 2; ++step) {
        corner = mesh_.vertex(corner) == vertex ? mesh_.previous[corner] : mesh_.next[corner];
        if (diagonal_[mesh_.polygon[corner]] != corner) break;
        corner = twin_[corner];
    }
    return corner;
}

// Return the edge straight on beyond a vertex: there are two faces between the edges on either side, or both are on the
// border; -1 if there is none.
i32 EdgeLoops::straight_on(i32 corner, i32 vertex) const {
    i32 here = turn(corner, vertex);
    if (twin_[here] < 0) return -1;
    here = turn(twin_[here], vertex);
    if (twin_[corner] < 0) {
        const bool is_border =
            twin_[here] < 0 && here != corner && mesh_.vertex(here) != mesh_.vertex(mesh_.next[here]);
        return is_border ? here : -1;
    }
    i32 there = turn(twin_[corner], vertex);
    if (twin_[there] < 0) return -1;
    there = turn(twin_[there], vertex);
    const i32 edge = edge_of(here);
    return twin_[here] == there && edge != edge_of(corner) ? edge : -1;
}

// Return the edge opposite a corner's edge in its quad; -1 for other faces.
i32 EdgeLoops::opposite_edge(i32 corner) const {
    if (mesh_.size[corner] == 4) return edge_of(mesh_.next[mesh_.next[corner]]);
    const i32 across = diagonal_[mesh_.polygon[corner]];
    if (across < 0) return -1;
    // The vertex where edge and diagonal meet is not on the opposite edge.
    const i32 meet = other_end(corner, mesh_.vertex(mesh_.previous[across]));
    const i32 other = mesh_.next[twin_[across]];
    const bool is_there = meet == mesh_.vertex(other) || meet == mesh_.vertex(mesh_.next[other]);
    return edge_of(is_there ? mesh_.previous[twin_[across]] : other);
}

// Runs of free vertices along an edge loop that are shorter than 2 to this power are left to the path cover, which
// makes longer curves of them. The second is the limit for an object without longer loops.
constexpr int least_bits_of_run = 3, least_bits_of_loop = 2;

void add_polylines(const ConnectivityView &object, CurveCover &cover) {
    std::size_t first = 0;
    for (const i32 size : object.line_sizes) {
        if (size >= 3) cover.add_free_runs(object.line_indices.subspan(first, size), 1);
        first += size;
    }
}

// Make curves of the edge loops that have long enough runs of free vertices: the longest loop first, then the loops
// next to it, side by side, then the next longest.
void sweep_loops(const EdgeLoops &loops, const std::vector<i32> &by_length, i64 shortest, CurveCover &cover) {
    std::vector<bool> is_queued(loops.count());
    std::vector<i32> queue;
    const auto enqueue = [&](i32 loop) {
        if (is_queued[loop]) return;
        is_queued[loop] = true;
        queue.push_back(loop);
    };
    for (const i32 longest : by_length) {
        queue.clear();
        enqueue(longest);
        for (std::size_t head = 0; head < queue.size(); ++head) {
            const i32 loop = queue[head];
            if (cover.add_free_runs(loops.path(loop), shortest)) loops.for_each_beside(loop, enqueue);
        }
    }
}

void add_edge_loops(const ConnectivityView &object, std::span<const GridPoint> points, CurveCover &cover) {
    Polygons faces;
    faces.starts.reserve(object.face_sizes.size() + 1);
    for (const i32 size : object.face_sizes) faces.starts.push_back(faces.starts.back() + size);
    faces.vertex.assign(object.face_indices.begin(), object.face_indices.end());
    faces.faces = static_cast<i64>(object.face_sizes.size());
    faces.vertices = object.vertices;
    const CornerTable corners(std::move(faces));
    const std::vector<i32> twin = twins(corners);
    const std::vector<i32> diagonal = pair_triangles(corners, twin, cells_in_box(points));
    const EdgeLoops loops(corners, twin, diagonal);
    std::vector<i32> by_length(loops.count());
    std::iota(by_length.begin(), by_length.end(), 0);
    const auto length = [&](i32 loop) { return loops.path(loop).size(); };
    std::stable_sort(by_length.begin(), by_length.end(), [&](i32 a, i32 b) { return length(a) > length(b); });
    const i64 longest = by_length.empty() ? 0 : static_cast<i64>(length(by_length[0]));
    const int most_bits = most(bit_length(longest) - 1, least_bits_of_loop);
    for (int bits = most_bits; bits >= least(most_bits, least_bits_of_run); --bits) {
        sweep_loops(loops, by_length, i64{1} << bits, cover);
    }
}

void add_isolated_vertices(std::span<const GridPoint> points, CurveCover &cover) {
    std::vector<i32> isolated;
    std::vector<GridPoint> places;
    for (i32 v = 0; v < static_cast<i32>(points.size()); ++v) {
        if (cover.is_taken[v]) continue;
        isolated.push_back(v);
        places.push_back(points[v]);
    }
    if (isolated.empty()) return;
    for (const i32 k : z_order(places)) cover.order.push_back(isolated[k]);
    cover.starts.push_back(static_cast<i64>(cover.order.size()));
}

}  // namespace

Curves extract_curves(std::span<const ConnectivityView> objects, std::span<const GridPoint> reference) {
    Curves found;
    i32 first = 0;
    for (const ConnectivityView &object : objects) {
        const std::span<const GridPoint> points = reference.subspan(first, object.vertices);
        CurveCover cover(object.vertices);
        add_polylines(object, cover);
        if (!object.face_sizes.empty()) add_edge_loops(object, points, cover);
        cover.add_paths(Graph(edges_of({&object, 1}), object.vertices));
        add_isolated_vertices(points, cover);
        for (const i32 vertex : cover.order) found.order.push_back(first + vertex);
        for (std::size_t c = 1; c < cover.starts.size(); ++c) found.starts.push_back(first + cover.starts[c]);
        first += static_cast<i32>(object.vertices);
    }
    return found;
}

}  // namespace pdeanim
