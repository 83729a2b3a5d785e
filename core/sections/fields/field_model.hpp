// The context model of remainders: whole numbers, mostly small, some of which candidates predict.
#pragma once

#include <array>
#include <vector>

#include "base/arithmetic.hpp"
#include "entropy/range_coder.hpp"

namespace pdeanim {

// The context of a remainder: known data around it.
struct RemainderContext {
    // The remainder of the value under the assumption that an earlier value returns. There is no candidate if the
    // confidence is 0.
    struct Candidate {
        i64 size = 0;
        bool is_negative = false;
        int confidence = 0;  // 1 to 32
    };
    static constexpr int candidate_count = 4;

    i64 expected = 0;  // expected magnitude [1/128]
    i64 own = 0, around = 0,
        across = 0;                // magnitudes: same row in the frame before; neighbours; value before
    i64 mean = 0;                  // mean magnitude of the row in the frames before
    int component = 0, signs = 0;  // up to 2; signs of a neighbour's remainder and of the value before it, 0 to 8
    bool is_second_guess = false;  // whether two or more frames predict the value
    std::array<Candidate, candidate_count> candidates;
};

class RemainderModel {
public:
    RemainderModel() {
        for (auto &position : weights_) {
            for (auto &own : position) own.fill(first_weight);
        }
        for (auto &candidate : by_candidate_) {
            for (auto &position : candidate) {
                for (int kind = 2; kind < candidate_kinds; ++kind) {
                    for (int time = 0; time < first_trust; ++time) position[kind].adapt(kind % 2 == 1);
                }
            }
        }
    }

    // Code the number of digits of a remainder, counted up or down from a guess; then the sign and the digits after the
    // leading one.
    //
    // A candidate that agrees with all bits so far is a witness: it predicts the next bit.
    template <Mode mode> i64 code(RangeCoder<mode> &coder, const RemainderContext &known, i64 remainder) {
        const int guess = least(bit_length((known.expected * 3) >> 9), most_digits - 1), scale = least(guess, 6);
        const auto relative = [&](i64 size) { return clamp(bit_length(size) - guess + 2, 0, 5); };
        contexts_ = {by_expected_[known.is_second_guess][class_of(known.expected)].data(),
                     by_sizes_[scale][relative(known.own)][relative(known.around)].data(),
                     by_across_[known.component][scale][relative(known.across)][relative(known.mean)].data()};
        witnesses_ = 0;
        for (int i = 0; i < candidates; ++i) witnesses_ |= (known.candidates[i].confidence > 0) << i;
        const i64 size = size_of(remainder);
        const auto exceeds = [&](int digits, int first_position) {
            return decide(coder, known, first_position + least(digits, 15), bit_length(size) > digits,
                          [&](const auto &candidate) { return bit_length(candidate.size) > digits; });
        };
        int digits = guess;
        if (exceeds(digits, rising)) {
            do ++digits;
            while (digits < most_digits && exceeds(digits, rising));
        } else {
            while (digits > 0 && !exceeds(digits - 1, falling)) --digits;
        }
        if (digits == 0) return 0;
        contexts_[1] = by_signs_[known.signs].data();
        const bool is_negative =
            decide(coder, known, sign, remainder < 0, [](const auto &candidate) { return candidate.is_negative; });
        i64 found = 1;
        for (int place = digits - 2; place >= 0; --place) {
            bool bit = (size >> place) & 1;
            const bool is_upper = place >= digits - 3;
            if (is_upper || witnesses_ != 0) {
                const int position =
                    is_upper ? upper + 3 * least(digits, 15) + static_cast<int>(found) - 1 : lower + least(place, 15);
                bit = decide(coder, known, position, bit,
                             [&](const auto &candidate) { return ((candidate.size >> place) & 1) != 0; });
            } else {
                bit = coder.bypass(bit);
            }
            found = 2 * found + bit;
        }
        return is_negative ? -found : found;
    }

private:
    static constexpr int candidates = RemainderContext::candidate_count, inputs = 3 + candidates;
    static constexpr int most_digits = 44, classes = 48, candidate_kinds = 2 + 2 * 32;
    static constexpr int rising = 0, falling = 16, sign = 32, upper = 33, lower = 81, positions = 97;
    static constexpr i32 first_weight = 14500;  // [1/65536]; with a sum of 1.2 the bytes grow by 1 %
    static constexpr int first_trust = 4;  // right predictions that a candidate starts with; with 0 fields grow by 4 %
    using Models = std::array<BitModel, positions>;
    template <int count> using Relative = std::array<std::array<std::array<Models, 6>, 6>, count>;

    static int class_of(i64 expected) {
        const i64 number = expected >> 3;
        const int digits = bit_length(number);
        return digits < 3 ? static_cast<int>(number)
                          : least(4 * (digits - 2) + static_cast<int>((number >> (digits - 3)) & 3), classes - 1);
    }

    template <Mode mode, class Expect>
    bool decide(RangeCoder<mode> &coder, const RemainderContext &known, int position, bool bit, const Expect &expect) {
        std::array<BitModel *, inputs> chosen;
        for (int i = 0; i < inputs - candidates; ++i) chosen[i] = &contexts_[i][position];
        int expected = 0;
        for (int i = 0; i < candidates; ++i) {
            int kind = 0;
            if (witnesses_ >> i & 1) {
                const int one = expect(known.candidates[i]) ? 1 : 0;
                expected |= one << i;
                kind = 2 * known.candidates[i].confidence + one;
            }
            chosen[inputs - candidates + i] = &by_candidate_[i][position][kind];
        }
        u16 &uses = uses_[position][witnesses_];
        const int shift = uses < 64 ? 12 : uses < 1024 ? 13 : 14;
        uses += uses < 1024;
        bit = coder.template mixed<inputs>(chosen, weights_[position][witnesses_].data(), bit, shift);
        witnesses_ &= bit ? expected : ~expected;
        return bit;
    }

    std::array<BitModel *, inputs - candidates> contexts_{};
    int witnesses_ = 0;  // the candidates that are still witnesses, as bits
    std::array<std::array<BitModel, candidate_kinds>, positions> by_candidate_[candidates];
    std::array<std::array<Weights<inputs>, 1 << candidates>, positions> weights_;
    std::array<std::array<u16, 1 << candidates>, positions> uses_{};
    std::vector<std::array<Models, classes>> by_expected_ = std::vector<std::array<Models, classes>>(2);
    Relative<7> by_sizes_;
    std::array<Relative<7>, 3> by_across_;
    std::array<Models, 9> by_signs_;
};

}  // namespace pdeanim
