#include "sections/fields/field_chunk.hpp"

#include <algorithm>
#include <array>

#include "base/errors.hpp"
#include "sections/fields/field_model.hpp"

namespace pdeanim {

namespace {

constexpr u8 has_kinds = 16;  // flag of a chunk's first byte, above the levels
constexpr i64 largest_prediction = 2 * largest_field_value;

// The frames that predict a frame, -1 for none: `before` and `after` at the distance, `second` and `beyond` farther away
// on either side.
struct FrameReferences {
    i64 frame, before, after, second, beyond;
};

// The order in which frames are coded, and what predicts each.
std::vector<FrameReferences> schedule(i64 frames, int levels) {
    std::vector<FrameReferences> found;
    for (int level = levels; level >= 0; --level) {
        const i64 distance = i64{1} << level;
        const bool is_top = level == levels;
        for (i64 frame = is_top ? 0 : distance; frame < frames; frame += is_top ? distance : 2 * distance) {
            const bool has_after = !is_top && frame + distance < frames;
            const i64 second = has_after ? frame - 3 * distance : frame - 2 * distance;
            const i64 beyond = frame + 3 * distance;
            found.push_back({frame, std::max<i64>(frame - distance, -1), has_after ? frame + distance : -1,
                             std::max<i64>(second, -1), has_after && beyond < frames ? beyond : -1});
        }
    }
    return found;
}

// A prediction: a base plus a sum of changes with weights that learn (normalised least mean squares, in integers).
class FieldPredictor {
public:
    static constexpr int inputs = 6;
    using Changes = std::array<i64, inputs>;

    i64 predict(i64 base, const Changes &changes) const {
        i64 total = (base << fraction_bits) + (1 << (fraction_bits - 1));
        for (int i = 0; i < inputs; ++i) total += weights[i] * changes[i];
        return clamp(total >> fraction_bits, -largest_prediction, largest_prediction);
    }

    void learn(Changes changes, i64 miss) {
        i64 largest = size_of(miss);
        for (const i64 change : changes) largest = most(largest, size_of(change));
        const int scale = most(0, bit_length(largest) - input_digits);
        i64 power = power_floor;
        for (i64 &change : changes) {
            change >>= scale;
            power += change * change;
        }
        const i64 gain = floor_divide((miss >> scale) << 20, power);
        for (int i = 0; i < inputs; ++i) {
            weights[i] = clamp(weights[i] + ((gain * changes[i]) >> learning_shift), -largest_weight, largest_weight);
        }
    }

    Changes weights{};

