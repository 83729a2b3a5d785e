// Residuals of predicted grid coordinates.
//
// A residual is coded as its length, its number of binary digits: beginning with the length that the neighbours' residuals
// make likely and going up or down from there, each decision mixing three inputs. Then come the digits below the first,
// and the sign. Where a shape repeats itself, as the rings of a regular tube do, a match model proposes residuals first.
#pragma once

#include <optional>

#include "entropy/numbers.hpp"
#include "entropy/range_coder.hpp"
#include "sections/reference/predictor.hpp"

namespace pdeanim {

class PointModel {
public:
    explicit PointModel(bool repeats);

    // The weights of terms: zero or not, size in seven digits, sign.
    template <Mode mode> void code_weights(RangeCoder<mode> &coder, TermWeights &weights);

    // Grid coordinates of all vertices in prediction order; read when encoding, written when decoding. CorruptError where
    // the bits hold one out of range.
    template <Mode mode>
    void code(RangeCoder<mode> &coder, const std::vector<i32> &order, const TermWeights &weights, Predictor &points);

private:
    std::optional<MatchModel> matches_;

    template <Mode mode> i64 code_residual(RangeCoder<mode> &coder, const Around &around, int axis, int fraction,
                                           int size_around, int spread, i64 residual);

    static constexpr int weight_digits = 7, farthest = 5, sign_kinds = 3;

    std::vector<BitModel> by_size_, by_kind_, by_spread_;  // inputs of a decision on a length
    std::array<std::vector<BitModel>, 3> signs_;
    std::array<std::array<BitModel, 4>, grid_bits + 1> digits_;
    std::array<BitModel, 2> weight_;
    std::array<BitModel, weight_digits> weight_digits_;
    // By the way and how far a length is from the first one tried; one for each kind of sign.
    Weights<3> first_;
    std::array<Weights<3>, farthest> up_, down_;
    std::array<Weights<3>, sign_kinds> sign_weights_;
};

}  // namespace pdeanim
