#include "sections/reference/reference.hpp"

#include <algorithm>
#include <numeric>
#include <optional>

#include "base/errors.hpp"
#include "sections/reference/point_model.hpp"
#include "sections/reference/term_weights.hpp"
#include "sections/reference/welds.hpp"

namespace pdeanim {

namespace {

// Point of each vertex, numbered as the corners and then the other vertices meet them; empty if none is shared.
std::vector<i32> shared_points(const Polygons &mesh, std::span<const Vector> grid) {
    const i64 vertices = static_cast<i64>(grid.size());
    std::vector<i32> by_place(vertices), place(vertices);
    std::iota(by_place.begin(), by_place.end(), 0);
    std::sort(by_place.begin(), by_place.end(), [&](i32 a, i32 b) { return grid[a] < grid[b]; });
    i32 places = 0;
    for (i64 k = 0; k < vertices; ++k) {
        if (k > 0 && grid[by_place[k]] != grid[by_place[k - 1]]) ++places;
        place[by_place[k]] = places;
    }
    if (vertices == 0 || places + 1 == vertices) return {};
    std::vector<i32> number(places + 1, -1), point_of(vertices);
    i32 points = 0;
    const auto meet = [&](i64 vertex) {
        if (number[place[vertex]] < 0) number[place[vertex]] = points++;
    };
    for (const i32 vertex : mesh.vertex) meet(vertex);
    for (i64 vertex = 0; vertex < vertices; ++vertex) meet(vertex);
    for (i64 vertex = 0; vertex < vertices; ++vertex) point_of[vertex] = number[place[vertex]];
    return point_of;
}

Polygons welded(Polygons mesh, const std::vector<i32> &point_of, i64 points) {
    for (i32 &vertex : mesh.vertex) vertex = point_of[vertex];
    mesh.vertices = points;
    return mesh;
}

// A surface that is predicted across: the mesh, or the mesh with its welds, which are coded first.
struct Surface {
    Surface(const Polygons &mesh, std::span<const Vector> grid, const std::vector<i32> *point_of)
        : points(grid.begin(), grid.end()) {
        if (point_of) {
            std::vector<i32> coded = *point_of;
            const i64 count = code_welds(coder, CornerTable(mesh), coded);
            points.resize(count);
            for (std::size_t vertex = 0; vertex < grid.size(); ++vertex) points[(*point_of)[vertex]] = grid[vertex];
            corners.emplace(welded(mesh, *point_of, count));
        } else {
            corners.emplace(mesh);
        }
        order = prediction_order(*corners);
        Predictor seen(*corners, points);
        weights = choose_term_weights(order, seen);
    }

    std::vector<u8> encode(bool matches) const {
        RangeCoder<Mode::encode> after = coder;
        Predictor predictor(*corners, points);
        PointModel model(matches);
        TermWeights coded = weights;
        model.code_weights(after, coded);
        model.code(after, order, weights, predictor);
        return after.finish();
    }

    RangeCoder<Mode::encode> coder;
    std::vector<Vector> points;
    std::optional<CornerTable> corners;
    std::vector<i32> order;
    TermWeights weights;
};

}  // namespace

CodedReference encode_reference(const Polygons &mesh, std::span<const Vector> grid) {
    const std::vector<i32> point_of = shared_points(mesh, grid);
    std::optional<Surface> best_surface(std::in_place, mesh, grid, nullptr);
    CodedReference best{0, best_surface->encode(false)};
    const auto try_also = [&](u8 kind, const Surface &surface) {
        std::vector<u8> data = surface.encode(kind & matches_residuals);
        if (data.size() >= best.data.size()) return false;
        best = {kind, std::move(data)};
        return true;
    };
    if (!point_of.empty()) {
        Surface welds(mesh, grid, &point_of);
        if (try_also(welds_points, welds)) best_surface.emplace(std::move(welds));
    }
    try_also(best.kind | matches_residuals, *best_surface);
    return best;
}

std::vector<Vector> decode_reference(Polygons mesh, u8 kind, std::span<const u8> data) {
    RangeCoder<Mode::decode> coder(data);
    const bool is_welded = kind & welds_points;
    const i64 vertices = mesh.vertices;
    i64 points = vertices;
    std::vector<i32> point_of;
    if (is_welded) {
        point_of.resize(vertices);
        points = code_welds(coder, CornerTable(mesh), point_of);
        mesh = welded(std::move(mesh), point_of, points);
    }
    const CornerTable corners(std::move(mesh));
    PointModel model(kind & matches_residuals);
    TermWeights weights{};
    model.code_weights(coder, weights);
    Predictor predictor(corners, std::vector<Vector>(points));
    model.code(coder, prediction_order(corners), weights, predictor);
    if (!coder.is_finished()) {
        throw CorruptError("section REST does not end where its numbers do; get the file again");
    }
    if (!is_welded) return std::move(predictor.grid);
    std::vector<Vector> grid(vertices);
    for (i64 vertex = 0; vertex < vertices; ++vertex) grid[vertex] = predictor.grid[point_of[vertex]];
    return grid;
}

}  // namespace pdeanim
