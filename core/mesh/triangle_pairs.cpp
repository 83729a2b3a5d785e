#include "mesh/curves.hpp"

#include <array>
#include <utility>

namespace pdeanim {

namespace {

constexpr i32 inner_quads = 4, border_quads = 2;  // quads at a vertex of a grid, inside and at the border
constexpr i32 most_faces = 2 * inner_quads;       // largest number of faces at a vertex of a triangulated grid
constexpr i32 flat_inside = 6, flat_border = 3;   // triangles at a vertex if all diagonals go one way
// Value of `lacking` for a vertex without a rule; no number of triangles equals it.
constexpr i32 no_rule = -(1 << 24);
constexpr std::size_t trial_pairs = 64;  // number of pairs that are tried to judge a possibility
constexpr i64 clearer = 2;  // ratio of skew from which other pairs are preferred to copies of their neighbours
// Fraction (7 / 8) of a component's vertices that must belong to a grid; otherwise its triangles stay triangles.
constexpr i64 least_regular = 7, of_all = 8;

// Diagonals of pairs in the order in which they are made, and the limit on their number.
struct Log {
    explicit Log(std::size_t most_pairs) : room(most_pairs) {}
    bool is_full() const { return diagonals.size() == room; }

    std::vector<i32> diagonals;
    std::size_t room;
};

// How badly trial pairs fit: number of contradictions to the rules of vertices, skew of the diagonals, and number of
// pairs.
struct Judgement {
    i64 faults = 0, skew = 0, count = 0;
};

class Pairing {
public:
    Pairing(const CornerTable &corners, std::span<const i32> twin, std::span<const GridPoint> cells)
        : mesh_(corners), starts_(corners.polygons.starts), twin_(twin), cells_(cells), faces_(corners.polygons.faces),
          is_triangle_(faces_), waits_(faces_), diagonal_(faces_, -1), queue_(faces_), vertices_(corners.vertices()),
          log_(static_cast<std::size_t>(faces_ / 2 + 1)), trial_(trial_pairs) {}

    std::vector<i32> find() {
        count_what_is_lacking();
        find_pairs();
        drop_what_is_no_grid();
        return std::move(diagonal_);
    }

private:
    struct Vertex {
        i32 lacking = 0;        // number of quads that the vertex lacks; near no_rule if it has no rule
        i32 left = 0;           // number of its triangles that are in no pair
        bool is_flat = false;   // whether it could be in a grid whose diagonals all have one direction
        bool has_rule = false;  // whether it must have as many quads as in a grid
    };

    void count_what_is_lacking() {
        for (i64 face = 0; face < faces_; ++face) {
            const i64 first = starts_[face];
            if (starts_[face + 1] - first != 3) continue;
            const i32 *corner = &mesh_.polygons.vertex[first];
            is_triangle_[face] = corner[0] != corner[1] && corner[1] != corner[2] && corner[2] != corner[0];
        }
        for (i64 v = 0; v < mesh_.vertices(); ++v) {
            const i64 begin = mesh_.fan_starts[v], end = mesh_.fan_starts[v + 1];
            i64 borders = 0;
            i32 triangles = 0;
            bool is_regular = end - begin <= most_faces;
            for (i64 k = begin; k < end; ++k) {
                const i32 corner = mesh_.fan[k];
                if (is_triangle_[mesh_.polygon[corner]]) {
                    ++triangles;
                } else if (mesh_.size[corner] != 4) {
                    is_regular = false;
                }
                for (const i32 edge : {corner, mesh_.previous[corner]}) {
                    if (twin_[edge] >= 0) continue;
                    ++borders;
                    is_regular = is_regular && mesh_.opposite[edge] < 0;
                }
            }
            const bool is_border = borders == 2;
            is_regular = is_regular && (borders == 0 || is_border);
            Vertex &vertex = vertices_[v];
            vertex.left = triangles;
            vertex.has_rule = is_regular && (!is_border || end - begin > border_quads);
            const i32 quads = is_border ? border_quads : inner_quads;
            vertex.lacking = vertex.has_rule ? quads - (static_cast<i32>(end - begin) - triangles) : no_rule;
            vertex.is_flat = is_regular && (is_border ? end - begin <= flat_border : end - begin == flat_inside);
        }
    }

