#include "sections/coefficients/coefficient_model.hpp"

#include "base/errors.hpp"
#include "entropy/looked_up.hpp"

namespace pdeanim {

namespace {

[[noreturn]] void broken() { throw CorruptError("section COEF holds levels that cannot be; get the file again"); }

constexpr int ratios = CoefficientModel::ratios, ranks = CoefficientModel::ranks;

// 0 to 7 as they are, then four to an octave.
constexpr int ratio_class_of(i64 total) {
    if (total < 8) return static_cast<int>(total);
    const int octave = bit_length(total) - 3;
    return least(4 * octave + static_cast<int>((total >> octave) & 3) + 4, ratios - 1);
}
int ratio_class(i64 total) { return looked_up<ratio_class_of>(total); }

// Two to an octave.
constexpr int rank_class_of(i64 rank) {
    if (rank < 2) return static_cast<int>(rank);
    const int digits = bit_length(rank);
    return least(2 * digits - 2 + static_cast<int>((rank >> (digits - 2)) & 1), ranks - 1);
}
int rank_class(i64 rank) { return looked_up<rank_class_of>(rank); }

}  // namespace

i64 CoefficientModel::nearest_class(i64 one_row, i64 two_rows, i64 one, i64 two, i64 beside) {
    const i64 rows = least<i64>(one_row, 3) * 3 + least<i64>(two_rows, 2);
    return ((rows * 4 + least<i64>(one, 3)) * 3 + least<i64>(two, 2)) * 4 + least<i64>(beside, 3);
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

template <Mode mode> bool CoefficientModel::code_block(RangeCoder<mode> &coder, int band, i64 row, i64 rank,
                                                       const BlocksAround &around, bool is_any) {
    const auto &[one_row, two_rows, one, two, beside, above] = around;
    const int ratio = ratio_class(2 * one_row + two_rows + 2 * one + two + 2 * beside + above);
    return coder.template mixed<3>(
        {&block_by_nearest_[nearest_class(one_row, two_rows, one, two, beside)],
         &block_by_row_[least<i64>(row, 127)][least<i64>(one + beside, 5)], &block_by_ratio_[ratio][rank_class(rank)]},
        block_weights_[band].data(), is_any);
}

template <Mode mode> i64 CoefficientModel::code_coefficient(RangeCoder<mode> &coder, int band, i64 rank,
                                                            const CoefficientsAround &around, bool is_nonzero,
                                                            i64 coefficient) {
    const auto &[one_row, two_rows, one_rank, two_ranks, beside, other_axes, above] = around;
    const int ratio =
        ratio_class(2 * one_row + two_rows + 2 * one_rank + two_ranks + 2 * beside + 2 * other_axes + above);
    const int ranked = rank_class(rank);
    is_nonzero = is_nonzero ||
                 coder.template mixed<3>(
                     {&nonzero_by_nearest_[nearest_class(one_row, two_rows, one_rank + other_axes, two_ranks, beside)],
                      &nonzero_by_rank_[least<i64>(rank, 511)][least<i64>(one_row + beside + above, 7)],
                      &nonzero_by_ratio_[ratio][ranked]},
                     nonzero_weights_[band].data(), coefficient != 0);
    if (!is_nonzero) return 0;
    const bool is_negative = coder.bypass(coefficient < 0);
    const i64 size = code_size(coder, band, ratio, ranked, size_of(coefficient));
    return is_negative ? -size : size;
}

template <Mode mode> i64 CoefficientModel::code_size(RangeCoder<mode> &coder, int band, int ratio, int rank, i64 size) {
    const int wanted = bit_length(size) - 1;
    int exponent = 0;
    for (; exponent < largest_exponent; ++exponent) {
        const int at = least(exponent, exponents - 1);
        const bool is_larger = coder.template mixed<3>(
            {&larger_by_ratio_[at][ratio], &larger_by_band_[at][band][rank], &larger_by_both_[at][ratio][rank]},
            larger_weights_[at].data(), wanted > exponent);
        if (!is_larger) break;
    }
    i64 found = 1;
    for (int place = exponent - 1; place >= 0; --place) {
        bool bit = (size >> place) & 1;
        if (place >= exponent - modelled_digits) {
            bit = coder.bit(digits_[exponent][found], bit);
        } else {
            bit = coder.bypass(bit);
        }
        found = 2 * found + bit;
    }
    if (found > largest) broken();
    return found;
}

template i64 CoefficientModel::code_count(RangeCoder<Mode::encode> &, int, i64, i64, i64);
template i64 CoefficientModel::code_count(RangeCoder<Mode::decode> &, int, i64, i64, i64);
template i64 CoefficientModel::code_count(RangeCoder<Mode::measure> &, int, i64, i64, i64);
template bool CoefficientModel::code_block(RangeCoder<Mode::encode> &, int, i64, i64, const BlocksAround &, bool);
template bool CoefficientModel::code_block(RangeCoder<Mode::decode> &, int, i64, i64, const BlocksAround &, bool);
template bool CoefficientModel::code_block(RangeCoder<Mode::measure> &, int, i64, i64, const BlocksAround &, bool);
template i64 CoefficientModel::code_coefficient(RangeCoder<Mode::encode> &, int, i64, const CoefficientsAround &, bool,
                                                i64);
template i64 CoefficientModel::code_coefficient(RangeCoder<Mode::decode> &, int, i64, const CoefficientsAround &, bool,
                                                i64);
template i64 CoefficientModel::code_coefficient(RangeCoder<Mode::measure> &, int, i64, const CoefficientsAround &, bool,
                                                i64);

}  // namespace pdeanim
