// Context models of quantised coefficients.
//
// The rows of a subband are coded in bands. Each band begins with the number of channels that it needs. Its
// coefficients up to that channel follow in blocks: whether any coefficient of a block is not zero, then each
// coefficient. A coefficient's magnitude is coded as its exponent and the digits below. Each decision mixes three
// models: by channel, by band, and by the magnitudes of known neighbours.
#pragma once

#include "base/errors.hpp"
#include "entropy/numbers.hpp"
#include "entropy/range_coder.hpp"

namespace pdeanim {

// Magnitudes of the neighbours of a block of coefficients, each summed over a block; 0 if there is no neighbour.
struct BlocksAround {
    i64 one_row, two_rows;  // one and two rows before, in the same subband
    i64 one, two;           // one and two blocks before, in the same row
    i64 beside;             // at the same place of the previous subband of the same kind
    i64 above;              // at the same place of the subband of the node above
};

// Magnitudes of the neighbours of a coefficient; 0 if there is no neighbour.
struct CoefficientsAround {
    i64 one_row, two_rows;    // one and two rows before, in the same subband
    i64 one_rank, two_ranks;  // one and two functions of time before, on the same axis
    i64 beside;               // at the same place of the previous subband of the same kind
    i64 other_axes;           // sum over the axes coded before, at the same function of time
    i64 above;                // at the same place of the subband of the node above
};

class CoefficientModel {
public:
    static constexpr int depths = 16;        // number of bands of nodes: one per depth
    static constexpr int element_bands = 9;  // number of bands of an element's rows
    static constexpr int bands = depths + element_bands;
    static constexpr int largest_exponent = 40;
    static constexpr i64 largest = i64{1} << largest_exponent;  // largest magnitude of a coefficient
    static constexpr i64 most_channels = (1 << 19) - 1;
    static constexpr int ratios = 24;  // number of classes of sums of neighbours' magnitudes
    static constexpr int ranks = 20;   // number of classes of ranks

    // Code the number of channels (at most `most`) that a band needs. before: number that the previous band in the
    // subband needs. CorruptError if the number is too large.
    template <Mode mode> i64 code_count(RangeCoder<mode> &coder, int band, i64 before, i64 most, i64 count);

    // Code whether any coefficient of a block is not zero. row: within the element (affine functions included) or the
    // subband; rank: of the block's first function of time.
    template <Mode mode>
    bool code_block(RangeCoder<mode> &coder, int band, i64 row, i64 rank, const BlocksAround &around, bool is_any);

    // Code a coefficient at a rank of functions of time. is_nonzero: the coefficient is known not to be zero, so this
    // is not coded. CorruptError if the coefficient is out of range.
    template <Mode mode> i64 code_coefficient(RangeCoder<mode> &coder, int band, i64 rank,
                                              const CoefficientsAround &around, bool is_nonzero, i64 coefficient);

private:
    static constexpr int nearest_classes = 4 * 3 * 4 * 3 * 4;

    template <std::size_t count> using Models = std::array<BitModel, count>;
    template <std::size_t rows, std::size_t columns> using Table = std::array<Models<columns>, rows>;

    static constexpr int exponents = 14;  // number of exponents that are distinguished; larger ones share the last
    static constexpr int modelled_digits = 2;
    static constexpr int count_digits = 20;
    static constexpr int heads = 64;  // number of leading digits of a count that are distinguished

    [[noreturn]] static void broken() {
        throw CorruptError(Section("COEF"), "holds impossible coefficients; get the file again");
    }

    // Class of a sum: 0 to 7 each have their own, larger ones four classes per octave.
    static constexpr int ratio_class_of(i64 total) {
        if (total < 8) return static_cast<int>(total);
        const int octave = bit_length(total) - 3;
        return least(4 * octave + static_cast<int>((total >> octave) & 3) + 4, ratios - 1);
    }
    static int ratio_class(i64 total) { return looked_up<ratio_class_of>(total); }

    // Class of a rank: two classes per octave.
    static constexpr int rank_class_of(i64 rank) {
        if (rank < 2) return static_cast<int>(rank);
        const int digits = bit_length(rank);
        return least(2 * digits - 2 + static_cast<int>((rank >> (digits - 2)) & 1), ranks - 1);
    }
    static int rank_class(i64 rank) { return looked_up<rank_class_of>(rank); }

    static i64 nearest_class(i64 one_row, i64 two_rows, i64 one, i64 two, i64 beside);

    template <Mode mode> i64 code_size(RangeCoder<mode> &coder, int band, int ratio, int rank, i64 size);

    // Inputs of the decision whether any coefficient of a block is not zero.
    Models<nearest_classes> block_by_nearest_;
    Table<128, 6> block_by_row_;
    Table<ratios, ranks> block_by_ratio_;
    std::array<Weights<3>, bands> block_weights_;

    // Inputs of the decision whether a coefficient is not zero.
    Models<nearest_classes> nonzero_by_nearest_;
    Table<512, 8> nonzero_by_rank_;
    Table<ratios, ranks> nonzero_by_ratio_;
    std::array<Weights<3>, bands> nonzero_weights_;

    // Inputs of the decision whether the exponent of a magnitude is larger, for each exponent.
    std::array<Models<ratios>, exponents> larger_by_ratio_;
    std::array<Table<bands, ranks>, exponents> larger_by_band_;
    std::array<Table<ratios, ranks>, exponents> larger_by_both_;
    std::array<Weights<3>, exponents> larger_weights_;
    Table<largest_exponent + 1, 1 << modelled_digits> digits_;

    // Inputs of the decision whether a count has more digits, for each number of digits.
    Table<bands, count_digits> count_by_band_;
    std::array<Table<count_digits, count_digits>, count_digits> count_by_both_;
    Table<count_digits, count_digits> count_by_latest_;
    std::array<Weights<3>, count_digits> count_weights_;
    Table<count_digits, heads> count_digits_;
    std::array<i64, bands> latest_count_{};
};

inline i64 CoefficientModel::nearest_class(i64 one_row, i64 two_rows, i64 one, i64 two, i64 beside) {
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

}  // namespace pdeanim
