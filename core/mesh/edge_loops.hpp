// Edge loops: edges that go straight on through vertices where four quads meet.
//
// An edge is named by the smaller of its corners. Pairs of triangles count as quads, and their diagonals as no edges.
#pragma once

#include <span>
#include <vector>

#include "mesh/corner_table.hpp"

namespace pdeanim {

class EdgeLoops {
public:
    // corners: of faces alone; twin: as `twins` gives it; diagonal: as `pair_triangles` gives it.
    EdgeLoops(const CornerTable &corners, std::span<const i32> twin, std::span<const i32> diagonal);

    i32 count() const { return static_cast<i32>(edge_starts_.size()) - 1; }

    // The vertices of a loop from end to end; a closed loop does not repeat its first.
    std::span<const i32> path(i32 loop) const {
        return {path_.data() + path_starts_[loop], path_.data() + path_starts_[loop + 1]};
    }

    // Call `visit` with each loop that lies across a quad from an edge of this one, once for each such edge.
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
    std::vector<i32> edges_, path_;  // of all loops
    std::vector<i32> loop_of_;       // of each edge, or -1
};

}  // namespace pdeanim
