// Codes the residuals of predicted grid coordinates.
//
// A residual is coded as its length, which is its number of digits. The coder begins with the length that the
// neighbours' residuals make likely and goes up or down from there; each decision mixes three models. The digits after
// the leading one follow, then the sign. For shapes that repeat themselves, such as the rings of a regular tube, a
// match model first proposes a residual.
#pragma once

#include <optional>

#include "base/errors.hpp"
#include "entropy/numbers.hpp"
#include "entropy/range_coder.hpp"
#include "sections/reference/reference.hpp"

namespace pdeanim {

class PointModel {
public:
    explicit PointModel(bool repeats);

    template <Mode mode> void code_weights(RangeCoder<mode> &coder, TermWeights &weights);
    template <Mode mode> void code_weights(RangeCoder<mode> &coder, SmoothingWeights &weights);

    // Code the grid coordinates of all vertices in prediction order: read when encoding, written when decoding.
    // CorruptError if a coordinate is out of range.
    template <Mode mode>
    void code(RangeCoder<mode> &coder, const std::vector<i32> &order, const TermWeights &weights, Predictor &points);

private:
    enum Way { first, up, down, ways };  // decisions on a length: the first, then up or down

    static constexpr int nearnesses = 4;
    // Rows of contexts: four for whether a residual is zero, by how close the prediction is to a grid point; one each
    // for lengths of 2 to 12; one for longer ones.
    static constexpr int rows = 16;
    static constexpr int sizes = 48;  // number of size classes, two per octave
    static constexpr i64 half = 1 << (fraction_bits - 1);

    // Return the class of a number, two classes per octave: 0, 1, 2, 3, then 4 for 4 and 5, 5 for 6 and 7, ... The
    // number is not negative.
    static int grade(i64 value) {
        const int digits = bit_length(value);
        if (digits < 2) return digits;
        return least<int>(2 * digits - 2 + static_cast<int>((value >> (digits - 2)) & 1), sizes - 1);
    }

    // Return a term rounded to steps, clamped to -2 to 2, plus 2.
    static int leaning(i64 term) { return static_cast<int>(clamp<i64>((term + half) >> fraction_bits, -2, 2)) + 2; }

    std::optional<MatchModel> matches_;

    template <Mode mode> i64 code_residual(RangeCoder<mode> &coder, const Around &around, int axis, int fraction,
                                           int size_around, int spread, i64 residual);

    template <Mode mode> void code_weight(RangeCoder<mode> &coder, int set, i32 &weight);

    static constexpr int weight_digits = 7, farthest = 5, sign_kinds = 3;

