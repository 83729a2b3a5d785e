#include "sections/reference/reference.hpp"

#include <algorithm>
#include <numeric>
#include <optional>
#include <vector>

#include "base/errors.hpp"
#include "entropy/range_coder.hpp"
#include "mesh/corner_table.hpp"
#include "sections/reference/point_model.hpp"

namespace pdeanim {

namespace {

// Welds: coincident vertices. Welding turns seams and loose polygons into connected surfaces again.
//
// Vertices are visited polygon by polygon, then the remaining ones. For each vertex, it is coded whether it lies on a
// known point, and on which: the first candidates are the points that would close a gap in the surface, then the latest
// points.

constexpr int most_followed = 16;  // corners of a point that are examined, even if all vertices lie on one point
constexpr int most_recent = 64;    // latest corners that are examined
constexpr int most_digits = 31;    // digits of the difference of two point numbers
constexpr int places = 4, ranks = 8;
constexpr int histories = 16;  // whether each of the last four vertices lay on a known point
// Largest numbers of sets of tied vertices per point: that are examined, and that have their own models.
constexpr int most_classes = 16, class_turns = 4;

template <Mode mode> class WeldCoder {
public:
    // ties: one entry per vertex, or empty if no ties are coded. When decoding, the entries are overwritten.
    WeldCoder(RangeCoder<mode> &coder, const CornerTable &corners, std::vector<i32> &point_of, std::vector<i32> &ties)
        : coder_(coder), corners_(corners), point_of_(point_of), ties_(ties), is_met_(point_of.size()),
          latest_(point_of.size(), -1), earlier_(corners.fan.size()), edge_met_(corners.fan.size()),
          tried_(point_of.size(), -1), within_(point_of.size(), -1), latest_class_(ties.size(), -1),
          earlier_class_(ties.size(), -1) {}

    i64 code() {
        const std::vector<i64> &starts = corners_.polygons.starts;
        for (i64 polygon = 0; polygon + 1 < static_cast<i64>(starts.size()); ++polygon) {
            const i32 first = static_cast<i32>(starts[polygon]), end = static_cast<i32>(starts[polygon + 1]);
            for (i32 corner = first; corner < end; ++corner) {
                const i32 vertex = corners_.vertex(corner);
                if (!is_met_[vertex]) {
                    is_met_[vertex] = true;
                    int context = least(corner - first, places - 1) * 4;
                    if (corner > first) {
                        context += latest_[point_at(corner - 1)] >= 0 ? 2 : 0;
                        context += latest_[point_at(first)] >= 0 ? 1 : 0;
                    }
                    if (code_is_old(old_[context + history_ * 4 * places], vertex)) {
                        point_of_[vertex] = code_point(corner);
                    }
                    if (!ties_.empty()) code_tie(vertex);
                }
                within_[point_of_[vertex]] = static_cast<i32>(polygon);
            }
            enter_polygon(first, end);
        }
        for (i64 vertex = 0; vertex < static_cast<i64>(point_of_.size()); ++vertex) {
            if (is_met_[vertex]) continue;
            if (code_is_old(isolated_[history_], vertex)) {
                const i64 point = points_ - code_distance(points_ - point_of_[vertex]);
                if (point < 0) broken();
                point_of_[vertex] = static_cast<i32>(point);
            }
            if (!ties_.empty()) code_tie(static_cast<i32>(vertex));
        }
        return points_;
    }

private:
    enum Way { before, after, recent };

    [[noreturn]] void broken() const {
        throw CorruptError(Section("REST"), "welds a vertex to a missing point; get the file again");
    }

    i32 point_at(i32 corner) const { return point_of_[corners_.vertex(corner)]; }

    // Code whether a vertex lies on a known point. If not, the vertex gets a new point.
    bool code_is_old(BitModel &model, i64 vertex) {
        const bool is_old = coder_.bit(model, point_of_[vertex] < points_);
        history_ = (2 * history_ + is_old) % histories;
        if (!is_old) point_of_[vertex] = static_cast<i32>(points_++);
        return is_old;
    }

    // Code which of the point's earlier vertices a vertex is tied to. When decoding, `ties_` gets the vertex of that
    // set that was visited first.
    void code_tie(i32 vertex) {
        i32 &latest = latest_class_[point_of_[vertex]];
        int turn = 0;
        for (i32 other = latest; other >= 0 && turn < most_classes; other = earlier_class_[other], ++turn) {
            BitModel &model = tied_[least(turn, class_turns - 1) * histories + tie_history_];
            const bool is_tied = coder_.bit(model, mode != Mode::decode && ties_[other] == ties_[vertex]);
            tie_history_ = (2 * tie_history_ + is_tied) % histories;
            if (!is_tied) continue;
            if (mode == Mode::decode) ties_[vertex] = other;
            return;
        }
        if (mode == Mode::decode) ties_[vertex] = vertex;
        earlier_class_[vertex] = latest;
        latest = vertex;
    }

    // Code a number of 1 or more: its number of digits, then the digits after the leading one.
    i64 code_distance(i64 distance) {
        const int wanted = bit_length(distance);
        int digits = 1;
        while (digits < most_digits && coder_.bit(digits_[digits], wanted > digits)) ++digits;
        i64 value = 1;
        for (int digit = digits - 2; digit >= 0; --digit) value = 2 * value + coder_.bypass((distance >> digit) & 1);
        return value;
    }

    // Code which known point a corner lies on.
    i32 code_point(i32 corner) {
        const i32 polygon = corners_.polygon[corner];
        const i32 first = static_cast<i32>(corners_.polygons.starts[polygon]);
        const i32 last = static_cast<i32>(corners_.polygons.starts[polygon + 1]) - 1;
        const i32 point = point_at(corner);
        const int place = least(corner - first, places - 1) * 2 + (corner == last ? 1 : 0);
        for (const Way way : {before, after, recent}) {
            i32 other = corner - 1;
            if (way != recent) {
                if (corner == first) continue;
                other = latest_[point_at(way == before ? corner - 1 : first)];
            }
            int rank = 0;
            for (int turn = 0; turn < (way == recent ? most_recent : most_followed) && other >= 0; ++turn) {
                const i32 there = way == before  ? corners_.previous[other]
                                  : way == after ? corners_.next[other]
                                                 : other;
                const bool is_gap = way == recent || !edge_met_[way == before ? there : other];
                const i32 candidate = point_at(there);
                if (is_gap && tried_[candidate] != corner && within_[candidate] != polygon) {
                    tried_[candidate] = corner;
                    BitModel &model = candidates_[(way * ranks + least(rank, ranks - 1)) * 2 * places + place];
                    if (coder_.bit(model, candidate == point)) return candidate;
                    ++rank;
                }
                other = way == recent ? other - 1 : earlier_[other];
            }
        }
        const i64 found = points_ - code_distance(points_ - point);
        if (found < 0) broken();
        return static_cast<i32>(found);
    }

    // Record which edges of a polygon are shared, and add its corners to the lists of their points.
    void enter_polygon(i32 first, i32 end) {
        for (i32 corner = first; corner < end; ++corner) {
            const i32 following = point_at(corners_.next[corner]);
            i32 other = latest_[point_at(corner)];
            for (int turn = 0; turn < most_followed && other >= 0; ++turn) {
                const i32 edge = corners_.previous[other];
                if (point_at(edge) == following && !edge_met_[edge]) {
                    edge_met_[edge] = edge_met_[corner] = true;
                    break;
                }
                other = earlier_[other];
            }
        }
        for (i32 corner = first; corner < end; ++corner) {
            i32 &latest = latest_[point_at(corner)];
            earlier_[corner] = latest;
            latest = corner;
        }
    }

    RangeCoder<mode> &coder_;
    const CornerTable &corners_;
    std::vector<i32> &point_of_, &ties_;
    std::vector<bool> is_met_;
    std::vector<i32> latest_;     // the latest corner at each point, or -1
    std::vector<i32> earlier_;    // for each corner, the previous one at the same point
    std::vector<bool> edge_met_;  // whether another polygon has the edge from each corner, in the other direction
    // For each point, the last corner that tried it, and the last polygon that has it.
    std::vector<i32> tried_, within_;
    // Sets of tied vertices, named by the vertex visited first: the latest set at each point, and for each set the one
    // before.
    std::vector<i32> latest_class_, earlier_class_;
    i64 points_ = 0;
    int history_ = 0, tie_history_ = 0;
    std::array<BitModel, histories * places * 4> old_;
    std::array<BitModel, class_turns * histories> tied_;
    std::array<BitModel, histories> isolated_;
    std::array<BitModel, 3 * ranks * places * 2> candidates_;
    std::array<BitModel, most_digits + 1> digits_;
};

// Code the point of each vertex, with points numbered in the order of visits; and the tie of each vertex unless `ties`
// is empty. Both are read when encoding, written when decoding. Return the number of points. CorruptError if a point is
// unknown.
template <Mode mode> i64 code_welds(RangeCoder<mode> &coder, const CornerTable &corners, std::vector<i32> &point_of,
                                    std::vector<i32> &ties) {
    return WeldCoder<mode>(coder, corners, point_of, ties).code();
}

// Name each set of tied vertices by its vertex of lowest index instead of the one visited first.
void name_ties(std::vector<i32> &ties) {
    std::vector<i32> first(ties.size(), -1);
    for (i32 vertex = 0; vertex < static_cast<i32>(ties.size()); ++vertex) {
        i32 &named = first[ties[vertex]];
        if (named < 0) named = vertex;
        ties[vertex] = named;
    }
}

// Return the point of each vertex, with points numbered in the order in which the corners and then the other vertices
// visit them; empty if no two vertices share a point. Tied vertices share a point. A point has at most as many sets of
// tied vertices as are examined.
template <class Place> std::vector<i32> shared_points(const Polygons &mesh, std::span<const Place> grid, Ties ties) {
    const i64 vertices = static_cast<i64>(grid.size());
    const auto tie_of = [&](i32 vertex) { return ties.empty() ? 0 : ties[vertex]; };
    std::vector<i32> by_place(vertices), place(vertices);
    std::iota(by_place.begin(), by_place.end(), 0);
    std::sort(by_place.begin(), by_place.end(),
              [&](i32 a, i32 b) { return grid[a] != grid[b] ? grid[a] < grid[b] : tie_of(a) < tie_of(b); });
    i32 places = 0, classes = 1;
    for (i64 k = 1; k < vertices; ++k) {
        const i32 before = by_place[k - 1], own = by_place[k];
        if (tie_of(own) != tie_of(before)) ++classes;
        if (grid[own] != grid[before] || classes > most_classes) {
            ++places;
            classes = 1;
        }
        place[own] = places;
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

// The surface over which positions are predicted: the mesh, or the welded mesh, whose welds are then coded first.
struct Surface {
    Surface(const Polygons &mesh, std::span<const Vector> grid, const std::vector<i32> *point_of, Ties ties = {})
        : points(grid.begin(), grid.end()) {
        if (point_of) {
            std::vector<i32> coded = *point_of, coded_ties(ties.begin(), ties.end());
            const i64 count = code_welds(coder, CornerTable(mesh), coded, coded_ties);
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

    std::vector<u8> encode(bool matches, const Smoothing *smoothing) const {
        RangeCoder<Mode::encode> after = coder;
        Predictor predictor(*corners, points);
        PointModel model(matches);
        TermWeights coded = weights;
        model.code_weights(after, coded);
        if (smoothing) {
            SmoothingWeights of_smoothing = smoothing->weights;
            model.code_weights(after, of_smoothing);
        }
        model.code(after, order, weights, predictor);
        return after.finish();
    }

    RangeCoder<Mode::encode> coder;
    std::vector<Vector> points;
    std::optional<CornerTable> corners;
    std::vector<i32> order;
    TermWeights weights;
};

// Return for each point the data of a vertex that lies on it.
template <class Place>
std::vector<Place> at_points(std::span<const Place> places, const std::vector<i32> &point_of, i64 points) {
    std::vector<Place> found(points);
    for (std::size_t vertex = 0; vertex < places.size(); ++vertex) found[point_of[vertex]] = places[vertex];
    return found;
}

std::vector<Vector> at_vertices(std::span<const Vector> points, const std::vector<i32> &point_of) {
    std::vector<Vector> found(point_of.size());
    for (std::size_t vertex = 0; vertex < found.size(); ++vertex) found[vertex] = points[point_of[vertex]];
    return found;
}

}  // namespace

std::optional<Smoothing> smooth_reference(const Polygons &mesh, std::span<const Vector> grid,
                                          std::span<const std::array<double, 3>> wanted, Ties ties) {
    std::vector<i32> point_of = shared_points(mesh, wanted, ties);
    const bool is_welded = !point_of.empty();
    std::vector<Vector> points(grid.begin(), grid.end());
    std::vector<std::array<double, 3>> of_points(wanted.begin(), wanted.end());
    if (is_welded) {
        const i64 count = 1 + *std::max_element(point_of.begin(), point_of.end());
        points = at_points(grid, point_of, count);
        of_points = at_points(wanted, point_of, count);
    }
    const CornerTable corners(is_welded ? welded(mesh, point_of, static_cast<i64>(points.size())) : mesh);
    const std::optional<FittedSmoothing> fitted = fit_smoothing(corners, points, of_points);
    if (!fitted) return std::nullopt;
    std::vector<Vector> found = smoothed(corners, points, fitted->weights);
    if (is_welded) found = at_vertices(found, point_of);
    return Smoothing{fitted->weights, std::move(point_of), std::move(found), fitted->error_ratio};
}

CodedReference encode_reference(const Polygons &mesh, std::span<const Vector> grid, const Smoothing *smoothing,
                                Ties ties) {
    const std::vector<i32> point_of = smoothing ? smoothing->point_of : shared_points(mesh, grid, ties);
    // Welds are needed for smoothing, which works across them, and for ties, which join vertices of one point.
    const bool must_weld = (smoothing || !ties.empty()) && !point_of.empty();
    const u8 always = static_cast<u8>((smoothing ? smooths_points : 0) | (ties.empty() ? 0 : ties_vertices));
    CodedReference best{0, {}};
    std::optional<Surface> best_surface;
    const auto try_also = [&](u8 kind, const Surface &surface) {
        std::vector<u8> data = surface.encode(kind & matches_residuals, smoothing);
        if (!best.data.empty() && data.size() >= best.data.size()) return false;
        best = {kind, std::move(data)};
        return true;
    };
    if (!must_weld) try_also(always, best_surface.emplace(mesh, grid, nullptr));
    if (!point_of.empty()) {
        Surface welds(mesh, grid, &point_of, ties);
        if (try_also(always | welds_points, welds)) best_surface.emplace(std::move(welds));
    }
    try_also(best.kind | matches_residuals, *best_surface);
    return best;
}

DecodedReference decode_reference(Polygons mesh, u8 kind, std::span<const u8> data) {
    RangeCoder<Mode::decode> coder(data);
    DecodedReference found;
    const bool is_welded = kind & welds_points;
    const i64 vertices = mesh.vertices;
    i64 points = vertices;
    std::vector<i32> point_of;
    if (is_welded) {
        point_of.resize(vertices);
        if (kind & ties_vertices) found.ties.resize(vertices);
        points = code_welds(coder, CornerTable(mesh), point_of, found.ties);
        name_ties(found.ties);
        mesh = welded(std::move(mesh), point_of, points);
    }
    const CornerTable corners(std::move(mesh));
    PointModel model(kind & matches_residuals);
    TermWeights weights{};
    model.code_weights(coder, weights);
    SmoothingWeights of_smoothing{};
    if (kind & smooths_points) model.code_weights(coder, of_smoothing);
    Predictor predictor(corners, std::vector<Vector>(points));
    model.code(coder, prediction_order(corners), weights, predictor);
    if (!coder.is_finished()) {
        throw CorruptError(Section("REST"), "does not end with its coordinates; get the file again");
    }
    if (kind & smooths_points) predictor.grid = smoothed(corners, predictor.grid, of_smoothing);
    found.grid = is_welded ? at_vertices(predictor.grid, point_of) : std::move(predictor.grid);
    return found;
}

}  // namespace pdeanim
