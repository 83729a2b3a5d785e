// Models of whole numbers: of any size, in sequences that repeat (MatchModel), and in lists.
#pragma once

#include <array>
#include <optional>
#include <span>
#include <vector>

#include "base/arithmetic.hpp"
#include "entropy/range_coder.hpp"

namespace pdeanim {

// Numbers from 0 to 2^32 - 2 (enough for twice the largest vertex index and a sign): the number of binary digits in
// unary, then the digits. The first three digits after the leading one have the digits before them as context. Later
// digits are nearly random and cost a bit each.
class NumberModel {
public:
    template <Mode mode> i64 code(RangeCoder<mode> &coder, i64 value) {
        int digits = 1;
        while (digits < most_digits && coder.bit(more_[digits], (value + 1) >> digits > 0)) ++digits;
        i64 found = 1;
        for (int place = digits - 2; place >= 0; --place) {
            bool bit = ((value + 1) >> place) & 1;
            if (place >= digits - 1 - modelled_digits) {
                bit = coder.bit(digits_[digits - 1][found], bit);
            } else {
                bit = coder.bypass(bit);
            }
            found = 2 * found + bit;
        }
        return found - 1;
    }

private:
    static constexpr int most_digits = 32, modelled_digits = 3;
    std::array<BitModel, most_digits> more_;
    std::array<std::array<BitModel, 1 << modelled_digits>, most_digits> digits_;
};

// Signed numbers: a zero flag, the sign, and the magnitude minus 1.
class SignedModel {
public:
    template <Mode mode> i64 code(RangeCoder<mode> &coder, i64 value) {
        if (coder.bit(zero_, value == 0)) return 0;
        const bool negative = coder.bit(sign_, value < 0);
        const i64 magnitude = 1 + magnitude_[negative].code(coder, size_of(value) - 1);
        return negative ? -magnitude : magnitude;
    }

private:
    BitModel zero_, sign_;
    std::array<NumberModel, 2> magnitude_;
};

// Table of the classes of small numbers. Most numbers are small, and computing a class from the number of binary digits
// takes as long as coding a bit.
template <auto class_of> inline constexpr std::array<u8, 256> small_classes = [] {
    std::array<u8, 256> found{};
    for (std::size_t number = 0; number < found.size(); ++number) {
        found[number] = static_cast<u8>(class_of(static_cast<i64>(number)));
    }
    return found;
}();

// Return class_of(number), from the table if the number is small. The number is not negative, `class_of` is constexpr
// and less than 256.
template <auto class_of> int looked_up(i64 number) {
    const auto &small = small_classes<class_of>;
    return number < static_cast<i64>(small.size()) ? small[number] : class_of(number);
}

// Numbers from 1 to 2^43 - 1: the number of binary digits in unary, then the digits as bypass bits.
class CountedModel {
public:
    template <Mode mode> i64 code(RangeCoder<mode> &coder, i64 value) {
        const int wanted = bit_length(value);
        int digits = 1;
        while (digits < most_digits && coder.bit(more_[digits - 1], wanted > digits)) ++digits;
        i64 found = 1;
        for (int place = digits - 2; place >= 0; --place) found = 2 * found + coder.bypass((value >> place) & 1);
        return found;
    }

private:
    static constexpr int most_digits = 43;  // a prediction misses by at most 2^42
    std::array<BitModel, most_digits> more_;
};

// A match model: predicts that the sequence continues as it did after the same numbers before.
//
// Meshes made by programs repeat themselves: every row of a grid is numbered like the row before. The long match is the
// position after the last occurrence of the last six numbers. It is followed as long as the sequence repeats, so the
// model also learns where a row ends. The short match is the position after the last occurrence of the last three
// numbers, and is looked up for every number. Whether a match is right is coded as a mixed bit; the caller codes a
// number that neither match predicts.
class MatchModel {
public:
    static constexpr int phases = 8;  // largest number of kinds of numbers in one sequence; the kind is a context

    // Code whether a match predicts the next number, and return the number if it does. The caller must call `add`
    // afterwards in either case.
    template <Mode mode> std::optional<i64> code(RangeCoder<mode> &coder, int phase, i64 number) {
        look_up(phase);
        const i64 place = long_place_, short_place = short_place_;
        bool differ = short_place >= 0;
        if (place >= 0) {
            const i64 proposed = number_at(place);
            int agreement = 0;
            if (short_place >= 0) {
                differ = number_at(short_place) != proposed;
                agreement = differ ? 1 : 2;
            }
            const int run = static_cast<int>(least<i64>(run_, longest_run));
            BitModel &of_run = of_run_[run][phase][agreement];
            bool right;
            if (run == longest_run) {
                right = coder.bit(of_run, number == proposed);
            } else {
                right = coder.template mixed<2>({&of_run, &long_recent_[long_history_][agreement]},
                                                long_weights_.data(), number == proposed);
            }
            long_history_ = 2 * (long_history_ & 127) + right;
            if (right) return proposed;
            long_place_ = -1;
        }
        if (differ) {
            const i64 proposed = number_at(short_place);
            const int distance = static_cast<int>(least<i64>(count_ - short_place, farthest));
            const bool right =
                coder.template mixed<2>({&short_recent_[short_history_][phase], &short_distance_[distance][phase]},
                                        short_weights_.data(), number == proposed);
            short_history_ = 2 * (short_history_ & 127) + right;
            if (right) return proposed;
        }
        return std::nullopt;
    }

