#include "mesh/edge_loops.hpp"

namespace pdeanim {

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
    // Back to one end, or all the way round.
    i32 edge = first, vertex = mesh_.vertex(first);
    while (true) {
        const i32 onward = straight_on(edge, vertex);
        if (onward < 0 || onward == first) break;
        edge = onward;
        vertex = other_end(edge, vertex);
    }
    // Forward from there.
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

// The corner of the other edge at a vertex of the corner's face; the triangles of a pair are one face.
i32 EdgeLoops::turn(i32 corner, i32 vertex) const {
    for (int step = 0; step < 2; ++step) {
        corner = mesh_.vertex(corner) == vertex ? mesh_.previous[corner] : mesh_.next[corner];
        if (diagonal_[mesh_.polygon[corner]] != corner) break;
        corner = twin_[corner];
    }
    return corner;
}

// The edge straight on over a vertex: two faces away on either side, on the border on the one; -1 for none.
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

// The edge opposite a corner's edge in its quad; -1 in other faces.
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

}  // namespace pdeanim
