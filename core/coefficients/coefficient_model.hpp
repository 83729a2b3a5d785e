// Context models of quantised coefficients.
//
// A subband is coded in context bands of rows. Of each band comes how many channels it needs, then its coefficients up
// to there. Each decision mixes inputs that look at the channel, at the band, and at the sizes of neighbours that are
// known.
#pragma once

#include "entropy/range_coder.hpp"

namespace pdeanim {

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
    static constexpr i64 largest = i64{1} << 40;  // magnitude of a coefficient
    static constexpr i64 most_channels = (1 << 19) - 1;

    CoefficientModel();

    // Code how many channels, at most `most`, a band needs; `before` is how many the band before it in the subband
    // does. CorruptError where the bits hold more.
    template <Mode mode> i64 code_count(RangeCoder<mode> &coder, int band, i64 before, i64 most, i64 count);

    // Code a coefficient, `row` of its element (affine functions included) or of its subband, at a rank of functions of
    // time. CorruptError where the bits hold one out of range.
    template <Mode mode> i64 code_coefficient(RangeCoder<mode> &coder, int band, i64 row, i64 rank,
                                              const CoefficientsAround &around, i64 coefficient);

private:
    template <std::size_t count> using Models = std::array<BitModel, count>;
    template <std::size_t rows, std::size_t columns> using Table = std::array<Models<columns>, rows>;

    static constexpr int ratios = 24;    // classes of sums of neighbours' sizes
    static constexpr int ranks = 20;     // classes of ranks
    static constexpr int modelled = 14;  // sizes up to which one counts up; larger ones give the rest in binary
    static constexpr int count_digits = 20, escape_digits = 41;
    static constexpr int heads = 64;  // leading digits of a count that are told apart

    static int ratio_class(i64 total);
    static int rank_class(i64 rank);

    // Inputs of whether a coefficient is not zero.
    Table<bands, ranks> nonzero_by_band_;
    Models<4 * 3 * 4 * 3 * 4> nonzero_by_nearest_;
    Table<ratios, bands> nonzero_by_sum_;
    Table<128, 6> nonzero_by_row_;
    Table<512, 8> nonzero_by_rank_;
    Table<ratios, ranks> nonzero_by_sum_and_rank_;
    std::array<Weights<6>, bands> nonzero_weights_;

    // Inputs of whether it is larger than each size.
    std::array<Models<ratios>, modelled> larger_by_sum_;
    std::array<Table<bands, ranks>, modelled> larger_by_band_;
    std::array<Table<8, 8>, modelled> larger_by_nearest_;
    std::array<Table<ratios, ranks>, modelled> larger_by_sum_and_rank_;
    std::array<Weights<4>, modelled> larger_weights_;
    Models<escape_digits> escape_;

    // Inputs of whether a count has more digits than so many.
    Table<bands, count_digits> count_by_band_;
    std::array<Table<count_digits, count_digits>, count_digits> count_by_both_;
    Table<count_digits, count_digits> count_by_latest_;
    std::array<Weights<3>, count_digits> count_weights_;
    Table<count_digits, heads> count_digits_;
    std::array<i64, bands> latest_count_{};
};

}  // namespace pdeanim