    static constexpr int fraction_bits = 16;

private:
    static constexpr i64 largest_weight = 4 << fraction_bits;
    static constexpr int input_digits = 12;
    static constexpr i64 power_floor = 16;
    static constexpr int learning_shift = 9;
};

// Tables of numbers that followed a context: the latest, and how often it was right.
class FollowerTable {
public:
    struct Slot {
        i64 value = 0;
        u8 confidence = 0;
    };
    Slot &at(u64 context) { return slots_[((context ^ context >> 29) * 0x9E3779B97F4A7C15u) >> (64 - table_bits)]; }
    static void learn(Slot &slot, i64 value) {
        if (slot.confidence > 0 && slot.value == value) {
            slot.confidence = static_cast<u8>(least(slot.confidence + 1, most_confidence));
        } else {
            slot = {value, 1};
        }
    }
    static constexpr int most_confidence = 7;

private:
    static constexpr int table_bits = 14;
    std::vector<Slot> slots_ = std::vector<Slot>(1 << table_bits);
};

template <Mode mode> class FieldCoder {
public:
    FieldCoder(RangeCoder<mode> &coder, const FieldDomain &domain, i64 frames, int components, FieldCoding coding,
               std::span<i64> values, std::span<u8> kinds)
        : coder_(coder), domain_(domain), frames_(frames), components_(components), coding_(coding),
          width_(domain.rows() * components), values_(values), kinds_(kinds) {}

    void code() {
        base_.resize(width_);
        first_change_.resize(width_);
        second_change_.resize(width_);
        remainders_.assign(width_, 0);
        mean_sizes_.assign(width_, 0);
        repeats_.assign(width_, 0);
        predictors_.resize(4 * components_);
        for (int component = 0; component < components_; ++component) {
            const i64 one = 1 << FieldPredictor::fraction_bits;
            predictors_[component].weights = {};
            predictors_[components_ + component].weights = {0, 0, one / 2, 0, 0, 0};
            predictors_[2 * components_ + component].weights = {one / 4, 0, one / 2, 0, 0, 0};
            predictors_[3 * components_ + component].weights = {0, one / 2, one / 4, 0, 0, 0};
        }
        is_repeated_.assign(domain_.rows() / span_rows + 2, 0);
        span_models_.assign(domain_.rows() / span_rows + 1, {});
        for (const FrameReferences &references : schedule(frames_, coding_.levels)) code_frame(references);
    }

private:
    static constexpr i64 span_rows = 16;

    static u64 mixed_in(u64 context, i64 number) { return (context + static_cast<u64>(number)) * 0x2545F4914F6CDD1Du; }

    const i64 *row(i64 frame) const { return frame < 0 ? nullptr : values_.data() + frame * width_; }

    void code_frame(const FrameReferences &references) {
        coder_.check_not_ended();
        now_ = values_.data() + references.frame * width_;
        kinds_now_ = kinds_.empty() ? nullptr : kinds_.data() + references.frame * width_;
        kinds_before_ = kinds_.empty() || references.before < 0 ? nullptr : kinds_.data() + references.before * width_;
        before_ = row(references.before);
        const i64 *second = second_ = row(references.second), *after = row(references.after),
                  *beyond = row(references.beyond);
        way_ = !before_ ? 0 : after ? 3 : second ? 2 : 1;
        if (before_) {
            for (i64 i = 0; i < width_; ++i) {
                if (after) {
                    base_[i] = (before_[i] + after[i]) >> 1;
                    first_change_[i] = after[i] - before_[i];
                    second_change_[i] = second && beyond ? (before_[i] + after[i] - second[i] - beyond[i]) >> 3 : 0;
                } else {
                    base_[i] = before_[i];
                    first_change_[i] = second ? before_[i] - second[i] : 0;
                    second_change_[i] = 0;
                }
            }
        }
        const bool has_spans = way_ == 1 || way_ == 2;
        bool previous = false;
        for (i64 first = 0, span = 0; first < domain_.rows(); first += span_rows, ++span) {
            const i64 last = std::min(first + span_rows, domain_.rows());
            if (has_spans) {
                u8 &history = is_repeated_[span];
                bool is_same = false;
                if constexpr (mode != Mode::decode) {
                    is_same =
                        std::equal(now_ + first * components_, now_ + last * components_,
                                   before_ + first * components_) &&
                        (!kinds_now_ || std::equal(kinds_now_ + first * components_, kinds_now_ + last * components_,
                                                   kinds_before_ + first * components_));
                }
                const int beside = 2 * previous + (is_repeated_[span + 1] & 1);
                is_same = coder_.template mixed<2>({&span_beside_[history & 7][beside], &span_models_[span]},
                                                   span_weights_.data(), is_same);
                history = static_cast<u8>(2 * history + is_same);
                previous = is_same;
                if (is_same) {
                    for (i64 i = first * components_; i < last * components_; ++i) {
                        now_[i] = before_[i];
                        if (kinds_now_) kinds_now_[i] = kinds_before_[i];
                        remainders_[i] = 0;
                        repeats_[i] = static_cast<u8>(least(repeats_[i] + 1, 3));
                        mean_sizes_[i] -= mean_sizes_[i] >> 2;
                    }
                    continue;
                }
            }
            for (i64 place = first; place < last; ++place) code_row(place);
        }
    }

    void code_row(i64 place) {
        const std::span<const i32> neighbours = domain_.of(place);
        const int count = static_cast<int>(neighbours.size());
        const i64 share = count == 0 ? 0 : 65536 / count;
        if (before_) {
            past_ = 1;
            for (i64 i = place * components_; i < (place + 1) * components_; ++i) {
                past_ = mixed_in(past_, size_of(before_[i]));
                if (second_) past_ = mixed_in(past_, size_of(second_[i]));
            }
        }
        for (int component = 0; component < components_; ++component) {
            const i64 i = place * components_ + component;
            // The neighbours: their change from their base, their base, and the sizes of their remainders.
            i64 change = 0, level = 0, nearest = 0, sizes = 0, means = 0, sign = 0;
            for (const i32 other : neighbours) {
                const i64 j = i64{other} * components_ + component;
                change += before_ ? now_[j] - base_[j] : now_[j];
                if (before_) level += base_[j];
                sizes += size_of(remainders_[j]);
                means += mean_sizes_[j];
            }
            change = (change * share) >> 16;
            level = (level * share) >> 16;
            sizes = (sizes * 16 * share) >> 16;
            means = (means * share) >> 16;
            const i64 beside = place > 0 ? i - components_ : i;  // the previous place
            const i64 j = count > 0 ? i64{neighbours[0]} * components_ + component : beside;
            i64 base;
            FieldPredictor::Changes changes;
            if (before_) {
                base = base_[i];
                nearest = count > 0 || place > 0 ? now_[j] - base_[j] : 0;
                changes = {first_change_[i],         second_change_[i], change,
                           count ? level - base : 0, nearest,           component ? now_[i - 1] - base_[i - 1] : 0};
            } else {
                base = count > 0 ? change : place > 0 ? now_[beside] : 0;
                changes = {count > 0 ? now_[j] - base : 0,
                           count > 1 ? now_[i64{neighbours[1]} * components_ + component] - base : 0,
                           place > 0 ? now_[beside] - base : 0,
                           count > 2 ? now_[i64{neighbours[2]} * components_ + component] - base : 0,
                           0,
                           component && place > 0 ? now_[i - 1] - now_[j - 1] : 0};
            }
            if (kinds_now_ && code_kind(i, j, beside)) {
                now_[i] = base;
                remainders_[i] = 0;
                continue;
            }
            FieldPredictor &predictor = predictors_[way_ * components_ + component];
            const i64 predicted = predictor.predict(base, changes);
            const i64 last = place > 0 ? remainders_[beside] : 0;
            const i64 own = remainders_[i];
            const i64 across = component ? remainders_[i - 1] : last;
            if (count > 0) sign = remainders_[j];
            RemainderContext known;
            const i64 own_mean = mean_sizes_[i];
            if (!before_ || count == 0) {
                known.expected = before_ ? 3 * own_mean + 16 * (size_of(own) + 2 * size_of(across) + 2 * size_of(last))
                                         : 3 * sizes + 16 * (3 * size_of(across) + 2 * size_of(last));
            } else {
                known.expected = 2 * own_mean + 2 * sizes + means + 16 * (size_of(own) + 2 * size_of(across));
            }
            known.own = size_of(own);
            known.around = sizes >> 4;
            known.across = size_of(across);
            known.mean = own_mean;
            known.component = component;
            known.way = way_;
            known.signs = 3 * (sign > 0 ? 2 : sign < 0) + (across > 0 ? 2 : across < 0);
            // Numbers that may return: the one before, a neighbour's, and those that followed the same numbers.
            const auto propose = [&](int which, i64 value, int confidence) {
                const i64 remainder = divide_by_step(value - predicted);
                known.candidates[which] = {size_of(remainder), remainder < 0, confidence};
            };
            if (before_) {
                propose(0, before_[i], repeats_[i] + 4 * (count == 0 && place == 0 ? 2 : now_[j] == before_[j]));
            }
            if (place > 0) {
                const int alike = !before_                   ? 3
                                  : before_[i] == before_[j] ? 1 + (base_[i] == base_[j] && repeats_[i] == repeats_[j])
                                                             : 0;
                propose(1, now_[j], 4 * hits_[1] + alike);
            }
            // What followed the same row in the frames before, whatever the signs: mirrored parts move alike.
            u64 context = component;
            if (before_) {
                context = past_;
            } else if (place > 1) {
                context = mixed_in(mixed_in(context, now_[beside]), now_[beside - components_]);
            }
            auto &one = followers_[0].at(context + component);
            if (one.confidence) {
                const i64 own_value = before_ ? before_[i] : 0;
                propose(2, own_value < 0 ? -one.value : one.value, 8 * hits_[2] + one.confidence);
            }
            context = component + 77;
            if (component) {
                for (int k = 1; k <= component; ++k) context = mixed_in(context, size_of(now_[i - k]));
            } else if (place > 1) {
                context = mixed_in(mixed_in(context, now_[beside]), now_[beside - components_]);
                if (before_) context = mixed_in(context, before_[i]);
            }
            auto &other = followers_[1].at(context);
            if (other.confidence) {
                const i64 own_value = component && before_ ? before_[i] : 0;
                propose(
                    3, component && own_value != 0 && (own_value < 0) != (other.value < 0) ? -other.value : other.value,
                    8 * hits_[3] + other.confidence);
            }

            i64 remainder = 0;
            if constexpr (mode != Mode::decode) remainder = divide_by_step(now_[i] - predicted);
            remainder = model_.code(coder_, known, remainder);
            const i64 value = predicted + remainder * coding_.step;
            if (size_of(value) > largest_prediction) throw CorruptError("a value of a field is out of range");
            now_[i] = value;
            for (int which = 1; which < 4; ++which) {
                const auto &candidate = known.candidates[which];
                if (candidate.confidence >= 0) {
                    hits_[which] = (2 * hits_[which] + (candidate.size == size_of(remainder) &&
                                                        (candidate.is_negative == (remainder < 0)))) &
                                   3;
                }
            }
            FollowerTable::learn(one, before_ && before_[i] < 0 ? -value : value);
            FollowerTable::learn(other, value);
            if (remainder != 0) predictor.learn(changes, remainder * coding_.step);
            remainders_[i] = remainder;
            mean_sizes_[i] += (16 * size_of(remainder) - own_mean) >> 2;
            if (before_) repeats_[i] = value == before_[i] ? static_cast<u8>(least(repeats_[i] + 1, 3)) : 0;
        }
    }

    // The nearest multiple of the step, which is odd.
    i64 divide_by_step(i64 difference) const {
        if (coding_.step == 1) return difference;
        return floor_divide(difference + coding_.step / 2, coding_.step);
    }

    bool code_kind(i64 i, i64 neighbour, i64 beside) {
        const int before = kinds_before_ ? kinds_before_[i] : 0;
        const int near = neighbour < i ? kinds_now_[neighbour] : 0, last = beside < i ? kinds_now_[beside] : 0;
        u8 &kind = kinds_now_[i];
        if (coder_.bit(is_number_[before][near][last], kind == 0)) return kind = 0, false;
        int expected = before ? before : near;
        if (expected == 0) expected = 1;
        if (coder_.bit(is_expected_, kind == expected)) {
            kind = static_cast<u8>(expected);
        } else {
            const int lower = expected == 1 ? 2 : 1, upper = expected == 3 ? 2 : 3;
            kind = static_cast<u8>(coder_.bit(is_upper_, kind == upper) ? upper : lower);
        }
        return true;
    }

    RangeCoder<mode> &coder_;
    const FieldDomain &domain_;
    i64 frames_;
    int components_;
    FieldCoding coding_;
    i64 width_;
    std::span<i64> values_;
    std::span<u8> kinds_;
    i64 *now_ = nullptr;
    const i64 *before_ = nullptr, *second_ = nullptr;
    u64 past_ = 0;
    u8 *kinds_now_ = nullptr;
    const u8 *kinds_before_ = nullptr;
    int way_ = 0;
    std::vector<i64> base_, first_change_, second_change_;
    std::vector<i64> remainders_, mean_sizes_;  // of each value of a frame: the latest
    std::vector<u8> repeats_;
    std::vector<FieldPredictor> predictors_;
    std::vector<u8> is_repeated_;
    std::vector<BitModel> span_models_;
    BitModel span_beside_[8][4];
    Weights<2> span_weights_;
    BitModel is_number_[4][4][4], is_expected_, is_upper_;
    FollowerTable followers_[2];
    int hits_[4]{};
    RemainderModel model_;
};

}  // namespace

std::vector<u8> encode_field_chunk(const FieldDomain &domain, std::span<const i64> values, std::span<const u8> kinds,
                                   i64 frames, int components, FieldCoding coding) {
    std::vector<i64> decoded(values.begin(), values.end());
    std::vector<u8> own_kinds(kinds.begin(), kinds.end());
    RangeCoder<Mode::encode> coder;
    FieldCoder<Mode::encode>(coder, domain, frames, components, coding, decoded, own_kinds).code();
    std::vector<u8> data = {static_cast<u8>(coding.levels | (kinds.empty() ? 0 : has_kinds)),
                            static_cast<u8>(coding.step)};
    const std::vector<u8> coded = coder.finish();
    data.insert(data.end(), coded.begin(), coded.end());
    return data;
}

void decode_field_chunk(const FieldDomain &domain, std::span<const u8> data, i64 frames, int components,
                        std::span<i64> values, std::vector<u8> &kinds) {
    if (data.size() < 2 || data[0] >= 2 * has_kinds || data[0] % has_kinds > most_field_levels || data[1] % 2 == 0) {
        throw CorruptError("a chunk of a field has an unknown method");
    }
    const FieldCoding coding{.levels = static_cast<u8>(data[0] % has_kinds), .step = data[1]};
    kinds.assign(data[0] & has_kinds ? values.size() : 0, 0);
    RangeCoder<Mode::decode> coder(data.subspan(2));
    FieldCoder<Mode::decode>(coder, domain, frames, components, coding, values, kinds).code();
    if (!coder.is_finished()) throw CorruptError("a chunk of a field does not end with its values");
}

}  // namespace pdeanim
