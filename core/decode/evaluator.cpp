#include "decode/evaluator.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <numeric>

#include "base/parallel.hpp"

namespace pdeanim {

namespace {

// Bytes read and written by an evaluation from which several threads pay off: starting a thread takes 30 us. The
// vertices are divided into 2^part_levels parts.
constexpr i64 bytes_worth_a_thread = i64{1} << 21, bytes_of_a_position = 24;
constexpr int part_levels = 3;

}  // namespace

const Patches &Evaluator::patches() { return *run_.space().elements().patches; }

ResidualScale Evaluator::residual_scale() { return {patches().order, run_.model().residual_step}; }

template <class Real> const AnchoredReference<Real> &Evaluator::anchored() {
    auto &found = [&]() -> std::optional<AnchoredReference<Real>> & {
        if constexpr (std::is_same_v<Real, float>) {
            return anchored_single_;
        } else {
            return anchored_double_;
        }
    }();
    if (!found) found.emplace(*run_.space().elements().patches, run_.reference().points);
    return *found;
}

// Call work(motion, reference frame) with a group's motion and the reference frame in its precision.
template <class Work> void Evaluator::with_motion(const DecodedGroup &own, const Work &work) {
    std::visit([&]<class Real>(const Motion<Real> &motion) { work(motion, anchored<Real>()); }, own.motion);
}

// Return the levels of the partition tree at which vertices are divided among threads, for an evaluation that reads
// `bytes` and writes `positions`.
int Evaluator::levels_of(i64 bytes, i64 positions) const {
    const bool is_worth_it = bytes + bytes_of_a_position * positions >= bytes_worth_a_thread;
    return is_worth_it && run_.threads() > 1 ? part_levels : 0;
}

// Call work(share) for shares that together cover the vertices once, on several threads if enough bytes are read.
template <class Work> void Evaluator::in_parts(i64 bytes, const Work &work) const {
    const int levels = levels_of(bytes, run_.vertices());
    in_shares(i64{1} << levels, run_.threads(), [&](i64 first, i64 end) {
        for (i64 part = first; part < end; ++part) work(VertexShare{levels, part});
    });
}

// Write positions at one time, or displacements if there is no reference frame, from the weights of functions of time.
template <class Real, class Out>
void Evaluator::evaluate_once(const Motion<Real> &motion, std::span<const double> weights,
                              const AnchoredReference<Real> *reference, Out out) const {
    in_parts(motion.bytes(),
             [&](const VertexShare &share) { pdeanim::evaluate(motion, weights, reference, out, share); });
}

// Write positions at one frame by the model alone.
void Evaluator::evaluate_model(const DecodedGroup &own, i64 frame, std::span<float> out) {
    with_motion(own, [&](const auto &motion, const auto &anchored) {
        evaluate_once(motion, own.time_at(frame, 1), &anchored, out);
    });
}

FrameResiduals Evaluator::residuals_at(i64 frame) {
    const DecodedGroup &own = groups_.group(run_.table().group_of(frame));
    FrameResiduals found{own.residuals, frame - own.group.first, {}};
    const std::vector<i64> &starts = own.residuals.raw_frame_starts;
    if (starts[found.inside] < starts[found.inside + 1]) {
        found.base.resize(run_.vertices());
        evaluate_model(own, frame, {found.base[0].data(), 3 * found.base.size()});
    }
    return found;
}

// Consecutive frames of one group that are evaluated together: by one thread, or by several that each take some of the
// vertices.
struct Evaluator::Tile {
    Tile(const DecodedGroup &group, i64 begin, i64 frames) : group(group), begin(begin), frames(frames) {}

    i64 inside() const { return begin - group.group.first; }