    // Add the number that was coded after the last call of `code`.
    void add(i64 number) {
        if (long_place_ >= 0) {
            ++long_place_;
            ++run_;
        }
        if (long_slot_ >= 0) {
            long_table_[long_slot_] = count_ + 1;
            short_table_[short_slot_] = count_ + 1;
        }
        past_[count_ & (past_size - 1)] = number;
        ++count_;
    }

private:
    static constexpr int long_context = 6, short_context = 3;
    static constexpr int table_bits = 13;            // tables of 2^13 positions stay in the processor's cache
    static constexpr i64 past_size = 1 << 14;        // numbers that are kept: two rows of a grid of a thousand columns
    static constexpr u32 hash_factor = 0x9E3779B1u;  // 2^32 over the golden ratio (Knuth, volume 3, section 6.4)
    static constexpr int longest_run = 63, farthest = 63;  // longer runs and larger distances share a context

    i64 number_at(i64 place) const { return past_[place & (past_size - 1)]; }

    void look_up(int phase) {
        if (long_place_ >= 0 && run_ >= longest_run) {
            // The long match keeps being right: updating the tables would waste time.
            long_slot_ = short_slot_ = -1;
            short_place_ = -1;
            return;
        }
        u32 mixed = static_cast<u32>(phase);
        for (int back = 1; back <= long_context; ++back) {
            mixed = mixed * hash_factor + static_cast<u32>(number_at(count_ - back));
            if (back == short_context) short_slot_ = static_cast<i32>(mixed >> (32 - table_bits));
        }
        long_slot_ = static_cast<i32>(mixed >> (32 - table_bits));
        if (long_place_ < 0) {
            long_place_ = long_table_[long_slot_] - 1;
            run_ = 0;
        }
        short_place_ = short_table_[short_slot_] - 1;
        if (count_ - long_place_ > past_size) long_place_ = -1;
        if (count_ - short_place_ > past_size) short_place_ = -1;
    }

    i64 count_ = 0, long_place_ = -1, short_place_ = -1, run_ = 0;
    i32 long_slot_ = -1, short_slot_ = -1;
    int long_history_ = 0, short_history_ = 0;  // which of a match's last 8 predictions were right, the latest in bit 0
    Weights<2> long_weights_, short_weights_;
    std::array<std::array<std::array<BitModel, 3>, phases>, longest_run + 1> of_run_;
    std::array<std::array<BitModel, 3>, 256> long_recent_;
    std::array<std::array<BitModel, phases>, 256> short_recent_;
    std::array<std::array<BitModel, phases>, farthest + 1> short_distance_;
    std::vector<i64> long_table_ = std::vector<i64>(1 << table_bits), short_table_ = long_table_;
    std::vector<i64> past_ = std::vector<i64>(past_size);
};

// A list of increasing numbers whose differences are at most 2^32.
class AscendingModel {
public:
    template <Mode mode> void code(RangeCoder<mode> &coder, std::span<i64> numbers) {
        for (std::size_t i = 0; i < numbers.size(); ++i) {
            coder.check_not_ended();
            if (i == 0) {
                numbers[0] = first_.code(coder, numbers[0]);
            } else {
                numbers[i] = numbers[i - 1] + 1 + gaps_.code(coder, numbers[i] - numbers[i - 1] - 1);
            }
        }
    }

private:
    SignedModel first_;
    NumberModel gaps_;
};

// A list of numbers that are coded by their differences, which are less than 2^32 in magnitude and often repeat.
class StepModel {
public:
    template <Mode mode> void code(RangeCoder<mode> &coder, std::span<i64> numbers) {
        i64 last = 0;
        for (i64 &number : numbers) {
            const std::optional<i64> again = match_.code(coder, 0, number - last);
            const i64 step = again ? *again : steps_.code(coder, number - last);
            match_.add(step);
            last += step;
            number = last;
        }
    }

private:
    SignedModel steps_;
    MatchModel match_;
};

}  // namespace pdeanim
