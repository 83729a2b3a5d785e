// The terms that add up to positions, for callers that add them up themselves: weights of functions of time, and
// fields.
#include <algorithm>
#include <cmath>
#include <iterator>

#include "decode/evaluator.hpp"

namespace pdeanim {

namespace {

// Return weights with which evaluation returns fields instead of positions: (rows, time axes, functions). Each row
// gives one function the weight 1; functions that have a weight per axis go three to a row, one on each axis.
std::vector<double> unit_weights(i64 functions, i64 time_axes, i64 first, i64 rows) {
    std::vector<double> weights(rows * time_axes * functions);
    for (i64 row = 0; row < rows; ++row) {
        for (i64 axis = 0; axis < time_axes; ++axis) {
            const i64 function = first + row * time_axes + axis;
            if (function < functions) weights[(row * time_axes + axis) * functions + function] = 1.0;
        }
    }
    return weights;
}

int derivative_of(Quantity quantity) { return static_cast<int>(quantity); }

void check_time(double time) {
    if (std::isnan(time)) throw ArgumentError("times must be numbers");
}

}  // namespace

// Return whether a quantity is zero because a time is outside the clip, where the mesh stands still.
bool Evaluator::is_outside(Quantity quantity, double time) const {
    if (quantity == Quantity::positions) return false;
    return run_.frames() == 1 || time < run_.times().front() || time > run_.times().back();
}

// Return the frame at this time, if positions are requested and there is such a frame.
std::optional<i64> Evaluator::frame_of_positions(Quantity quantity, double time) const {
    const double inside = clamp(time, run_.times().front(), run_.times().back());
    const i64 frame = run_.frame_at(inside);
    if (quantity != Quantity::positions || run_.times()[frame] != inside) return std::nullopt;
    return frame;
}

std::pair<std::size_t, std::size_t> Evaluator::groups_at(Quantity quantity, double time) {
    check_time(time);
    const auto guard = turns_.begin_call();
    if (is_outside(quantity, time)) return {0, 0};
    if (const std::optional<i64> frame = frame_of_positions(quantity, time)) {
        const std::size_t index = run_.table().group_of(*frame);
        return {index, index + 1};
    }
    return counting_groups(time, derivative_of(quantity));
}

std::vector<double> Evaluator::weights(Quantity quantity, double time, std::size_t index) {
    check_time(time);
    const auto guard = turns_.begin_call();
    const Group &own = run_.table().groups()[index];
    std::vector<double> found;
    if (is_outside(quantity, time)) {
        found.resize(own.time_axes() * own.functions);
        return found;
    }
    if (const std::optional<i64> frame = frame_of_positions(quantity, time)) {
        found.resize(own.time_axes() * own.functions);
        if (run_.table().group_of(*frame) == index) {
            const auto row = groups_.group(index).time.begin() + (*frame - own.first) * static_cast<i64>(found.size());
            std::copy_n(row, found.size(), found.begin());
        }
        return found;
    }
    found = weights_of_group(index, time, derivative_of(quantity));
    found.resize(own.time_axes() * own.functions);
    return found;
}

void GroupFields::fields(std::size_t index, std::span<float> out) {
    const auto guard = turns_.begin_call();
    const Group &own = run_.table().groups()[index];
    const i64 size = run_.vertices(), together = own.time_axes();
    if (static_cast<i64>(out.size()) != own.channels() * size) {
        throw ArgumentError("the array to write to has another size");
    }
    const DecodedGroup &decoded = groups_.group(index);
    std::vector<float> tile;
    for (i64 first = 0; first < own.functions; first += together * frames_at_once) {
        turns_.check_cancelled();
        const i64 rows = least(frames_at_once, (own.functions - first + together - 1) / together);
        const std::vector<double> weights = unit_weights(own.functions, together, first, rows);
        tile.resize(rows * 3 * size);
        const auto evaluate_tile = [&]<class Real>(const Motion<Real> &motion) {
            const AnchoredReference<Real> *none = nullptr;
            pdeanim::evaluate(motion, weights, none, std::span<float>(tile));
        };
        std::visit(evaluate_tile, decoded.motion);
        for (i64 row = 0; row < rows; ++row) {
            evaluator_.patches().copy_to_tied(as_positions(std::span(tile).subspan(row * 3 * size, 3 * size)));
        }
        if (together == 1) {
            std::copy(tile.begin(), tile.end(), out.begin() + first * 3 * size);
            continue;
        }
        for (i64 k = 0; k < least(rows * together, own.functions - first); ++k) {
            const float *from = tile.data() + k / together * 3 * size + k % together;
            float *to = out.data() + (first + k) * size;
            for (i64 v = 0; v < size; ++v) to[v] = from[3 * v];
        }
    }
}

std::vector<double> GroupFields::coefficients(std::size_t group) {
    const auto guard = turns_.take();
    const SpaceBasis &basis = run_.space();
    const Group &own = run_.table().groups()[group];
    const TakenMemory taken(run_.memory(),
                            own.bytes() + sizeof(double) * static_cast<u64>(basis.functions() * own.channels()),
                            "coefficients of a group of frames");
    return group_coefficients(own, run_.table().chunks(run_.container(), group)[1], basis, taken.another());
}

std::vector<Correction> GroupFields::corrections(std::size_t index, TakenMemory &taken) {
    const auto guard = turns_.begin_call();
    const Group &own = run_.table().groups()[index];
    const u64 bytes = sizeof(Correction) * static_cast<u64>(groups_.group(index).residuals.count());
    constexpr std::string_view counted = "corrections of a group of frames";
    taken = TakenMemory(run_.memory(), bytes, counted);
    std::vector<Correction> found;
    found.reserve(groups_.group(index).residuals.count());
    std::vector<std::array<double, 3>> offsets(run_.vertices());
    const ResidualScale scale = evaluator_.residual_scale();
    const std::vector<Tie> &tied = evaluator_.patches().tied;
    std::vector<bool> is_corrected(tied.empty() ? 0 : run_.vertices());
    for (i64 frame = own.first; frame < own.first + own.frames; ++frame) {
        const FrameResiduals here = evaluator_.residuals_at(frame);
        residual_displacements(here.group, here.inside, scale, here.base, offsets);
        const auto own_places = [&](const std::vector<i64> &starts, const std::vector<i32> &places) {
            return std::span(places).subspan(starts[here.inside], starts[here.inside + 1] - starts[here.inside]);
        };
        // The position of a raw vertex replaces its residual, if it has both.
        const std::span<const i32> raw = own_places(here.group.raw_frame_starts, here.group.raw_places);
        std::vector<i32> places(raw.begin(), raw.end());
        const std::span<const i32> residuals = own_places(here.group.frame_starts, here.group.places);
        std::set_difference(residuals.begin(), residuals.end(), raw.begin(), raw.end(), std::back_inserter(places));
        const auto add = [&](i32 vertex, i32 first) {
            Correction &added = found.emplace_back(Correction{static_cast<i32>(frame), vertex, {}});
            for (int axis = 0; axis < 3; ++axis) added.offset[axis] = static_cast<float>(offsets[first][axis]);
        };
        for (const i32 place : places) add(scale.order[place], scale.order[place]);
        if (tied.empty()) continue;
        for (const i32 place : places) is_corrected[scale.order[place]] = true;
        for (const Tie &tie : tied) {
            if (!is_corrected[tie.first]) continue;
            taken.take(sizeof(Correction), counted);
            add(tie.vertex, tie.first);
        }
        for (const i32 place : places) is_corrected[scale.order[place]] = false;
    }
    return found;
}

std::vector<i32> GroupFields::elements() {
    const auto guard = turns_.begin_call();
    const Patches &patches = *run_.space().elements().patches;
    std::vector<i32> found(run_.vertices());
    for (i64 e = 0; e < patches.count(); ++e) {
        for (const i32 vertex : patches.vertices(e)) found[vertex] = static_cast<i32>(e);
    }
    patches.copy_to_tied(std::span(found));
    return found;
}

}  // namespace pdeanim
