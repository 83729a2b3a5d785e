// Context models of quantised coefficients.
//
// A subband is coded in context bands of rows. Of each band comes how many channels it needs, then its coefficients up
// to there, in blocks: whether any of a block is not zero, then each of them. A coefficient's size is coded as its
// exponent and the bits below. Each decision mixes inputs that look at the channel, at the band, and at the sizes of
// neighbours that are known.
#pragma once

#include "entropy/range_coder.hpp"

namespace pdeanim {

// Sizes of the neighbours of a block of coefficients, added up over each; 0 where there is none.
struct BlocksAround {
    i64 one_row, two_rows;  // one and two rows before, in the same subband
    i64 one, two;           // one and two blocks before, in the same row
    i64 beside;             // at the same place of the subband of the same sort before
    i64 above;              // at the same place of the subband of the node above
};

// Sizes of the neighbours of a coefficient, 0 where there is none.
struct CoefficientsAround {
    i64 one_row, two_rows;    // one and two rows before, in the same subband
    i64 one_rank, two_ranks;  // one and two functions of time before, on the same axis
    i64 beside;               // at the same place of the subband of the same sort before
    i64 other_axes;           // at the same function of time, those that are known
    i64 above;                // at the same place of the subband of the node above
};

class CoefficientModel {
public:
    static constexpr int depths = 16;        // bands of nodes, one for each depth
    static constexpr int element_bands = 9;  // bands of an element's rows
    static constexpr int bands = depths + element_bands;
    static constexpr int largest_exponent = 40;
    static constexpr i64 largest = i64{1} << largest_exponent;  // magnitude of a coefficient
    static constexpr i64 most_channels = (1 << 19) - 1;
    static constexpr int ratios = 24;  // classes of sums of neighbours' sizes
    static constexpr int ranks = 20;   // classes of ranks

    // Code how many channels, at most `most`, a band needs; `before` is how many the band before it in the subband
    // does. CorruptError where the bits hold more.
    template <Mode mode> i64 code_count(RangeCoder<mode> &coder, int band, i64 before, i64 most, i64 count);

    // Code whether any coefficient of a block is not zero; `row` is that of the element (affine functions included) or of
    // the subband, `rank` that of the block's first function of time.
    template <Mode mode>
    bool code_block(RangeCoder<mode> &coder, int band, i64 row, i64 rank, const BlocksAround &around, bool is_any);

    // Code a coefficient at a rank of functions of time; where it is known not to be zero, not whether it is. CorruptError
    // where the bits hold one out of range.
    template <Mode mode> i64 code_coefficient(RangeCoder<mode> &coder, int band, i64 rank,
                                              const CoefficientsAround &around, bool is_nonzero, i64 coefficient);

private:
    static constexpr int nearest_classes = 4 * 3 * 4 * 3 * 4;

    template <std::size_t count> using Models = std::array<BitModel, count>;
    template <std::size_t rows, std::size_t columns> using Table = std::array<Models<columns>, rows>;

    static constexpr int exponents = 14;  // that are told apart; larger ones share the last
    static constexpr int modelled_digits = 2;
    static constexpr int count_digits = 20;
    static constexpr int heads = 64;  // leading digits of a count that are told apart

    static i64 nearest_class(i64 one_row, i64 two_rows, i64 one, i64 two, i64 beside);

    template <Mode mode> i64 code_size(RangeCoder<mode> &coder, int band, int ratio, int rank, i64 size);

    // Inputs of whether any of a block is not zero.
    Models<nearest_classes> block_by_nearest_;
    Table<128, 6> block_by_row_;
    Table<ratios, ranks> block_by_ratio_;
    std::array<Weights<3>, bands> block_weights_;

    // Inputs of whether a coefficient is not zero.
    Models<nearest_classes> nonzero_by_nearest_;
    Table<512, 8> nonzero_by_rank_;
    Table<ratios, ranks> nonzero_by_ratio_;
    std::array<Weights<3>, bands> nonzero_weights_;

    // Inputs of whether the exponent of its size is larger than each.
    std::array<Models<ratios>, exponents> larger_by_ratio_;
    std::array<Table<bands, ranks>, exponents> larger_by_band_;
    std::array<Table<ratios, ranks>, exponents> larger_by_both_;
    std::array<Weights<3>, exponents> larger_weights_;
    Table<largest_exponent + 1, 1 << modelled_digits> digits_;

    // Inputs of whether a count has more digits than so many.
    Table<bands, count_digits> count_by_band_;
    std::array<Table<count_digits, count_digits>, count_digits> count_by_both_;
    Table<count_digits, count_digits> count_by_latest_;
    std::array<Weights<3>, count_digits> count_weights_;
    Table<count_digits, heads> count_digits_;
    std::array<i64, bands> latest_count_{};
};

}  // namespace pdeanim
