#include "sections/fields/field_chunk.hpp"

#include <algorithm>
#include <array>
#include <memory>

#include "base/errors.hpp"
#include "sections/fields/field_model.hpp"
#include "sections/fields/field_predictor.hpp"

namespace pdeanim {

namespace {

// The low bits of a chunk's first byte are the levels; these flags are above them.
constexpr u8 has_kinds = 16, is_transformed = 32;
// Quantisation step of functions of time, whose errors add up to less than a step of the remainder.
constexpr u8 function_step = 5;

// The frames that predict a frame: `before` and `after` are at the same distance, `second` and `beyond` farther away on
// either side; -1 if there is none.
struct FrameReferences {
    i64 frame, before, after, second, beyond;
};

// Return the order in which frames are coded, with the frames that predict each.
std::vector<FrameReferences> schedule(i64 frames, int levels) {
    std::vector<FrameReferences> found;
    for (int level = levels; level >= 0; --level) {
        const i64 distance = i64{1} << level;
        const bool is_top = level == levels;
        for (i64 frame = is_top ? 0 : distance; frame < frames; frame += is_top ? distance : 2 * distance) {
            const bool is_between = !is_top && frame + distance < frames;
            const i64 second = frame - (is_between ? 3 : 2) * distance, beyond = frame + 3 * distance;
            found.push_back({.frame = frame,
                             .before = most<i64>(frame - distance, -1),
                             .after = is_between ? frame + distance : -1,
                             .second = most<i64>(second, -1),
                             .beyond = is_between && beyond < frames ? beyond : -1});
        }
    }
    return found;
}

// Codes the values of a chunk in place: an encoder starts with the source's values and ends with the decoded ones.
template <Mode mode> class FieldCoder {
public:
    FieldCoder(RangeCoder<mode> &coder, const FieldRows &rows, i64 frames, int components, FieldCoding coding,
               std::span<i64> values, std::span<u8> kinds)
        : coder_(coder), rows_(rows), components_(components), coding_(coding), width_(rows.count() * components),
          values_(values), kinds_(kinds), references_(schedule(frames, coding.levels)), bases_(width_), speeds_(width_),
          bends_(width_), remainders_(width_), mean_sizes_(width_), repeats_(width_),
          span_histories_(rows.count() / span_rows + 2), by_span_(span_histories_.size()) {
        constexpr i64 half = 1 << (FieldPredictor::fraction_bits - 1);
        constexpr FieldPredictor::Changes first_weights[ways] = {
            {}, {0, 0, half}, {half / 2, 0, half}, {0, half, half / 2}};
        for (const FieldPredictor::Changes &weights : first_weights) {
            predictors_.insert(predictors_.end(), width_ > 0 ? components : 0, FieldPredictor(weights));
        }
    }

    // Number of predictors of a component, and their memory.
    static constexpr int ways = 4;
    static constexpr u64 predictor_bytes = ways * sizeof(FieldPredictor);

    void code() {
        for (const FrameReferences &references : references_) code_frame(references);
    }

private:
    static constexpr i64 span_rows = 16;
    static constexpr int most_repeats = 3;
    enum Way { spatial, held, extrapolated, interpolated };  // how a frame is predicted

    const i64 *values_of(i64 frame) const { return frame < 0 ? nullptr : values_.data() + frame * width_; }
    u8 *kinds_of(i64 frame) const { return frame < 0 || kinds_.empty() ? nullptr : kinds_.data() + frame * width_; }

    void code_frame(const FrameReferences &references) {
        coder_.check_not_ended();
        now_ = values_.data() + references.frame * width_;
        kinds_now_ = kinds_of(references.frame);
        before_ = values_of(references.before);
        kinds_before_ = kinds_of(references.before);
        second_ = values_of(references.second);
        const i64 *after = values_of(references.after), *beyond = values_of(references.beyond);
        way_ = !before_ ? spatial : after ? interpolated : second_ ? extrapolated : held;
        for (i64 i = 0; before_ && i < width_; ++i) {
            bases_[i] = after ? (before_[i] + after[i]) >> 1 : before_[i];
            speeds_[i] = after ? after[i] - before_[i] : second_ ? before_[i] - second_[i] : 0;
            bends_[i] = second_ && beyond ? (before_[i] + after[i] - second_[i] - beyond[i]) >> 3 : 0;
        }
        bool is_last_still = false;
        for (i64 first = 0, span = 0; first < rows_.count(); first += span_rows, ++span) {
            const i64 end = least(first + span_rows, rows_.count());
            if (way_ == held || way_ == extrapolated) {
                is_last_still = code_still(first * components_, end * components_, span, is_last_still);
                if (is_last_still) continue;
            }
            for (i64 row = first; row < end; ++row) code_row(row);
        }
    }

    // Code whether a span of rows is unchanged since the frame before, and copy that frame's values if it is.
    bool code_still(i64 begin, i64 end, i64 span, bool is_last_still) {
        bool is_still = true;
        if constexpr (mode != Mode::decode) {
            for (i64 i = begin; i < end && is_still; ++i) {
                is_still = kinds_now_ && (kinds_now_[i] || kinds_before_[i])
                               ? kinds_now_[i] == kinds_before_[i]
                               : size_of(now_[i] - before_[i]) <= coding_.step / 2;
            }
        }
        u8 &history = span_histories_[span];
        const int beside = 2 * is_last_still + (span_histories_[span + 1] & 1);
        is_still = coder_.template mixed<2>({&by_beside_[history & 7][beside], &by_span_[span]}, still_weights_.data(),
                                            is_still);
        history = static_cast<u8>(2 * history + is_still);
        for (i64 i = begin; is_still && i < end; ++i) {
            now_[i] = before_[i];
            if (kinds_now_) kinds_now_[i] = kinds_before_[i];
            remainders_[i] = 0;
            mean_sizes_[i] -= mean_sizes_[i] >> 2;
            repeats_[i] = static_cast<u8>(least(repeats_[i] + 1, most_repeats));
        }
        return is_still;
    }

    void code_row(i64 row) {
        const std::span<const i32> neighbours = rows_.of(row);
        const int count = static_cast<int>(neighbours.size());
        const i64 share = count == 0 ? 0 : 65536 / count;
        const i64 nearest = count > 0 ? neighbours[0] : most<i64>(row - 1, 0);
        u64 past = 1;  // hash of the row's magnitudes in the frames before: parts that mirror each other move alike
        for (i64 i = row * components_; before_ && i < (row + 1) * components_; ++i) {
            past = FollowerTable::extended(past, size_of(before_[i]));
            if (second_) past = FollowerTable::extended(past, size_of(second_[i]));
        }
        for (int component = 0; component < components_; ++component) {
            const i64 i = row * components_ + component, near = nearest * components_ + component;
            const i64 last = row > 0 ? i - components_ : i;
            const auto of = [&](int neighbour) { return i64{neighbours[neighbour]} * components_ + component; };
            const auto change_of = [&](i64 other) { return before_ ? now_[other] - bases_[other] : now_[other]; };
            // Means over the neighbours: change from the base, base, size of the remainder, mean size of remainders.
            i64 change = 0, base_around = 0, around = 0, mean_around = 0;
            for (int k = 0; k < count; ++k) {
                change += change_of(of(k));
                if (before_) base_around += bases_[of(k)];
                around += 16 * size_of(remainders_[of(k)]);
                mean_around += mean_sizes_[of(k)];
            }
            change = (change * share) >> 16;
            base_around = (base_around * share) >> 16;
            around = (around * share) >> 16;
            mean_around = (mean_around * share) >> 16;
            i64 base;
            FieldPredictor::Changes changes{};
            if (before_) {
                base = bases_[i];
                changes = {speeds_[i],
                           bends_[i],
                           change,
                           count > 0 ? base_around - base : 0,
                           row > 0 ? change_of(near) : 0,
                           component > 0 ? change_of(i - 1) : 0};
            } else {
                base = count > 0 ? change : row > 0 ? now_[last] : 0;
                for (int k = 0; k < least(count, 3); ++k) changes[k] = now_[of(k)] - base;
                if (row > 0) changes[3] = now_[last] - base;
                if (component > 0 && row > 0) changes[4] = now_[i - 1] - now_[near - 1];
            }
            if (kinds_now_ && code_kind(i, row > 0 ? near : i, last)) {
                now_[i] = base;
                remainders_[i] = 0;
                continue;
            }
            FieldPredictor &predictor = predictors_[way_ * components_ + component];
            const i64 predicted = predictor.predict(base, changes);

            RemainderContext known;
            const i64 own = size_of(remainders_[i]), before_it = row > 0 ? remainders_[last] : 0;
            const i64 across = component > 0 ? remainders_[i - 1] : before_it;
            if (before_ && count > 0) {
                known.expected = 2 * mean_sizes_[i] + 2 * around + mean_around + 16 * (own + 2 * size_of(across));
            } else if (before_) {
                known.expected = 3 * mean_sizes_[i] + 16 * (own + 2 * size_of(across) + 2 * size_of(before_it));
            } else {
                known.expected = 3 * around + 16 * (3 * size_of(across) + 2 * size_of(before_it));
            }
            known.own = own;
            known.around = around >> 4;
            known.across = size_of(across);
            known.mean = mean_sizes_[i] >> 4;
            known.component = least(component, 2);
            known.is_second_guess = way_ >= extrapolated;
            const auto side = [](i64 number) { return number > 0 ? 2 : number < 0 ? 1 : 0; };
            known.signs = 3 * (row > 0 ? side(remainders_[near]) : 0) + side(across);

            // Propose candidates for the value: that of the previous frame, that of a neighbour, and two values that
            // followed the same values before.
            const auto propose = [&](int which, i64 value, int confidence) {
                const i64 remainder = in_steps(value - predicted);
                known.candidates[which] = {size_of(remainder), remainder < 0, 1 + confidence};
            };
            if (before_) propose(0, before_[i], repeats_[i] + 4 * (row > 0 && now_[near] == before_[near]));
            if (row > 0) {
                const int alike = !before_ ? 3 : before_[i] != before_[near] ? 0 : repeats_[i] > 0 ? 1 : 2;
                propose(1, now_[near], 4 * hits_[1] + alike);
            }
            u64 sequence = static_cast<u64>(component);
            if (row > 1)
                sequence =
                    FollowerTable::extended(FollowerTable::extended(sequence, now_[last]), now_[last - components_]);
            const auto propose_follower = [&](int which, const FollowerTable::Slot &slot, bool turns) {
                if (slot.confidence > 0)
                    propose(which, turns ? -slot.value : slot.value, 8 * hits_[which] + slot.confidence);
            };
            const bool is_negative = before_ && before_[i] < 0;
            FollowerTable::Slot &in_time = followers_[0].at(before_ ? past + component : sequence);
            propose_follower(2, in_time, is_negative);
            if (component > 0) {
                sequence = static_cast<u64>(component);
                for (int k = 1; k <= component; ++k) sequence = FollowerTable::extended(sequence, size_of(now_[i - k]));
            } else if (row > 1 && before_) {
                sequence = FollowerTable::extended(sequence, before_[i]);
            }
            FollowerTable::Slot &in_space = followers_[1].at(sequence);
            propose_follower(3, in_space,
                             component > 0 && before_ && before_[i] != 0 && is_negative != (in_space.value < 0));

            i64 remainder = 0;
            if constexpr (mode != Mode::decode) remainder = in_steps(now_[i] - predicted);
            remainder = model_->code(coder_, known, remainder);
            const i64 value = predicted + remainder * coding_.step;
            if (size_of(value) > largest_field_prediction) throw CorruptError("a value of a field is out of range");
            now_[i] = value;
            for (int which = 1; which < RemainderContext::candidate_count; ++which) {
                const RemainderContext::Candidate &one = known.candidates[which];
                if (one.confidence == 0) continue;
                const bool is_right = one.size == size_of(remainder) && one.is_negative == (remainder < 0);
                hits_[which] = (2 * hits_[which] + is_right) & 3;
            }
            in_time.learn(is_negative ? -value : value);
            in_space.learn(value);
            if (remainder != 0) predictor.learn(changes, remainder * coding_.step);
            remainders_[i] = remainder;
            mean_sizes_[i] += (16 * size_of(remainder) - mean_sizes_[i]) >> 2;
            if (before_) repeats_[i] = value == before_[i] ? static_cast<u8>(least(repeats_[i] + 1, most_repeats)) : 0;
        }
    }

    // Return the nearest multiple of the step.
    i64 in_steps(i64 difference) const {
        return coding_.step == 1 ? difference : floor_divide(difference + coding_.step / 2, coding_.step);
    }

    // Code the kind of a value. Return whether it is something other than a finite number.
    bool code_kind(i64 i, i64 near, i64 last) {
        const int before = kinds_before_ ? kinds_before_[i] : 0;
        const int beside = near < i ? kinds_now_[near] : 0, previous = last < i ? kinds_now_[last] : 0;
        u8 &kind = kinds_now_[i];
        if (coder_.bit(is_number_[before][beside][previous], kind == 0)) return kind = 0, false;
        const int expected = before ? before : most(beside, 1);
        if (coder_.bit(is_expected_, kind == expected)) {
            kind = static_cast<u8>(expected);
        } else {
            const int lower = expected == 1 ? 2 : 1, higher = 6 - expected - lower;
            kind = static_cast<u8>(coder_.bit(is_higher_, kind == higher) ? higher : lower);
        }
        return true;
    }

    RangeCoder<mode> &coder_;
    const FieldRows &rows_;
    int components_;
    FieldCoding coding_;
    i64 width_;  // number of values in a frame
    std::span<i64> values_;
    std::span<u8> kinds_;
    std::vector<FrameReferences> references_;

    // State for the frame that is being coded.
    Way way_ = spatial;
    i64 *now_ = nullptr;
    const i64 *before_ = nullptr, *second_ = nullptr;
    u8 *kinds_now_ = nullptr, *kinds_before_ = nullptr;
    std::vector<i64> bases_, speeds_, bends_;

    // For each value, as of the latest frame: its remainder, the mean size of its remainders [1/16], and for how many
    // frames in a row it has not changed.
    std::vector<i64> remainders_, mean_sizes_;
    std::vector<u8> repeats_;

    std::vector<FieldPredictor> predictors_;
    FollowerTable followers_[2];
    int hits_[RemainderContext::candidate_count]{};  // for each candidate, whether it was right the last two times
    std::vector<u8> span_histories_;                 // for each span, whether it was unchanged in the frames before
    std::vector<BitModel> by_span_;
    BitModel by_beside_[8][4], is_number_[field_kinds][field_kinds][field_kinds], is_expected_, is_higher_;
    Weights<2> still_weights_;
    std::unique_ptr<RemainderModel> model_ = std::make_unique<RemainderModel>();
};

void append(std::vector<u8> &data, std::span<const u8> more) {
    const std::size_t size = data.size();
    data.resize(size + more.size());
    std::copy(more.begin(), more.end(), data.begin() + static_cast<std::ptrdiff_t>(size));
}

// Return rows with a single row, for coding functions of time.
FieldRows single_row() {
    const ConnectivityView object{};
    return FieldRows(Domain::object, {&object, 1});
}

FieldCoding decode_predicted(const FieldRows &rows, std::span<const u8> data, i64 frames, int components,
                             std::span<i64> values, std::vector<u8> &kinds) {
    if (data.size() < 2 || data[0] >= 2 * has_kinds || data[0] % has_kinds > most_field_levels || data[1] % 2 == 0) {
        throw CorruptError("a chunk of a field has an unknown method");
    }
    const FieldCoding coding{.levels = static_cast<u8>(data[0] % has_kinds), .step = data[1]};
    kinds.assign(data[0] & has_kinds ? values.size() : 0, 0);
    RangeCoder<Mode::decode> coder(data.subspan(2));
    FieldCoder<Mode::decode>(coder, rows, frames, components, coding, values, kinds).code();
    if (!coder.is_finished()) throw CorruptError("a chunk of a field does not end with its values");
    return coding;
}

// Read functions of time and coefficients, and advance `data` to the bytes that follow them.
FieldTransform decode_transform(const FieldRows &rows, std::span<const u8> &data, i64 frames, int components) {
    constexpr std::size_t head = 2, sizes = 8;
    const std::size_t count = data.size() < head ? 0 : data[1];
    if (count == 0 || count > FieldTransform::most_functions || static_cast<i64>(count) > frames ||
        data.size() < head + count + sizes) {
        throw CorruptError("a transformed chunk of a field has a damaged head");
    }
    FieldTransform found;
    found.digits.assign(data.begin() + head, data.begin() + head + count);
    data = data.subspan(head + count);
    const auto size_at = [&](int first) {
        return static_cast<std::size_t>(data[first]) | static_cast<std::size_t>(data[first + 1]) << 8 |
               static_cast<std::size_t>(data[first + 2]) << 16 | static_cast<std::size_t>(data[first + 3]) << 24;
    };
    const std::size_t of_functions = size_at(0), of_coefficients = size_at(4);
    data = data.subspan(sizes);
    if (of_functions > data.size() || of_coefficients > data.size() - of_functions) {
        throw CorruptError("a transformed chunk of a field is too short");
    }
    std::vector<u8> kinds;
    found.functions.resize(frames * count);
    decode_predicted(single_row(), data.first(of_functions), frames, static_cast<int>(count), found.functions, kinds);
    found.coefficients.resize(rows.count() * components * count);
    decode_predicted(rows, data.subspan(of_functions, of_coefficients), 1, static_cast<int>(components * count),
                     found.coefficients, kinds);
    for (std::size_t i = 0; i < found.coefficients.size(); ++i) {
        const int digits = found.digits[i % count];
        if (digits > FieldTransform::most_digits || size_of(found.coefficients[i]) > i64{2} << digits) {
            throw CorruptError("a coefficient of a field is out of range");
        }
    }
    data = data.subspan(of_functions + of_coefficients);
    return found;
}

}  // namespace

void FieldTransform::add_to(std::span<i64> values, i64 frames, i64 width) const {
    const std::size_t count = digits.size();
    for (i64 frame = 0; frame < frames; ++frame) {
        for (i64 i = 0; i < width; ++i) {
            i64 sum = 0;
            for (std::size_t k = 0; k < count; ++k) {
                sum += (functions[frame * count + k] * coefficients[i * count + k]) >> digits[k];
            }
            values[frame * width + i] += sum;
        }
    }
}

std::vector<u8> encode_field_chunk(const FieldRows &rows, std::span<const i64> values, std::span<const u8> kinds,
                                   i64 frames, int components, FieldCoding coding) {
    std::vector<i64> decoded(values.begin(), values.end());
    std::vector<u8> own_kinds(kinds.begin(), kinds.end());
    RangeCoder<Mode::encode> coder;
    FieldCoder<Mode::encode>(coder, rows, frames, components, coding, decoded, own_kinds).code();
    std::vector<u8> data(2);
    data[0] = static_cast<u8>(coding.levels | (kinds.empty() ? 0 : has_kinds));
    data[1] = coding.step;
    append(data, coder.finish());
    return data;
}

std::vector<u8> encode_transformed_field_chunk(const FieldRows &rows, std::span<const i64> values, i64 frames,
                                               int components, FieldCoding coding, FieldTransform transform) {
    const int count = static_cast<int>(transform.digits.size());
    const FieldCoding of_time{.levels = coding.levels, .step = function_step};
    const std::vector<u8> functions = encode_field_chunk(single_row(), transform.functions, {}, frames, count, of_time);
    std::vector<u8> kinds;
    decode_predicted(single_row(), functions, frames, count, transform.functions, kinds);
    const std::vector<u8> coefficients =
        encode_field_chunk(rows, transform.coefficients, {}, 1, components * count, {});
    std::vector<i64> remainder(values.size());
    transform.add_to(remainder, frames, rows.count() * components);
    for (std::size_t i = 0; i < values.size(); ++i) remainder[i] = values[i] - remainder[i];
    std::vector<u8> data(2);
    data[0] = is_transformed;
    data[1] = static_cast<u8>(count);
    append(data, transform.digits);
    for (const std::size_t size : {functions.size(), coefficients.size()}) {
        for (int shift = 0; shift < 32; shift += 8) data.push_back(static_cast<u8>(size >> shift));
    }
    append(data, functions);
    append(data, coefficients);
    append(data, encode_field_chunk(rows, remainder, {}, frames, components, coding));
    return data;
}

u64 field_predictor_bytes(std::span<const u8> data, i64 rows, i64 components) {
    if (rows == 0) return 0;
    const bool has_functions = data.size() > 1 && data[0] == is_transformed;
    const u64 functions = has_functions ? least<u64>(data[1], FieldTransform::most_functions) : 1;
    return FieldCoder<Mode::decode>::predictor_bytes * static_cast<u64>(components) * most<u64>(functions, 1);
}

FieldCoding decode_field_chunk(const FieldRows &rows, std::span<const u8> data, i64 frames, int components,
                               std::span<i64> values, std::vector<u8> &kinds) {
    if (data.empty() || data[0] != is_transformed) {
        return decode_predicted(rows, data, frames, components, values, kinds);
    }
    const FieldTransform transform = decode_transform(rows, data, frames, components);
    const FieldCoding coding = decode_predicted(rows, data, frames, components, values, kinds);
    transform.add_to(values, frames, rows.count() * components);
    for (const i64 value : values) {
        if (size_of(value) > largest_field_prediction) throw CorruptError("a value of a field is out of range");
    }
    return coding;
}

}  // namespace pdeanim