    std::vector<BitModel> by_size_, by_kind_, by_spread_;  // inputs of a decision on a length
    std::array<std::vector<BitModel>, 3> signs_;
    std::array<std::array<BitModel, 4>, grid_bits + 1> digits_;
    std::array<BitModel, 3> weight_;  // for weights of terms, of terms along the normal, of smoothing
    std::array<BitModel, weight_digits> weight_digits_;
    // Weights for decisions on lengths, by direction and distance from the first length tried; and for signs, by kind.
    Weights<3> first_;
    std::array<Weights<3>, farthest> up_, down_;
    std::array<Weights<3>, sign_kinds> sign_weights_;
};

inline PointModel::PointModel(bool repeats)
    : by_size_(rows * sizes * 3 * ways), by_kind_(rows * sizes * kind_count), by_spread_(rows * sizes * 4 * ways) {
    signs_ = {std::vector<BitModel>(sign_kinds * (1 << fraction_bits) * 3), std::vector<BitModel>(sign_kinds * 25),
              std::vector<BitModel>(sign_kinds * 25)};
    if (repeats) matches_.emplace();
}

// Code a weight: whether it is zero, its absolute value in seven digits, and the sign.
template <Mode mode> void PointModel::code_weight(RangeCoder<mode> &coder, int set, i32 &weight) {
    i32 size = 0;
    if (coder.bit(weight_[set], weight != 0)) {
        for (int digit = weight_digits - 1; digit >= 0; --digit) {
            const bool bit = (static_cast<i32>(size_of(weight)) >> digit) & 1;
            size = 2 * size + coder.bit(weight_digits_[digit], bit);
        }
        if (coder.bypass(weight < 0)) size = -size;
    }
    weight = size;
}

template <Mode mode> void PointModel::code_weights(RangeCoder<mode> &coder, TermWeights &weights) {
    for (auto &of_kind : weights) {
        for (int turned = 0; turned < 2; ++turned) {
            for (i32 &weight : of_kind[turned]) code_weight(coder, turned, weight);
        }
    }
}

template <Mode mode> void PointModel::code_weights(RangeCoder<mode> &coder, SmoothingWeights &weights) {
    for (auto &of_class : weights) {
        for (i32 &weight : of_class) code_weight(coder, 2, weight);
    }
}

template <Mode mode> i64 PointModel::code_residual(RangeCoder<mode> &coder, const Around &around, int axis,
                                                   int fraction, int size_around, int spread, i64 residual) {
    const i64 size = size_of(residual);
    const int wanted = bit_length(size);
    const i64 expected = around.errors[axis] + half;
    const int start = clamp(bit_length(expected >> fraction_bits), 1, grid_bits);
    const int at_size = size_around * 3 + axis, at_kind = grade(expected) * kind_count + around.kind;
    const int at_spread = spread * 4 + least(around.parallelograms, 3);
    const int nearness = least(static_cast<int>(size_of(fraction - half)) >> 1, nearnesses - 1);
    int length = start;
    Way way = first;
    i32 *weights = first_.data();
    while (true) {
        const int row = (length == 1 ? nearness : least(nearnesses + length - 2, rows - 1)) * sizes;
        const bool is_it =
            coder.template mixed<3>({&by_size_[(row * 3 + at_size) * ways + way], &by_kind_[row * kind_count + at_kind],
                                     &by_spread_[(row * 4 + at_spread) * ways + way]},
                                    weights, wanted >= length);
        if (way == first) way = is_it ? up : down;
        if (way == up) {
            if (!is_it) {
                --length;
                break;
            }
            if (length == grid_bits) break;
            ++length;
            weights = up_[least(length - start, farthest) - 1].data();
        } else {
            if (is_it || --length == 0) break;
            weights = down_[least(start - length, farthest) - 1].data();
        }
    }
    if (length == 0) return 0;
    i64 value = 1;
    for (int digit = length - 2; digit >= 0; --digit) {
        const bool bit = (size >> digit) & 1;
        value = 2 * value + (value < 4 ? coder.bit(digits_[length][value], bit) : coder.bypass(bit));
    }
    const int kind = least(length, sign_kinds) - 1;
    const auto &terms = around.terms;
    const bool is_negative = coder.template mixed<3>(
        {&signs_[0][(kind * (1 << fraction_bits) + fraction) * 3 + axis],
         &signs_[1][(kind * 5 + leaning(terms[crease][axis])) * 5 + leaning(terms[straight][axis])],
         &signs_[2][(kind * 5 + leaning(terms[miss][axis])) * 5 + leaning(terms[neighbours][axis])]},
        sign_weights_[kind].data(), residual < 0);
    return is_negative ? -value : value;
}

template <Mode mode> void PointModel::code(RangeCoder<mode> &coder, const std::vector<i32> &order,
                                           const TermWeights &weights, Predictor &points) {
    constexpr i64 largest = (i64{1} << grid_bits) - 1;
    for (const i32 vertex : order) {
        const Around around = points.look_around(vertex);
        const Vector predicted = around.predicted(weights[around.kind]);
        const int size_around = grade(around.errors[0] + around.errors[1] + around.errors[2]);
        const int spread = grade(around.spread);
        Vector residuals;
        for (int axis = 0; axis < 3; ++axis) {
            const i64 sixteenths = predicted[axis] + half;
            const i64 prediction = clamp<i64>(sixteenths >> fraction_bits, 0, largest);
            const int fraction = static_cast<int>(sixteenths & ((1 << fraction_bits) - 1));
            i64 &coordinate = points.grid[vertex][axis];
            const i64 wanted = coordinate - prediction;
            const std::optional<i64> again = matches_ ? matches_->code(coder, axis, wanted) : std::nullopt;
            const i64 residual =
                again ? *again : code_residual(coder, around, axis, fraction, size_around, spread, wanted);
            if (matches_) matches_->add(residual);
            if (prediction + residual < 0 || prediction + residual > largest) {
                throw CorruptError(Section("REST"), "has a coordinate out of range; get the file again");
            }
            coordinate = prediction + residual;
            residuals[axis] = size_of(residual);
        }
        points.learn(vertex, around, residuals);
    }
}

}  // namespace pdeanim