    void find_pairs() {
        // Begin at the border: a triangle at its corner has one possible partner, a triangle along it has two.
        for (int borders = 2; borders >= 0; --borders) {
            for (i64 face = 0; face < faces_; ++face) {
                if (!is_triangle_[face] || diagonal_[face] >= 0) continue;
                const i32 first = static_cast<i32>(starts_[face]);
                if ((twin_[first] < 0) + (twin_[first + 1] < 0) + (twin_[first + 2] < 0) != borders) continue;
                const i32 seed = best_seed(first);
                if (seed < 0) continue;
                log_.diagonals.clear();
                grow(seed, log_, true);
            }
        }
    }

    // Return the two ends of the diagonal of a pair, then the two other vertices.
    std::array<i32, 4> corners_of_pair(i32 diagonal) const {
        return {mesh_.vertex(diagonal), mesh_.vertex(mesh_.next[diagonal]), mesh_.vertex(mesh_.previous[diagonal]),
                mesh_.vertex(mesh_.previous[twin_[diagonal]])};
    }

    // Return whether the edge of this corner of an unpaired triangle can be the diagonal of a pair.
    bool may_pair(i32 corner) const {
        const i32 other = twin_[corner];
        if (other < 0 || !is_triangle_[mesh_.polygon[other]] || diagonal_[mesh_.polygon[other]] >= 0) return false;
        const auto [one, two, tip, far] = corners_of_pair(corner);
        if (tip == far) return false;
        for (const i32 end : {one, two}) {  // not if the triangles at that vertex must all be in different pairs
            if (vertices_[end].left == vertices_[end].lacking) return false;
        }
        for (const i32 end : {tip, far}) {  // not if every triangle at that vertex has its partner there too
            if (vertices_[end].left == i64{2} * vertices_[end].lacking) return false;
        }
        return true;
    }

    // Make a pair with the edge of a corner as its diagonal (sign 1), or undo it (-1).
    void pair(i32 corner, i32 sign) {
        const i32 other = twin_[corner];
        diagonal_[mesh_.polygon[corner]] = sign > 0 ? corner : -1;
        diagonal_[mesh_.polygon[other]] = sign > 0 ? other : -1;
        const std::array<i32, 4> ends = corners_of_pair(corner);
        for (const i32 end : ends) {
            vertices_[end].lacking -= sign;
            vertices_[end].left -= sign;
        }
        vertices_[ends[0]].left -= sign;
        vertices_[ends[1]].left -= sign;
    }

    void enqueue(i32 face) {
        if (!is_triangle_[face] || diagonal_[face] >= 0 || waits_[face]) return;
        waits_[face] = true;
        queue_[tail_] = face;
        tail_ = tail_ + 1 == queue_.size() ? 0 : tail_ + 1;
        ++waiting_;
    }

    i32 dequeue() {
        const i32 face = queue_[head_];
        head_ = head_ + 1 == queue_.size() ? 0 : head_ + 1;
        --waiting_;
        waits_[face] = false;
        return face;
    }

    // Make a pair, and all pairs that follow from it, as long as the log has room.
    void settle(i32 seed, Log &log) {
        i32 corner = seed;
        while (true) {
            if (corner >= 0) {
                pair(corner, 1);
                log.diagonals.push_back(corner);
                if (log.is_full()) break;
                for (const i32 vertex : corners_of_pair(corner)) {
                    if (vertices_[vertex].lacking <= no_rule / 2) continue;
                    for (i64 k = mesh_.fan_starts[vertex]; k < mesh_.fan_starts[vertex + 1]; ++k) {
                        enqueue(mesh_.polygon[mesh_.fan[k]]);
                    }
                }
                for (const i32 edge : {corner, twin_[corner]}) {
                    for (const i32 side : {mesh_.next[edge], mesh_.previous[edge]}) {
                        if (twin_[side] >= 0) enqueue(mesh_.polygon[twin_[side]]);
                    }
                }
            }
            if (waiting_ == 0) break;
            corner = only_diagonal(dequeue());
        }
        while (waiting_ > 0) dequeue();
    }