    const DecodedGroup &group;
    i64 begin, frames;
    std::atomic<i64> parts_left = 1;
};

// Divide consecutive frames into tiles, as far as their groups are in the cache together. The group of the first frame
// is decoded if it is not cached.
std::deque<Evaluator::Tile> Evaluator::tiles_of(i64 first, i64 count) {
    std::deque<Tile> tiles;
    for (i64 begin = first; begin < first + count;) {
        const std::size_t index = run_.table().group_of(begin);
        if (begin > first && !groups_.is_kept(index)) break;
        const DecodedGroup &own = groups_.group(index);
        const i64 end = least(first + count, own.group.first + own.group.frames);
        for (; begin < end; begin += tiles.back().frames) {
            tiles.emplace_back(own, begin, least(frames_at_once, end - begin));
        }
    }
    return tiles;
}

// Write positions of some vertices at a tile's frames; the last thread to finish a tile adds its residuals.
void Evaluator::evaluate_part(Tile &tile, VertexShare share, const ResidualScale &scale, const Patches &patches,
                              std::span<float> out) {
    with_motion(tile.group, [&](const auto &motion, const auto &anchored) {
        pdeanim::evaluate(motion, tile.group.time_at(tile.begin, tile.frames), &anchored, out, share);
    });
    if (--tile.parts_left > 0) return;
    const std::size_t size = 3 * run_.vertices();
    for (i64 k = 0; k < tile.frames; ++k) {
        const std::span<Position> positions = as_positions(out.subspan(k * size, size));
        add_residuals(tile.group.residuals, tile.inside() + k, scale, 1.0, {}, positions);
        patches.copy_to_tied(positions);
    }
}

// Write positions at consecutive frames, as far as their groups are cached together; return the number of frames
// written, at least one.
i64 Evaluator::evaluate_frames(i64 first, i64 count, std::span<float> out) {
    std::deque<Tile> tiles = tiles_of(first, count);
    // Each thread takes whole tiles. The last tiles, fewer than threads, are divided by vertices.
    const std::size_t alike = tiles.size() - tiles.size() % run_.threads();
    std::vector<std::pair<Tile *, VertexShare>> parts;
    for (std::size_t k = 0; k < tiles.size(); ++k) {
        Tile &tile = tiles[k];
        int levels = 0;
        // Build the reference frame before several threads use it.
        with_motion(tile.group, [&](const auto &motion, const auto &) {
            if (k >= alike) levels = levels_of(motion.bytes(), tile.frames * run_.vertices());
        });
        tile.parts_left = i64{1} << levels;
        for (i64 part = 0; part < tile.parts_left; ++part) parts.emplace_back(&tile, VertexShare{levels, part});
    }
    const ResidualScale scale = residual_scale();
    const Patches &order = patches();  // threads must not wait for the lock that the caller holds
    const std::size_t size = 3 * run_.vertices();
    const auto work = [&](i64 at, i64 end) {
        for (; at < end; ++at) {
            turns_.check_cancelled();
            const auto [tile, share] = parts[at];
            evaluate_part(*tile, share, scale, order, out.subspan((tile->begin - first) * size, tile->frames * size));
        }
    };
    const i64 all = static_cast<i64>(parts.size());
    in_shares(all, run_.threads(), work, all);
    return tiles.back().begin + tiles.back().frames - first;
}

// Return the groups whose functions contribute at a time inside the clip, by the closed form or by the spline, as a
// first index and an end index.
std::pair<std::size_t, std::size_t> Evaluator::counting_groups(double time, int derivative) {
    if (run_.table().groups()[0].basis == TimeBasis::closed_form) {
        const std::vector<GroupWeights> found = closed_form_weights(closed_forms(), time, derivative);
        return {found.front().group, found.back().group + 1};
    }
    const FrameShares shares = frame_shares(time, derivative);
    return {run_.table().group_of(shares.first), run_.table().group_of(shares.end() - 1) + 1};
}

// Return the weights of a group's functions at a time inside the clip: (time axes, functions); empty if none
// contributes.
std::vector<double> Evaluator::weights_of_group(std::size_t index, double time, int derivative) {
    const Group &own = run_.table().groups()[index];
    std::vector<double> weights;
    if (own.basis == TimeBasis::closed_form) {
        for (const GroupWeights &found : closed_form_weights(closed_forms(), time, derivative)) {
            if (found.group != index) continue;
            weights.assign(found.weights.begin(), found.weights.begin() + own.functions);
        }
        return weights;
    }
    const FrameShares shares = frame_shares(time, derivative);
    const i64 low = most(own.first, shares.first), high = least(own.first + own.frames, shares.end());
    for (i64 frame = low; frame < high; ++frame) {
        const double share = shares.values[frame - shares.first];
        if (share == 0.0) continue;
        const std::span<const double> time = groups_.group(index).time_at(frame, 1);
        weights.resize(time.size());
        for (std::size_t k = 0; k < time.size(); ++k) weights[k] += share * time[k];
    }
    return weights;
}

const std::vector<ClosedForm> &Evaluator::closed_forms() {
    if (closed_forms_.empty()) {
        closed_forms_.reserve(run_.table().groups().size());
        for (std::size_t k = 0; k < run_.table().groups().size(); ++k) closed_forms_.push_back(run_.closed_form(k));
    }
    return closed_forms_;
}

// Return the weights of frames at a time inside the clip, by the spline.
FrameShares Evaluator::frame_shares(double time, int derivative) {
    if (!spline_) spline_.emplace(run_.times(), run_.jumps());
    return spline_->shares(time, derivative);
}

// Add up the contributions of groups of equal precision, as many together as the cache holds.
template <class Real>
void Evaluator::evaluate_in(const CountingGroups &counting, int derivative, std::span<float> out) {
    const AnchoredReference<Real> *reference = derivative == 0 ? &anchored<Real>() : nullptr;
    std::optional<AnchoredReference<Real>> moved;
    if (counting.size() > 1) {
        moved = reference ? *reference : AnchoredReference<Real>(*run_.space().elements().patches);
        reference = &*moved;
    }
    for (std::size_t next = 0; next < counting.size();) {
        std::vector<const Motion<Real> *> motions;
        i64 bytes = 0;
        const std::size_t first = next;
        do {
            motions.push_back(&std::get<Motion<Real>>(groups_.group(counting[next].first).motion));
            bytes += motions.back()->bytes();
        } while (++next < counting.size() && groups_.is_kept(counting[next].first));
        in_parts(bytes, [&](const VertexShare &share) {
            for (std::size_t k = first; k < next; ++k) {
                const Motion<Real> &own = *motions[k - first];
                const std::vector<double> &weights = counting[k].second;
                if (k + 1 < counting.size()) {
                    displace(own, weights, *moved, share);
                } else {
                    pdeanim::evaluate(own, weights, reference, out, share);
                }
            }
        });
    }
}

// Write positions by the model alone, or derivatives of them, at a time inside the clip.
void Evaluator::evaluate_groups(double time, int derivative, std::span<float> out) {
    CountingGroups counting;
    const auto [first, end] = counting_groups(time, derivative);
    for (std::size_t index = first; index < end; ++index) {
        std::vector<double> weights = weights_of_group(index, time, derivative);
        if (!weights.empty()) counting.emplace_back(index, std::move(weights));
    }
    const auto is_single = [&](const auto &own) { return run_.table().groups()[own.first].is_single; };
    const auto singles = std::count_if(counting.begin(), counting.end(), is_single);
    if (singles == 0 && !counting.empty()) {
        evaluate_in<double>(counting, derivative, out);
        return;
    }
    if (singles == static_cast<i64>(counting.size()) && !counting.empty()) {
        evaluate_in<float>(counting, derivative, out);
        return;
    }
    // Groups of both precisions, or none: add up in double, and round once.
    std::vector<double> all(out.size()), part(out.size());
    if (derivative == 0) all = run_.reference().points;
    for (const auto &counted : counting) {
        std::visit(
            [&]<class Real>(const Motion<Real> &motion) {
                evaluate_once<Real>(motion, counted.second, nullptr, std::span<double>(part));
            },
            groups_.group(counted.first).motion);
        for (std::size_t i = 0; i < all.size(); ++i) all[i] += part[i];
    }
    std::transform(all.begin(), all.end(), out.begin(), [](double value) { return static_cast<float>(value); });
}

// Write positions at a time between two frames. Residuals are interpolated linearly.
void Evaluator::evaluate_between(double time, std::span<float> out) {
    evaluate_groups(time, 0, out);
    const i64 left = run_.frame_at(time);
    const double share = (time - run_.times()[left]) / (run_.times()[left + 1] - run_.times()[left]);
    const ResidualScale scale = residual_scale();
    for (const i64 frame : {left, left + 1}) {
        const FrameResiduals own = residuals_at(frame);
        const double weight = frame == left ? 1.0 - share : share;
        add_residuals(own.group, own.inside, scale, weight, own.base, as_positions(out));
    }
    patches().copy_to_tied(as_positions(out));
}

// Write velocities or accelerations at a time inside the clip. Residuals change at constant speed from one frame to the
// next; at a frame, the speed after it counts.
void Evaluator::evaluate_derivative(int derivative, double time, std::span<float> out) {
    if (run_.frames() == 1) {
        std::fill(out.begin(), out.end(), 0.0f);
        return;
    }
    evaluate_groups(time, derivative, out);
    if (derivative == 1) add_residual_velocities(time, out);
    patches().copy_to_tied(as_positions(out));
}

void Evaluator::add_residual_velocities(double time, std::span<float> out) {
    const i64 after = least(run_.frame_at(time) + 1, run_.frames() - 1);
    const double step = run_.times()[after] - run_.times()[after - 1];
    const ResidualScale scale = residual_scale();
    std::vector<std::array<double, 3>> added[2];
    for (int k = 0; k < 2; ++k) {
        const FrameResiduals own = residuals_at(after - 1 + k);
        added[k].resize(run_.vertices());
        residual_displacements(own.group, own.inside, scale, own.base, added[k]);
    }
    for (i64 v = 0; v < run_.vertices(); ++v) {
        for (int axis = 0; axis < 3; ++axis) {
            float &speed = out[3 * v + axis];
            speed = static_cast<float>(speed + (added[1][v][axis] - added[0][v][axis]) / step);
        }
    }
}

// Evaluate all vertices at increasing times.
void Evaluator::evaluate_all(Quantity quantity, std::span<const double> sorted, std::span<float> out) {
    const std::size_t size = 3 * run_.vertices();
    const double first = run_.times().front(), last = run_.times().back();
    std::size_t row = 0;
    while (row < sorted.size()) {
        turns_.check_cancelled();
        const std::span<float> here = out.subspan(row * size, size);
        const double time = clamp(sorted[row], first, last);
        if (quantity != Quantity::positions) {
            if (sorted[row] < first || sorted[row] > last) {
                std::fill(here.begin(), here.end(), 0.0f);
            } else {
                evaluate_derivative(quantity == Quantity::velocities ? 1 : 2, time, here);
            }
            ++row;
            continue;
        }
        const i64 frame = run_.frame_at(time);
        if (run_.times()[frame] != time) {
            evaluate_between(time, here);
            ++row;
            continue;
        }
        if (!groups_.is_kept(run_.table().group_of(frame))) groups_.decode_ahead(sorted.subspan(row));
        const i64 most_here = least(run_.frames() - frame, static_cast<i64>(sorted.size() - row));
        i64 count = 1;
        while (count < most_here && sorted[row + count] == run_.times()[frame + count]) ++count;
        row += evaluate_frames(frame, count, out.subspan(row * size, count * size));
    }
}

void Evaluator::evaluate(Quantity quantity, std::span<const double> asked, std::optional<i64> object,
                         std::span<float> out) {
    const i64 begin = object ? run_.first_vertex(*object) : 0,
              end = object ? run_.first_vertex(*object + 1) : run_.vertices();
    const std::size_t size = 3 * (end - begin), whole = 3 * run_.vertices();
    if (out.size() != asked.size() * size) throw ArgumentError("the array to write to has another size");
    for (const double time : asked) {
        if (std::isnan(time)) throw ArgumentError("times must be numbers");
    }
    const auto guard = turns_.begin_call();
    std::vector<std::size_t> order(asked.size());
    std::iota(order.begin(), order.end(), 0);
    std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return asked[a] < asked[b]; });
    const bool is_in_order = std::is_sorted(order.begin(), order.end());
    if (is_in_order && !object) {
        evaluate_all(quantity, asked, out);
        return;
    }
    // Evaluate as many times together as fit in the initial budget of the group cache and a quarter of the free memory.
    const u64 room = least(groups_.first_budget(), run_.memory().left() / 4);
    const std::size_t at_once = most<std::size_t>(room / (sizeof(float) * whole), 1);
    std::vector<float> rows;
    for (std::size_t first = 0; first < order.size(); first += at_once) {
        const std::size_t count = least(at_once, order.size() - first);
        std::vector<double> sorted;
        for (std::size_t k = 0; k < count; ++k) sorted.push_back(asked[order[first + k]]);
        rows.resize(count * whole);
        evaluate_all(quantity, sorted, rows);
        for (std::size_t k = 0; k < count; ++k) {
            const auto from = rows.begin() + static_cast<std::ptrdiff_t>(k * whole + 3 * begin);
            std::copy_n(from, size, out.begin() + static_cast<std::ptrdiff_t>(order[first + k] * size));
        }
    }
}

}  // namespace pdeanim
