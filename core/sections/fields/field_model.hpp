// A model of remainders: whole numbers, small ones the likelier, some of which were announced by candidates.
#pragma once

#include <array>
#include <vector>

#include "base/arithmetic.hpp"
#include "entropy/range_coder.hpp"

namespace pdeanim {

// What is known about a remainder.
struct RemainderContext {
    static constexpr int most_candidates = 4;

    // A number that may come again, as a remainder; without confidence (-1) there is none.
    struct Candidate {
        i64 size = 0;
        bool is_negative = false;
        int confidence = -1;  // up to 31
    };

    i64 expected = 0;                     // size [1/128]
    i64 own = 0, around = 0, across = 0;  // sizes of the same row before, of its neighbours, of the value before
    i64 mean = 0;                         // of the sizes of the same row before [1/16]
    int component = 0, way = 0, signs = 0;
    std::array<Candidate, most_candidates> candidates;
};

class RemainderModel {
public:
    RemainderModel() {
        for (auto &candidate : by_candidate_) {
            for (auto &position : candidate) {
                for (int kind = 1; kind < 65; ++kind) {
                    for (int time = 0; time < 3; ++time) position[kind].adapt(kind % 2 == 0);
                }
            }
        }
    }

    template <Mode mode> i64 code(RangeCoder<mode> &coder, const RemainderContext &known, i64 remainder) {
        const int guess = least(bit_length((known.expected * 3) >> 9), most_digits - 1);
        const auto relative = [&](i64 size) { return clamp(bit_length(size) - guess + 2, 0, 5); };
        const int scale = least(guess, 6);
        contexts_[0] = by_expected_[known.way > 1][class_of(known.expected)].data();
        contexts_[1] = by_sizes_[scale][relative(known.own)][relative(known.around)].data();
        contexts_[2] =
            by_across_[least(known.component, 2)][scale][relative(known.across)][relative(known.mean >> 4)].data();
        alive_ = 0;
        for (int i = 0; i < candidates; ++i) {
            if (known.candidates[i].confidence >= 0) alive_ |= 1 << i;
        }
        const int wanted = bit_length(size_of(remainder));
        const auto exceeds = [&](int digits, int way) {
            return decide(coder, known, (way ? 16 : 0) + least(digits, 15), wanted > digits,
                          [&](const auto &candidate) { return bit_length(candidate.size) > digits; });
        };
        int digits = guess;
        if (exceeds(digits, 0)) {
            ++digits;
            while (digits < most_digits && exceeds(digits, 0)) ++digits;
        } else {
            while (digits > 0 && !exceeds(digits - 1, 1)) --digits;
        }
        if (digits == 0) return 0;
        contexts_[1] = by_signs_[known.signs].data();
        const bool is_negative =
            decide(coder, known, 32, remainder < 0, [&](const auto &candidate) { return candidate.is_negative; });
        i64 found = 1;
        for (int place = digits - 2; place >= 0; --place) {
            const bool bit = (size_of(remainder) >> place) & 1;
            const int done = digits - 2 - place;
            if (done < 2) {
                found = 2 * found + decide(coder, known, 33 + 3 * least(digits, 15) + static_cast<int>(found) - 1, bit,
                                           [&](const auto &candidate) { return (candidate.size >> place) & 1; });
            } else if (alive_) {
                found = 2 * found + decide(coder, known, 81 + least(place, 15), bit,
                                           [&](const auto &candidate) { return (candidate.size >> place) & 1; });
            } else {
                found = 2 * found + coder.bypass(bit);
            }
        }
        return is_negative ? -found : found;
    }

private:
    static constexpr int candidates = RemainderContext::most_candidates, inputs = 3 + candidates;
    static constexpr int most_digits = 44, positions = 97, classes = 48;
    using Models = std::array<BitModel, positions>;

    static int class_of(i64 expected) {
        const i64 number = expected >> 3;
        if (number < 4) return static_cast<int>(number);
        const int digits = bit_length(number);
        return least(static_cast<int>(4 + 4 * (digits - 3) + ((number >> (digits - 3)) & 3)), classes - 1);
    }

    template <Mode mode, class Expect>
    bool decide(RangeCoder<mode> &coder, const RemainderContext &known, int position, bool bit, const Expect &expect) {
        std::array<BitModel *, inputs> chosen;
        for (int i = 0; i < 3; ++i) chosen[i] = &contexts_[i][position];
        int expected = 0;
        for (int i = 0; i < candidates; ++i) {
            int kind = 0;
            if (alive_ >> i & 1) {
                const int one = expect(known.candidates[i]) ? 1 : 0;
                expected |= one << i;
                kind = 1 + 2 * known.candidates[i].confidence + one;
            }
            chosen[3 + i] = &by_candidate_[i][position][kind];
        }
        bit = coder.template mixed<inputs>(chosen, weights_[position][alive_].data(), bit);
        alive_ &= bit ? expected : ~expected;
        return bit;
    }

    BitModel *contexts_[3] = {};
    int alive_ = 0;
    std::vector<std::array<Models, classes>> by_expected_ = std::vector<std::array<Models, classes>>(2);
    std::vector<std::array<std::array<Models, 6>, 6>> by_sizes_ = std::vector<std::array<std::array<Models, 6>, 6>>(7);
    std::vector<std::array<std::array<std::array<Models, 6>, 6>, 7>> by_across_ =
        std::vector<std::array<std::array<std::array<Models, 6>, 6>, 7>>(3);
    std::vector<Models> by_signs_ = std::vector<Models>(9);
    std::array<std::array<BitModel, 65>, positions> by_candidate_[candidates];
    std::array<std::array<Weights<inputs>, 1 << candidates>, positions> weights_;
};

}  // namespace pdeanim
