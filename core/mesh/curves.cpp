#include "mesh/curves.hpp"

#include <algorithm>
#include <numeric>
#include <utility>

#include "mesh/corner_table.hpp"
#include "mesh/edge_loops.hpp"
#include "mesh/graph.hpp"
#include "mesh/path_cover.hpp"
#include "mesh/triangle_pairs.hpp"

namespace pdeanim {

namespace {

// Free runs of an edge loop of fewer vertices than 2 to this power are left to the path cover, which makes longer
// curves of them; and the same in an object that has no longer loops.
constexpr int least_bits_of_run = 3, least_bits_of_loop = 2;

void add_polylines(const ConnectivityView &object, CurveCover &cover) {
    std::size_t first = 0;
    for (const i32 size : object.line_sizes) {
        if (size >= 3) cover.add_free_runs(object.line_indices.subspan(first, size), 1);
        first += size;
    }
}

// Take edge loops with free runs of some length: the longest first, then those beside it, side by side, then the next
// longest.
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
