// Prediction errors of residuals: their difference from the prediction, or from zero.
//
// The expected size follows from the errors at the same place in the frame's reference, at the previous place, and on
// the previous axes. A small expected size is counted up in unary, each step a mixed bit; for a large one, some lower
// digits are left out of the counting: they follow after the sign.
#pragma once

#include <array>
#include <type_traits>
#include <vector>

#include "base/arithmetic.hpp"
#include "entropy/learning_predictor.hpp"
#include "entropy/numbers.hpp"
#include "entropy/range_coder.hpp"
#include "sections/residuals/residuals.hpp"

namespace pdeanim {

// Errors are remembered within 32 bits: they only predict sizes.
constexpr i64 largest_remembered_miss = (i64{1} << 31) - 1;

// Context of a prediction error.
struct MissContext {
    int axis = 0;
    bool has_reference = false,
         has_before = false;   // whether the place has a residual in the reference; whether the previous place has one
    bool is_not_zero = false;  // if the other two axes are zero, the last one is not
    i64 mean_size = 0;         // mean size of the errors at this place [1/16 of three axes]
    i64 in_time = 0, in_space = 0;       // remembered errors in the reference, and at the previous place
    i64 one_before = 0, two_before = 0;  // sizes of the errors one and two axes before
    int agreed_in_time = 0,
        agreed_in_space = 0;  // previous axes with the same sign as the other error, minus those without
};

constexpr int sign_of(i64 number) { return (number > 0) - (number < 0); }

class MissModel {
public:
    // CorruptError if the bytes hold a value out of range.
    template <Mode mode> i64 code(RangeCoder<mode> &coder, const MissContext &known, i64 miss);

private:
    static constexpr int expected_classes =
        24;  // 20 classes of small sizes, then the quarters of an octave, for all octaves
    static constexpr int near_classes = 8;     // sizes of a neighbour: 0 to 5, 6 and more, no neighbour
    static constexpr int beside_classes = 8;   // sizes on a previous axis: 0 to 6, 7 and more
    static constexpr int most_counted = 18;    // largest size that is counted up; the rest is a number
    static constexpr int fine_digits = 5;      // digits of `expected` up to which nothing is left out of the counting
    static constexpr int modelled_digits = 2;  // the uppermost of the digits left out, which have bit models

    BitModel by_expected_[expected_classes][3][most_counted];
    BitModel by_near_[near_classes][near_classes][2][most_counted];
    BitModel by_beside_[beside_classes][beside_classes][3][2][most_counted];
    BitModel lower_digits_[most_counted + 1][1 << modelled_digits];
    BitModel signs_[3][3][2], signs_in_time_[3][3][3][2], signs_in_space_[3][3][3][2];
    CountedModel rest_;
    Weights<3> count_weights_[most_counted][2], sign_weights_[2];
};

// Prediction of residuals on one axis: the residual of the reference, and a sum of nearby changes with weights that
// learn.
//
// Where nearly every vertex of every frame has a residual, residuals continue as at the same place in earlier frames,
// and as at the previous places.
using StepPredictor = LearningPredictor<5, largest_residual>;

// Which vertices of which frames have a residual, and the residuals.
//
// Frame after frame, patch after patch: whether any vertex of the patch has one, whether any of a span of eight places
// has, which, then the three numbers of each. Where few vertices have residuals, the patches say almost everything.
// Where nearly all have, these bits cost next to nothing, and the numbers matter: they may be predicted. A frame is
// predicted from its reference, usually the frame before, in a cycle the frame one turn before.
template <Mode mode> class ResidualModel {
public:
    // Residuals are read, or appended when decoding; `count` is their number.
    using Values = std::conditional_t<mode == Mode::decode, Residuals, const Residuals>;
    ResidualModel(RangeCoder<mode> &coder, std::span<const i64> patches, bool is_predicted, Values &residuals,
                  i64 count);

    // Code the residuals of `frames` frames; `distances` to their references are read when encoding. CorruptError if
    // the bytes are impossible.
    void code(i64 frames, std::span<const i64> distances);

    // Begin with the first frame again, for other places. Only models that belong to single places are reset.
    void begin_again();

private:
    static constexpr int count_classes = 6;  // vertices of a patch that have a residual: 0, 1, 2, 3+, 6+, 16+
    static constexpr i64 span_size = 8;      // places with one bit for all: where residuals are few, most need no other
    using Misses = std::array<i32, 3>;

    static int count_class(i64 count) {
        if (count < 3) return static_cast<int>(count);
        return count < 6 ? 3 : count < 16 ? 4 : 5;
    }

    // Return whether the next residual of the frame is at a place before this one; irrelevant when decoding.
    bool is_next_before(i64 place) const {
        if constexpr (mode == Mode::decode)
            return false;
        else
            return at_ < frame_end_ && residuals_.places[at_] < place;
    }

    // Return the residual of a place in the frame's reference, or (`in_frame`) in the frame itself; -1 if it has none.
    i64 in_reference(i64 place) const {
        const i64 last = last_[place];
        return static_cast<u64>(last - near_begin_) < static_cast<u64>(near_end_ - near_begin_) ? last : -1;
    }
    i64 in_frame(i64 place) const { return place >= 0 && last_[place] >= frame_begin_ ? last_[place] : -1; }
    i64 earlier(i64 residual) const { return residual >= 0 ? earlier_[residual] : -1; }
    i64 number(i64 residual, int axis) const { return residual >= 0 ? residuals_.quantised[residual][axis] : 0; }

    // Places from `begin` to `end` - 1 that have a residual in the reference.
    int count_in_reference(i64 begin, i64 end) const;

    i64 code_distance(i64 frame, i64 distance, i64 wanted);
    void recall(i64 frame);
    void code_patch(std::size_t patch);
    i64 code_span(i64 begin, i64 end, int own);
    void code_residual(i64 place, i64 near, i64 before, i64 second);

    RangeCoder<mode> &coder_;
    std::span<const i64> patches_;
    bool is_predicted_, is_far_ = false;  // far: the reference is not the frame before
    Values &residuals_;
    i64 count_, at_ = 0;                   // residuals in all, and coded so far
    i64 frame_begin_ = 0, frame_end_ = 0;  // residuals of the frame; the end is unknown when decoding
    i64 near_begin_ = 0, near_end_ = 0;    // residuals of the reference
    std::vector<i64> last_;                // latest residual of each place, -1 at first
    std::vector<i64> mean_sizes_;          // mean size of the misses at each place [1/16 of three axes]
    std::vector<i64> counts_;              // vertices with residuals in each patch, after two zeros and before one
    std::vector<Misses> misses_;           // misses of each residual
    std::vector<i64> earlier_;             // for each residual, the one at the same place in the reference, or -1

    MissModel miss_model_;
    StepPredictor predictors_[2][2][2][3];  // far reference, place before and reference have a residual, axis
    BitModel is_same_distance_;
    CountedModel distance_;
    BitModel patch_beside_[count_classes][count_classes][2][3];
    BitModel patch_around_[count_classes][count_classes][count_classes];
    BitModel span_around_[4][4][2][2], span_so_far_[8][4][count_classes];
    BitModel vertex_around_[4][2][2][2], vertex_so_far_[3][span_size][count_classes][2];
    std::vector<BitModel> by_patch_, by_place_, by_span_;  // a span is known by its first place
    Weights<3> patch_weights_, span_weights_, vertex_weights_[2];
};

}  // namespace pdeanim
