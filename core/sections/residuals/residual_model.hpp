// Context models of residuals' prediction errors: the residual minus its prediction, or minus zero.
//
// The expected magnitude follows from the errors at the same place in the frame's reference, at the previous place, and
// on the previous axes. If it is small, the magnitude is counted up in unary, each step a mixed bit. If it is large,
// some low digits are left out of the counting, and follow after the sign.
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

// Errors are remembered in 32 bits: they only predict magnitudes.
constexpr i64 largest_remembered_miss = (i64{1} << 31) - 1;

// The context of a prediction error.
struct MissContext {
    int axis = 0;
    bool has_reference = false,
         has_before = false;   // whether there is a residual at this place in the reference, and at the place before
    bool is_not_zero = false;  // whether this axis must not be zero, because the other two are
    i64 mean_size = 0;         // mean magnitude of the errors at this place [1/16 of three axes]
    i64 in_time = 0, in_space = 0;       // remembered errors at this place in the reference, and at the previous place
    i64 one_before = 0, two_before = 0;  // magnitudes of the errors one and two axes before
    int agreed_in_time = 0,
        agreed_in_space = 0;  // number of previous axes on which both signs agree, minus those on which they differ
};

constexpr int sign_of(i64 number) { return (number > 0) - (number < 0); }

class MissModel {
public:
    // Code an error. CorruptError if the bytes hold a value out of range.
    template <Mode mode> i64 code(RangeCoder<mode> &coder, const MissContext &known, i64 miss);

private:
    static constexpr int expected_classes = 24;  // 20 classes of small sizes, then four classes that all octaves share
    static constexpr int near_classes = 8;       // magnitudes of a neighbour: 0 to 5; 6 and more; no neighbour
    static constexpr int beside_classes = 8;     // magnitudes on a previous axis: 0 to 6; 7 and more
    static constexpr int most_counted = 18;    // largest number that is counted in unary; the rest is coded as a number
    static constexpr int fine_digits = 5;      // digits of the expected magnitude up to which all digits are counted
    static constexpr int modelled_digits = 2;  // number of the digits left out, from the top, that have bit models

    BitModel by_expected_[expected_classes][3][most_counted];
    BitModel by_near_[near_classes][near_classes][2][most_counted];
    BitModel by_beside_[beside_classes][beside_classes][3][2][most_counted];
    BitModel lower_digits_[most_counted + 1][1 << modelled_digits];
    BitModel signs_[3][3][2], signs_in_time_[3][3][3][2], signs_in_space_[3][3][3][2];
    CountedModel rest_;
    Weights<3> count_weights_[most_counted][2], sign_weights_[2];
};

// Prediction of residuals on one axis: the reference's residual, plus a sum of nearby changes with weights that learn.
//
// If nearly every vertex of every frame has a residual, residuals resemble those of the same place in earlier frames,
// and those of the previous places.
using StepPredictor = LearningPredictor<5, largest_residual>;

// The residuals of all frames, and the vertices that have them.
//
// The order is frame after frame and patch after patch: whether any vertex of the patch has a residual, whether any of
// a span of eight places has one, which places have, then the three numbers of each. If few vertices have residuals,
// most of them follow from the bits of the patches. If nearly all have one, these bits cost next to nothing, and the
// numbers matter, which may be predicted. A frame is predicted from its reference, which is usually the frame before,
// or in cyclic motion the frame one cycle earlier.
template <Mode mode> class ResidualModel {
public:
    // Residuals are read when encoding, and appended when decoding; `count` is their total number.
    using Values = std::conditional_t<mode == Mode::decode, Residuals, const Residuals>;
    ResidualModel(RangeCoder<mode> &coder, std::span<const i64> patches, bool is_predicted, Values &residuals,
                  i64 count);

    // Code the residuals of `frames` frames. distances: for each frame, how many frames before it its reference lies;
    // read when encoding. CorruptError if the bytes are impossible.
    void code(i64 frames, std::span<const i64> distances);

    // Start again with the first frame, for other places. Only models of single places are reset.
    void begin_again();

private:
    static constexpr int count_classes = 6;  // numbers of a patch's vertices with a residual: 0, 1, 2, 3+, 6+, 16+
    static constexpr i64 span_size = 8;      // places that share a bit; if residuals are few, most places need no other
    using Misses = std::array<i32, 3>;

    static int count_class(i64 count) {
        if (count < 3) return static_cast<int>(count);
        return count < 6 ? 3 : count < 16 ? 4 : 5;
    }

    // Return whether the next residual of the frame is at a place before `place`; meaningless when decoding.
    bool is_next_before(i64 place) const {
        if constexpr (mode == Mode::decode)
            return false;
        else
            return at_ < frame_end_ && residuals_.places[at_] < place;
    }

    // Return the residual of a place in the frame's reference, or (`in_frame`) in the frame itself; -1 if the place has
    // none.
    i64 in_reference(i64 place) const {
        const i64 last = last_[place];
        return static_cast<u64>(last - near_begin_) < static_cast<u64>(near_end_ - near_begin_) ? last : -1;
    }
    i64 in_frame(i64 place) const { return place >= 0 && last_[place] >= frame_begin_ ? last_[place] : -1; }
    i64 earlier(i64 residual) const { return residual >= 0 ? earlier_[residual] : -1; }
    i64 number(i64 residual, int axis) const { return residual >= 0 ? residuals_.quantised[residual][axis] : 0; }

    // Return the number of places from `begin` to `end` - 1 that have a residual in the reference.
    int count_in_reference(i64 begin, i64 end) const;

    i64 code_distance(i64 frame, i64 distance, i64 wanted);
    void recall(i64 frame);
    void code_patch(std::size_t patch);
    i64 code_span(i64 begin, i64 end, int own);
    void code_residual(i64 place, i64 near, i64 before, i64 second);

    RangeCoder<mode> &coder_;
    std::span<const i64> patches_;
    bool is_predicted_, is_far_ = false;  // far: the reference is not the previous frame
    Values &residuals_;
    i64 count_, at_ = 0;                   // number of residuals in total, and coded so far
    i64 frame_begin_ = 0, frame_end_ = 0;  // residuals of the frame; the end is unknown when decoding
    i64 near_begin_ = 0, near_end_ = 0;    // residuals of the reference
    std::vector<i64> last_;                // latest residual of each place, -1 at first
    std::vector<i64> mean_sizes_;          // mean size of the misses at each place [1/16 of three axes]
    std::vector<i64> counts_;     // vertices with residuals in each patch, with two zeros in front and one at the end
    std::vector<Misses> misses_;  // misses of each residual
    std::vector<i64> earlier_;    // for each residual, the residual of the same place in the reference, or -1

    MissModel miss_model_;
    StepPredictor predictors_[2][2][2][3];  // far reference, residual at the place before, in the reference, axis
    BitModel is_same_distance_;
    CountedModel distance_;
    BitModel patch_beside_[count_classes][count_classes][2][3];
    BitModel patch_around_[count_classes][count_classes][count_classes];
    BitModel span_around_[4][4][2][2], span_so_far_[8][4][count_classes];
    BitModel vertex_around_[4][2][2][2], vertex_so_far_[3][span_size][count_classes][2];
    std::vector<BitModel> by_patch_, by_place_, by_span_;  // a span is identified by its first place
    Weights<3> patch_weights_, span_weights_, vertex_weights_[2];
};

}  // namespace pdeanim