    // Return the corner of a triangle whose edge is the only possible diagonal; -1 if there are several or none.
    i32 only_diagonal(i32 face) const {
        if (diagonal_[face] >= 0) return -1;
        i32 found = -1;
        for (i32 edge = static_cast<i32>(starts_[face]); edge < starts_[face + 1]; ++edge) {
            if (!may_pair(edge)) continue;
            if (found >= 0) return -1;
            found = edge;
        }
        return found;
    }

    // Make a pair, all that follow, and copies of them next to them, as long as the log has room.
    void grow(i32 seed, Log &log, bool is_careful) {
        settle(seed, log);
        for (std::size_t done = 0; done < log.diagonals.size() && !log.is_full(); ++done) {
            const i32 diagonal = log.diagonals[done];
            for (const i32 edge : {diagonal, twin_[diagonal]}) {
                for (const i32 side : {mesh_.next[edge], mesh_.previous[edge]}) {
                    auto [corner, instead] = copies(side);
                    if (corner < 0 || log.is_full()) continue;
                    if (is_careful && instead >= 0 && is_clearer(instead, corner)) corner = instead;
                    settle(corner, log);
                }
            }
        }
    }

    // Return two possible diagonals of the pair next to a side of a pair: the one parallel to that pair's diagonal, and
    // the other one; -1 for none.
    std::pair<i32, i32> copies(i32 side) const {
        const i32 beside = twin_[side];
        if (beside < 0) return {-1, -1};
        const i32 face = mesh_.polygon[beside];
        if (!is_triangle_[face] || diagonal_[face] >= 0) return {-1, -1};
        const i32 diagonal = diagonal_[mesh_.polygon[side]];
        for (const i32 vertex : corners_of_pair(diagonal)) {
            if (!vertices_[vertex].is_flat) return {-1, -1};
        }
        const i32 tip = mesh_.vertex(mesh_.previous[diagonal]);  // the end of the side that is not on the diagonal
        i32 parallel = -1, instead = -1;
        for (const i32 edge : {mesh_.next[beside], mesh_.previous[beside]}) {
            if (!may_pair(edge)) continue;
            (mesh_.vertex(edge) == tip || mesh_.vertex(mesh_.next[edge]) == tip ? parallel : instead) = edge;
        }
        return {parallel, instead};
    }

    // Judge the trial pairs, and undo them.
    Judgement judge_trial() {
        Judgement found;
        for (const i32 diagonal : trial_.diagonals) {
            const std::array<i32, 4> ends = corners_of_pair(diagonal);
            for (const i32 end : ends) {
                const i64 left = vertices_[end].left, lacking = vertices_[end].lacking;
                found.faults += lacking > no_rule / 2 && (left < lacking || left > 2 * lacking);
            }
            i64 unequal = 0;
            for (int axis = 0; axis < 3; ++axis) {
                const i64 along = cells_[ends[0]][axis] - cells_[ends[1]][axis];
                const i64 across = cells_[ends[2]][axis] - cells_[ends[3]][axis];
                unequal += along * along - across * across;
            }
            found.skew += size_of(unequal);
        }
        found.count = static_cast<i64>(trial_.diagonals.size());
        for (const i32 diagonal : trial_.diagonals) pair(diagonal, -1);
        trial_.diagonals.clear();
        return found;
    }

    // Return whether the pairs that follow from one diagonal form a grid more clearly than those from another.
    bool is_clearer(i32 corner, i32 other) {
        settle(corner, trial_);
        const Judgement one = judge_trial();
        settle(other, trial_);
        const Judgement two = judge_trial();
        return one.faults <= two.faults && clearer * one.skew * two.count < two.skew * one.count;
    }

