#include "encode/group_model.hpp"

#include <algorithm>
#include <cmath>
#include <mutex>

#include "base/arrays.hpp"
#include "base/parallel.hpp"
#include "encode/quantise.hpp"
#include "sections/residuals/residuals.hpp"

namespace pdeanim {

namespace {

using Exact = std::array<double, 3>;

// Divides the frames of a group into tiles that are processed together. A tile has at most as many frames as are
// evaluated at once. If there are enough positions, a group has at least two tiles, which two threads can share; with
// fewer it would not pay off, because sums common to all frames are added for each tile. Errors are summed tile by
// tile, so tiles must not depend on the number of threads.
class Tiles {
public:
    Tiles(i64 frames, i64 vertices)
        : frames_(frames), count_(most((frames + frames_at_once - 1) / frames_at_once,
                                       frames * vertices < worth_two ? 0 : least<i64>(frames, 2))) {}

    i64 count() const { return count_; }

    // Return the first frame of a tile; for the number of tiles, the number of frames.
    i64 begin(i64 tile) const { return frames_ * tile / count_; }

private:
    static constexpr i64 worth_two = i64{1} << 17;

    i64 frames_, count_;
};

// Copy rows of vertices to the vertices that are tied to them. A selection of elements has no tied vertices.
template <class Real, class Row> void copy_to_tied(const Motion<Real> &motion, std::span<Row> rows) {
    if (!motion.selection) motion.basis->elements().patches->copy_to_tied(rows);
}

// Compute positions of some frames, before residuals and before rounding to float32.
template <class Real>
void evaluate_frames(const GroupModel<Real> &model, i64 frame, i64 count, LargeArray<double> &positions) {
    const i64 row = model.motion.time_axes() * model.motion.functions;
    positions.resize(3 * count * model.motion.vertices());
    evaluate(model.motion, model.time.subspan(frame * row, count * row), &model.reference,
             std::span<double>(positions));
    const std::span<Exact> all{reinterpret_cast<Exact *>(positions.data()), positions.size() / 3};
    for (i64 k = 0; k < count; ++k) copy_to_tied(model.motion, all.subspan(k * model.motion.vertices()));
}

void find_excess(std::span<const Position> points, std::span<const Exact> base, i64 frame, double bound, const Aim &aim,
                 Excess &found) {
    const double most_off = aim.most * bound;
    for (std::size_t vertex = 0; vertex < points.size(); ++vertex) {
        Exact off;
        for (int axis = 0; axis < 3; ++axis) off[axis] = static_cast<double>(points[vertex][axis]) - base[vertex][axis];
        const double square = off[0] * off[0] + off[1] * off[1] + off[2] * off[2];
        if (!(square > most_off * most_off)) continue;
        const double distance = std::sqrt(square);
        const double share = least(distance - most_off, aim.farthest * bound) / most(distance, bound);
        found.frames.push_back(static_cast<i32>(frame));
        found.vertices.push_back(static_cast<i32>(vertex));
        found.excess.push_back({static_cast<float>(off[0] * share), static_cast<float>(off[1] * share),
                                static_cast<float>(off[2] * share)});
    }
}

// Add up the errors of a frame whose residuals are known; `decoded` is a buffer for its positions.
template <class Real> void add_errors(const Motion<Real> &motion, std::span<const Position> points,
                                      std::span<const Exact> base, const Residuals &residuals, i64 frame,
                                      const ResidualScale &scale, std::vector<Position> &decoded, Errors &found) {
    decoded.resize(points.size());
    std::transform(base.begin(), base.end(), decoded.begin(), [](const Exact &at) {
        return Position{static_cast<float>(at[0]), static_cast<float>(at[1]), static_cast<float>(at[2])};
    });
    add_residuals(residuals, frame, scale, 1.0, {}, decoded);
    copy_to_tied(motion, std::span(decoded));
    for (std::size_t vertex = 0; vertex < points.size(); ++vertex) {
        double square = 0.0;
        for (int axis = 0; axis < 3; ++axis) {
            const double off = static_cast<double>(points[vertex][axis]) - static_cast<double>(decoded[vertex][axis]);
            square += off * off;
        }
        found.largest_square = most(found.largest_square, square);
        found.sum_of_squares += square;
    }
}

}  // namespace

template <class Real>
void Excess::add_to(std::span<Real> values, std::span<const double> functions, i64 count, int axes, double push) const {
    for (std::size_t k = 0; k < frames.size(); ++k) {
        Real *to = values.data() + vertices[k] * count * axes;
        for (int x = 0; x < 3; ++x) {
            const double off = push * static_cast<double>(excess[k][x]);
            const double *function = functions.data() + (axes == 1 ? 3 * frames[k] + x : frames[k]) * count;
            for (i64 a = 0; a < count; ++a) {
                Real &value = to[axes == 1 ? a : 3 * a + x];
                value = static_cast<Real>(value + off * function[a]);
            }
        }
    }
}

template <class Real> Residuals missing(const GroupModel<Real> &model, const Wanted &wanted,
                                        std::span<const double> margins, const Aim &aim, Excess *excess, Errors *errors,
                                        int threads) {
    const i64 vertices = model.motion.vertices();
    const Tiles tiles(model.frames, vertices);
    std::vector<Residuals> parts(tiles.count());
    std::vector<Errors> off(tiles.count());
    std::vector<Excess> beyond(tiles.count());
    in_shares(tiles.count(), threads, [&](i64 first, i64 end) {
        LargeArray<double> positions;
        std::vector<Position> decoded;
        for (i64 tile = first; tile < end; ++tile) {
            const i64 frame = tiles.begin(tile), count = tiles.begin(tile + 1) - frame;
            evaluate_frames(model, frame, count, positions);
            const std::span<const Exact> base{reinterpret_cast<const Exact *>(positions.data()), positions.size() / 3};
            const std::span<const Position> points = wanted.points.subspan(frame * vertices, count * vertices);
            parts[tile] = quantise_residuals(points, base, wanted.order, margins.subspan(frame, count), wanted.bound,
                                             wanted.step);
            for (i64 k = 0; k < count; ++k) {
                const auto own_points = points.subspan(k * vertices, vertices);
                const auto own_base = base.subspan(k * vertices, vertices);
                if (errors) {
                    add_errors(model.motion, own_points, own_base, parts[tile], k, {wanted.order, wanted.step}, decoded,
                               off[tile]);
                }
                if (excess) find_excess(own_points, own_base, frame + k, wanted.bound, aim, beyond[tile]);
            }
        }
    });
    std::vector<const Residuals *> joined;
    for (i64 tile = 0; tile < tiles.count(); ++tile) {
        joined.push_back(&parts[tile]);
        if (errors) {
            errors->largest_square = most(errors->largest_square, off[tile].largest_square);
            errors->sum_of_squares += off[tile].sum_of_squares;
        }
        if (!excess) continue;
        append(excess->frames, beyond[tile].frames);
        append(excess->vertices, beyond[tile].vertices);
        append(excess->excess, beyond[tile].excess);
    }
    return join_residuals(joined);
}

template <class One, class Other>
double farthest_apart(const GroupModel<One> &single, const GroupModel<Other> &exact, int threads) {
    double farthest = 0.0;
    std::mutex lock;
    const Tiles tiles(exact.frames, exact.motion.vertices());
    in_shares(tiles.count(), threads, [&](i64 first, i64 end) {
        LargeArray<double> one, other;
        double found = 0.0;
        for (i64 tile = first; tile < end; ++tile) {
            const i64 frame = tiles.begin(tile), count = tiles.begin(tile + 1) - frame;
            evaluate_frames(single, frame, count, one);
            evaluate_frames(exact, frame, count, other);
            for (std::size_t k = 0; k < one.size(); ++k) found = most(found, std::fabs(one[k] - other[k]));
        }
        const std::lock_guard guard(lock);
        farthest = most(farthest, found);
    });
    return farthest;
}

template void Excess::add_to(std::span<float>, std::span<const double>, i64, int, double) const;
template void Excess::add_to(std::span<double>, std::span<const double>, i64, int, double) const;
template Residuals missing(const GroupModel<float> &, const Wanted &, std::span<const double>, const Aim &, Excess *,
                           Errors *, int);
template Residuals missing(const GroupModel<double> &, const Wanted &, std::span<const double>, const Aim &, Excess *,
                           Errors *, int);
template double farthest_apart(const GroupModel<float> &, const GroupModel<float> &, int);
template double farthest_apart(const GroupModel<float> &, const GroupModel<double> &, int);
template double farthest_apart(const GroupModel<double> &, const GroupModel<float> &, int);
template double farthest_apart(const GroupModel<double> &, const GroupModel<double> &, int);

}  // namespace pdeanim
