#include "sections/residuals/residual_model.hpp"

#include "base/errors.hpp"
#include "sections/residuals/residuals.hpp"

namespace pdeanim {

template <Mode mode> i64 MissModel::code(RangeCoder<mode> &coder, const MissContext &known, i64 miss) {
    const i64 size_in_time = size_of(known.in_time), size_in_space = size_of(known.in_space);
    const i64 beside = 2 * known.one_before + known.two_before;
    const i64 expected = 3 * size_in_time + 2 * size_in_space + beside + (known.mean_size >> 4);
    const int digits = bit_length(expected), shift = most(digits - fine_digits, 0);
    const bool is_coarse = shift > 0;
    const i64 kind = is_coarse       ? 20 + ((expected >> (digits - 3)) & 3)
                     : expected < 12 ? expected
                                     : least<i64>(12 + ((expected - 12) >> 2), 19);
    auto &of_kind = by_expected_[kind][known.axis];
    auto &of_near = by_near_[known.has_reference ? least<i64>(size_in_time >> shift, 6) : 7]
                            [known.has_before ? least<i64>(size_in_space >> shift, 6) : 7][is_coarse];
    auto &of_beside = by_beside_[least<i64>(known.one_before >> shift, 7)][least<i64>(known.two_before >> shift, 7)]
                                [known.axis][is_coarse];
    bool is_negative = miss < 0;
    const i64 size = is_negative ? -miss - is_coarse : miss;  // a coarse 0 counts as positive, -1 as the first negative
    const i64 wanted = size >> shift;
    i64 found = known.is_not_zero && !is_coarse;
    while (found < most_counted && coder.template mixed<3>({&of_kind[found], &of_near[found], &of_beside[found]},
                                                           count_weights_[found][is_coarse].data(), wanted > found)) {
        ++found;
    }
    const i64 counted = found;
    if (counted == most_counted) found += rest_.code(coder, wanted - most_counted + 1) - 1;
    if (is_coarse || found) {
        const int in_time = sign_of(known.in_time) + 1, in_space = sign_of(known.in_space) + 1;
        is_negative = coder.template mixed<3>(
            {&signs_[in_time][in_space][is_coarse],
             &signs_in_time_[in_time][sign_of(known.agreed_in_time) + 1][least<i64>(size_in_time, 2)][is_coarse],
             &signs_in_space_[in_space][sign_of(known.agreed_in_space) + 1][known.axis][is_coarse]},
            sign_weights_[is_coarse].data(), is_negative);
    }
    if (found > 4 * largest_residual >> shift) throw CorruptError("a residual is out of range");
    int upper = 1;
    for (int place = shift - 1; place >= 0; --place) {
        bool bit = (size >> place) & 1;
        if (upper < 1 << modelled_digits) {
            bit = coder.bit(lower_digits_[counted][upper], bit);
            upper = 2 * upper + bit;
        } else {
            bit = coder.bypass(bit);
        }
        found = 2 * found + bit;
    }
    return is_negative ? -found - is_coarse : found;
}

template i64 MissModel::code(RangeCoder<Mode::encode> &, const MissContext &, i64);
template i64 MissModel::code(RangeCoder<Mode::decode> &, const MissContext &, i64);
template i64 MissModel::code(RangeCoder<Mode::measure> &, const MissContext &, i64);

template <Mode mode> ResidualModel<mode>::ResidualModel(RangeCoder<mode> &coder, std::span<const i64> patches,
                                                        bool is_predicted, Values &residuals, i64 count)
    : coder_(coder), patches_(patches), is_predicted_(is_predicted), residuals_(residuals), count_(count) {
    begin_again();
    if constexpr (mode == Mode::decode) {
        residuals.places.reserve(count);
        residuals.quantised.reserve(count);
    }
}

template <Mode mode> void ResidualModel<mode>::begin_again() {
    const std::size_t vertices = patches_.back();
    at_ = frame_begin_ = frame_end_ = near_begin_ = near_end_ = 0;
    is_far_ = false;
    last_.assign(vertices, -1);
    mean_sizes_.assign(vertices, 0);
    counts_.assign(patches_.size() + 2, 0);
    misses_.clear();
    misses_.reserve(count_);
    earlier_.clear();
    earlier_.reserve(count_);
    by_patch_.assign(patches_.size() - 1, {});
    by_place_.assign(vertices, {});
    by_span_.assign(vertices, {});
}

template <Mode mode> int ResidualModel<mode>::count_in_reference(i64 begin, i64 end) const {
    int found = 0;
    for (i64 place = begin; place < end; ++place) found += in_reference(place) >= 0;
    return found;
}

template <Mode mode> i64 ResidualModel<mode>::code_distance(i64 frame, i64 distance, i64 wanted) {
    if (coder_.bit(is_same_distance_, wanted == distance)) return distance;
    const i64 found = distance_.code(coder_, wanted);
    if (found > frame) throw CorruptError("a reference is before the first frame");
    return found;
}

// Restore the record of a frame's residuals, as if that frame had been coded just now.
template <Mode mode> void ResidualModel<mode>::recall(i64 frame) {
    i64 residual = residuals_.frame_starts[frame];
    const i64 end = residuals_.frame_starts[frame + 1];
    for (std::size_t patch = 0; patch + 1 < patches_.size(); ++patch) {
        const i64 first = residual;
        for (; residual < end && residuals_.places[residual] < patches_[patch + 1]; ++residual) {
            last_[residuals_.places[residual]] = residual;
        }
        counts_[patch + 2] = residual - first;
    }
}

template <Mode mode> void ResidualModel<mode>::code(i64 frames, std::span<const i64> distances) {
    i64 distance = 1;
    for (i64 frame = 0; frame < frames; ++frame) {
        if (frame > 0) {
            distance = code_distance(frame, distance, mode == Mode::decode ? 0 : distances[frame]);
            is_far_ = distance > 1;
            if (is_far_) recall(frame - distance);
            near_begin_ = residuals_.frame_starts[frame - distance];
            near_end_ = residuals_.frame_starts[frame - distance + 1];
        }
        frame_begin_ = at_;
        if constexpr (mode != Mode::decode) frame_end_ = residuals_.frame_starts[frame + 1];
        for (std::size_t patch = 0; patch + 1 < patches_.size(); ++patch) code_patch(patch);
        if constexpr (mode == Mode::decode) residuals_.frame_starts.push_back(at_);
    }
    if (at_ != count_) throw CorruptError("there are fewer residuals than declared");
}

template <Mode mode> void ResidualModel<mode>::code_patch(std::size_t patch) {
    if constexpr (mode == Mode::decode) {
        if (coder_.beyond() > RangeCoder<mode>::first_bytes) throw CorruptError("the stream ends too early");
    }
    const i64 begin = patches_[patch], end = patches_[patch + 1];
    // Numbers of residuals: of the two previous patches in this frame, and of this patch and the next one in the
    // reference.
    const int second = count_class(counts_[patch]), before = count_class(counts_[patch + 1]);
    const int own = count_class(counts_[patch + 2]), ahead = count_class(counts_[patch + 3]);
    i64 so_far = 0;
    if (coder_.template mixed<3>({&patch_beside_[own][before][second > 0][least(ahead, 2)], &by_patch_[patch],
                                  &patch_around_[second][ahead][before]},
                                 patch_weights_.data(), is_next_before(end))) {
        i64 in_span = 0;  // residuals in the previous span
        for (i64 span = begin; span < end; span += span_size) {
            const i64 span_end = least(span + span_size, end);
            const bool is_certain = so_far == 0 && span_end == end;
            if (!is_certain) {
                const i64 vertices = static_cast<i64>(last_.size());
                const bool is_after = count_in_reference(span_end, least(span_end + span_size, vertices)) > 0;
                const i64 part = (span - begin) * 4 / (end - begin);
                auto &around = span_around_[least(count_in_reference(span, span_end), 3)][least<i64>(in_span, 3)];
                if (!coder_.template mixed<3>({&around[is_after][so_far > 0], &by_span_[span],
                                               &span_so_far_[least<i64>(so_far, 7)][part][own]},
                                              span_weights_.data(), is_next_before(span_end))) {
                    in_span = 0;
                    continue;
                }
            }
            in_span = code_span(span, span_end, own);
            so_far += in_span;
        }
    }
    counts_[patch + 2] = so_far;
}

// Code the places of a span that have a residual, and the residuals; return their number.
template <Mode mode> i64 ResidualModel<mode>::code_span(i64 begin, i64 end, int own) {
    const i64 first = at_;
    for (i64 place = begin; place < end; ++place) {
        const i64 near = in_reference(place), before = in_frame(place - 1), second = in_frame(place - 2);
        const bool is_certain = at_ == first && place == end - 1;
        if (!is_certain) {
            const bool is_known = near >= 0;
            i64 size = 0;
            if (is_known) {
                const Steps &steps = residuals_.quantised[near];
                size = 1 + least<i64>(size_of(steps[0]) + size_of(steps[1]) + size_of(steps[2]), 2);
            }
            const bool is_after = place + 1 < static_cast<i64>(last_.size()) && in_reference(place + 1) >= 0;
            auto &so_far = vertex_so_far_[least<i64>(at_ - first, 2)][end - 1 - place][own];
            if (!coder_.template mixed<3>(
                    {&vertex_around_[size][before >= 0][second >= 0][is_after], &by_place_[place], &so_far[is_known]},
                    vertex_weights_[is_known].data(), is_next_before(place + 1))) {
                continue;
            }
        }
        code_residual(place, near, before, second);
        last_[place] = at_++;
    }
    return at_ - first;
}

// near, before, second: the residual of this place in the reference, and those of the two previous places in this
// frame; -1 if there is none.
template <Mode mode> void ResidualModel<mode>::code_residual(i64 place, i64 near, i64 before, i64 second) {
    if constexpr (mode == Mode::decode) {
        if (at_ == count_) throw CorruptError("there are more residuals than declared");
    }
    MissContext known;
    known.has_reference = near >= 0;
    known.has_before = before >= 0;
    known.mean_size = known.has_reference ? mean_sizes_[place] : 0;
    const i64 near_2 = earlier(near), near_3 = earlier(near_2);
    const i64 before_2 = near >= 0 ? earlier(before) : -1, before_3 = earlier(before_2);
    const i64 second_2 = near >= 0 ? earlier(second) : -1;
    Steps steps{};
    Misses misses{};
    i64 total = 0;
    for (int axis = 0; axis < 3; ++axis) {
        StepPredictor &predictor = predictors_[is_far_][known.has_before][known.has_reference][axis];
        StepPredictor::Changes changes{};
        i64 guess = 0;
        if (is_predicted_) {
            const i64 in_reference = number(near, axis), in_reference_2 = number(near_2, axis);
            const i64 before_in_reference = number(before_2, axis);
            changes = {in_reference - in_reference_2, in_reference_2 - number(near_3, axis),
                       number(before, axis) - before_in_reference, before_in_reference - number(before_3, axis),
                       number(second, axis) - number(second_2, axis)};
            guess = predictor.predict(in_reference, changes);
        }
        known.axis = axis;
        known.is_not_zero = axis == 2 && !is_predicted_ && known.one_before == 0 && known.two_before == 0;
        known.in_time = near >= 0 ? misses_[near][axis] : 0;
        known.in_space = before >= 0 ? misses_[before][axis] : 0;
        i64 wanted = 0;
        if constexpr (mode != Mode::decode) wanted = residuals_.quantised[at_][axis] - guess;
        const i64 miss = miss_model_.code(coder_, known, wanted), size = size_of(miss);
        steps[axis] = guess + miss;
        if (size_of(steps[axis]) > largest_residual) throw CorruptError("a residual is out of range");
        if (is_predicted_) predictor.learn(changes, miss);
        misses[axis] = static_cast<i32>(clamp(miss, -largest_remembered_miss, largest_remembered_miss));
        known.agreed_in_time += sign_of(known.in_time) * sign_of(miss);
        known.agreed_in_space += sign_of(known.in_space) * sign_of(miss);
        known.two_before = known.one_before;
        known.one_before = size;
        total += least(size, largest_remembered_miss);
    }
    i64 &mean = mean_sizes_[place];
    mean = known.has_reference ? mean + ((16 * total - mean) >> 2) : 16 * total;
    misses_.push_back(misses);
    earlier_.push_back(near);
    if constexpr (mode == Mode::decode) {
        residuals_.places.push_back(static_cast<i32>(place));
        residuals_.quantised.push_back(steps);
    }
}

template class ResidualModel<Mode::encode>;
template class ResidualModel<Mode::decode>;
template class ResidualModel<Mode::measure>;

}  // namespace pdeanim