    // Return the diagonal of a triangle from which the best pairs grow; -1 if there is none. first: the first corner of
    // the triangle.
    i32 best_seed(i32 first) {
        std::array<i32, 3> ways;
        int count = 0;
        for (i32 corner = first; corner < first + 3; ++corner) {
            if (may_pair(corner)) ways[count++] = corner;
        }
        if (count < 2) return count ? ways[0] : -1;
        i32 seed = -1;
        Judgement best;
        for (int way = 0; way < count; ++way) {
            grow(ways[way], trial_, false);
            const Judgement found = judge_trial();
            const i64 more = best.skew * found.count - found.skew * best.count;
            if (seed < 0 || found.faults < best.faults ||
                (found.faults == best.faults && (more > 0 || (more == 0 && found.count > best.count)))) {
                seed = ways[way];
                best = found;
            }
        }
        return seed;
    }

    // Undo the pairs of components in which too few vertices belong to a grid.
    void drop_what_is_no_grid() {
        const i64 vertices = mesh_.vertices();
        std::vector<i32> root(vertices);
        for (i32 v = 0; v < vertices; ++v) root[v] = v;
        const auto root_of = [&](i32 v) {
            while (root[v] != v) v = root[v] = root[root[v]];
            return v;
        };
        for (i32 corner = 0; corner < static_cast<i32>(mesh_.next.size()); ++corner) {
            const i32 one = root_of(mesh_.vertex(corner)), other = root_of(mesh_.vertex(mesh_.next[corner]));
            root[most(one, other)] = least(one, other);
        }
        std::vector<i32> every(vertices), regular(vertices);
        for (i32 v = 0; v < vertices;
             ++v) {  // a root is the smallest vertex of its component and comes before the others
            root[v] = root[root[v]];
            const i64 faces = mesh_.fan_starts[v + 1] - mesh_.fan_starts[v];
            if (faces == 0) continue;
            ++every[root[v]];
            const Vertex &vertex = vertices_[v];
            const bool is_met = vertex.has_rule ? vertex.lacking == 0 : faces <= border_quads;
            regular[root[v]] += is_met && vertex.left == 0;
        }
        for (i64 face = 0; face < faces_; ++face) {
            if (diagonal_[face] < 0) continue;
            const i32 component = root[mesh_.polygons.vertex[starts_[face]]];
            if (of_all * regular[component] < least_regular * every[component]) diagonal_[face] = -1;
        }
    }

    const CornerTable &mesh_;
    const std::vector<i64> &starts_;
    std::span<const i32> twin_;
    std::span<const GridPoint> cells_;
    i64 faces_;
    std::vector<bool> is_triangle_;  // whether a face has three corners at three different vertices
    std::vector<bool> waits_;        // whether a triangle is in the queue
    std::vector<i32> diagonal_;      // diagonals of the pairs found so far
    std::vector<i32> queue_;         // triangles to check again, in a ring buffer
    std::size_t head_ = 0, tail_ = 0, waiting_ = 0;
    std::vector<Vertex> vertices_;
    Log log_, trial_;  // pairs that are made for good, and trial pairs
};

}  // namespace

std::vector<i32> twins(const CornerTable &corners) {
    std::vector<i32> twin(corners.next.size(), -1);
    for (std::size_t corner = 0; corner < twin.size(); ++corner) {
        const i32 other = corners.opposite[corner];
        if (other >= 0 && corners.opposite[other] == static_cast<i32>(corner) &&
            corners.polygon[other] != corners.polygon[corner]) {
            twin[corner] = other;
        }
    }
    return twin;
}

std::vector<i32> pair_triangles(const CornerTable &corners, std::span<const i32> twin,
                                std::span<const GridPoint> cells) {
    return Pairing(corners, twin, cells).find();
}

}  // namespace pdeanim
