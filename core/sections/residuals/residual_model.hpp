// Which vertices of which frames have a residual, and the residuals.
//
// Frame after frame, patch after patch: whether any vertex of the patch has one, whether any of a span of eight places
// has, which, then the three numbers of each. Where few vertices have residuals, the patches say almost all. Where
// nearly all have, these bits cost next to nothing, and the numbers count: they may be predicted. What a frame is
// expected to be like follows from its reference, mostly the frame before, in a cycle the frame one turn before.
#pragma once

#include <type_traits>
#include <vector>

#include "entropy/range_coder.hpp"
#include "sections/residuals/miss_model.hpp"
#include "sections/residuals/residuals.hpp"
#include "sections/residuals/step_predictor.hpp"

namespace pdeanim {

template <Mode mode> class ResidualModel {
public:
    // Residuals are read, or appended when decoding; `count` is how many there are.
    using Values = std::conditional_t<mode == Mode::decode, Residuals, const Residuals>;
    ResidualModel(RangeCoder<mode> &coder, std::span<const i64> patches, bool is_predicted, Values &residuals,
                  i64 count);

    // Code the residuals of so many frames; `distances` of their references are read unless decoding. CorruptError
    // where the bytes say what cannot be.
    void code(i64 frames, std::span<const i64> distances);

    // Begin with the first frame again, of other places: models that are not of single places have learned.
    void begin_again();

private:
    static constexpr int count_classes = 6;  // of how many vertices of a patch have one: 0, 1, 2, from 3, 6, 16 on
    static constexpr i64 span_size = 8;      // places with one bit for all: where residuals are few, most need no other
    using Misses = std::array<i32, 3>;

    static int count_class(i64 count) {
        if (count < 3) return static_cast<int>(count);
        return count < 6 ? 3 : count < 16 ? 4 : 5;
    }

    // Whether the next residual of the frame is at a place before this one; of no matter when decoding.
    bool is_next_before(i64 place) const {
        if constexpr (mode == Mode::decode)
            return false;
        else
            return at_ < frame_end_ && residuals_.places[at_] < place;
    }

    // The residual of a place in the frame's reference; that of a place in the frame itself; -1 for none.
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
    bool is_predicted_, is_far_ = false;  // whether the reference is not the frame before
    Values &residuals_;
    i64 count_, at_ = 0;                   // residuals in all, and coded so far
    i64 frame_begin_ = 0, frame_end_ = 0;  // residuals of the frame; the end is unknown when decoding
    i64 near_begin_ = 0, near_end_ = 0;    // residuals of the reference
    std::vector<i64> last_;                // of each place: its latest residual, -1 at first
    std::vector<i64> mean_sizes_;          // of each place: of its misses [1/16 of three axes]
    std::vector<i64> counts_;  // of each patch: vertices with residuals; two zeros before the first, one after the last
    std::vector<Misses> misses_;  // of each residual
    std::vector<i64> earlier_;    // of each residual: that of its place in the reference, or -1

    MissModel miss_model_;
    StepPredictor predictors_[2][2][2][3];  // far reference, place before and reference have a residual, axis
    BitModel is_same_distance_;
    CountedModel distance_;
    BitModel patch_beside_[count_classes][count_classes][2][3];
    BitModel patch_around_[count_classes][count_classes][count_classes];
    BitModel span_around_[4][4][2][2], span_so_far_[8][4][count_classes];
    BitModel vertex_around_[4][2][2][2], vertex_so_far_[3][span_size][count_classes][2];
    std::vector<BitModel> by_patch_, by_place_, by_span_;  // the latter by its first place
    Weights<3> patch_weights_, span_weights_, vertex_weights_[2];
};

}  // namespace pdeanim
