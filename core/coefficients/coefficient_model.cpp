#include "coefficients/coefficient_model.hpp"

#include "errors.hpp"

namespace pdeanim {

namespace {

constexpr i32 first_weight = 19661;  // 0.3

[[noreturn]] void broken() { throw CorruptError("section COEF holds levels that cannot be; get the file again"); }

}  // namespace

CoefficientModel::CoefficientModel() {
    for (auto &weights : nonzero_weights_) weights.fill(first_weight);
    for (auto &weights : larger_weights_) weights.fill(first_weight);
    for (auto &weights : count_weights_) weights.fill(first_weight);
}

// 0 to 7 as they are, then four to an octave.
int CoefficientModel::ratio_class(i64 total) {
    if (total < 8) return static_cast<int>(total);
    const int octave = bit_length(total) - 3;
    return least(4 * octave + static_cast<int>((total >> octave) & 3) + 4, ratios - 1);
}

// Two to an octave.
int CoefficientModel::rank_class(i64 rank) {
    if (rank < 2) return static_cast<int>(rank);
    const int digits = bit_length(rank);
    return least(2 * digits - 2 + static_cast<int>((rank >> (digits - 2)) & 1), ranks - 1);
}

template <Mode mode>
i64 CoefficientModel::code_count(RangeCoder<mode> &coder, int band, i64 before, i64 most, i64 count) {
    const int wanted = bit_length(count), limit = bit_length(most);
    const int digits_before = bit_length(before), digits_latest = bit_length(latest_count_[band]);
    int digits = 0;
    for (; digits < limit; ++digits) {
        const bool is_longer = coder.template mixed<3>(
            {&count_by_band_[band][digits], &count_by_both_[digits][digits_before][digits_latest],
             &count_by_latest_[digits][digits_latest]},
            count_weights_[digits].data(), wanted > digits);
        if (!is_longer) break;
    }
    i64 value = least(digits, 1);
    for (int digit = digits - 2; digit >= 0; --digit) {
        BitModel &model = count_digits_[digits][least<i64>(value, heads - 1)];
        value = 2 * value + coder.bit(model, (count >> digit) & 1);
    }
    if (value > most) broken();
    latest_count_[band] = value;
    return value;
}

template <Mode mode> i64 CoefficientModel::code_coefficient(RangeCoder<mode> &coder, int band, i64 row, i64 rank,
                                                            const CoefficientsAround &around, i64 coefficient) {
    const auto &[r1, r2, t1, t2, s1, x1, p1] = around;
    const int sum = ratio_class(2 * r1 + r2 + 2 * t1 + t2 + 2 * s1 + 2 * x1 + p1);
    const int ranked = rank_class(rank);
    const auto nearest =
        (((least<i64>(r1, 3) * 3 + least<i64>(r2, 2)) * 4 + least<i64>(t1 + x1, 3)) * 3 + least<i64>(t2, 2)) * 4 +
        least<i64>(s1, 3);
    const i64 size = size_of(coefficient);
    const bool is_nonzero = coder.template mixed<6>(
        {&nonzero_by_band_[band][ranked], &nonzero_by_nearest_[nearest], &nonzero_by_sum_[sum][band],
         &nonzero_by_row_[least<i64>(row, 127)][least<i64>(t1 + s1 + x1, 5)],
         &nonzero_by_rank_[least<i64>(rank, 511)][least<i64>(r1 + s1 + p1, 7)], &nonzero_by_sum_and_rank_[sum][ranked]},
        nonzero_weights_[band].data(), size != 0);
    if (!is_nonzero) return 0;
    const bool is_negative = coder.bypass(coefficient < 0);
    const i64 largest_around = least<i64>(most(most(r1, t1), most(s1, x1)), 7);
    i64 found = 1;
    for (; found <= modelled; ++found) {
        const i64 at = found - 1;
        const bool is_larger = coder.template mixed<4>({&larger_by_sum_[at][sum], &larger_by_band_[at][band][ranked],
                                                        &larger_by_nearest_[at][largest_around][least<i64>(r1 + p1, 7)],
                                                        &larger_by_sum_and_rank_[at][sum][ranked]},
                                                       larger_weights_[at].data(), size > found);
        if (!is_larger) break;
    }
    if (found > modelled) {
        const i64 rest = size - modelled;
        const int wanted = bit_length(rest);
        int digits = 1;
        while (digits < escape_digits && coder.bit(escape_[digits], wanted > digits)) ++digits;
        i64 value = 1;
        for (int digit = digits - 2; digit >= 0; --digit) value = 2 * value + coder.bypass((rest >> digit) & 1);
        found = modelled + value;
        if (found > largest) broken();
    }
    return is_negative ? -found : found;
}

template i64 CoefficientModel::code_count(RangeCoder<Mode::encode> &, int, i64, i64, i64);
template i64 CoefficientModel::code_count(RangeCoder<Mode::decode> &, int, i64, i64, i64);
template i64 CoefficientModel::code_count(RangeCoder<Mode::measure> &, int, i64, i64, i64);
template i64 CoefficientModel::code_coefficient(RangeCoder<Mode::encode> &, int, i64, i64, const CoefficientsAround &,
                                                i64);
template i64 CoefficientModel::code_coefficient(RangeCoder<Mode::decode> &, int, i64, i64, const CoefficientsAround &,
                                                i64);
template i64 CoefficientModel::code_coefficient(RangeCoder<Mode::measure> &, int, i64, i64, const CoefficientsAround &,
                                                i64);

}  // namespace pdeanim
