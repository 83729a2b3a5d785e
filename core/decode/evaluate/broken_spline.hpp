// Between frames of a clip that jumps: a spline through the frames of each stretch from jump to jump, a straight line
// from stretch to stretch.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "decode/evaluate/spline.hpp"

namespace pdeanim {

// What frames from `first` on count.
struct FrameShares {
    i64 first = 0;
    std::vector<double> values;

    i64 end() const { return first + static_cast<i64>(values.size()); }
};

class BrokenSpline {
public:
    // times: of the frames [s], as of FrameSpline. jumps: first frames of stretches other than the first, increasing, each
    // from 1 to the last frame.
    BrokenSpline(std::vector<double> times, std::vector<i64> jumps);

    // As FrameSpline::weights. The spline of the latest stretch is kept: times in order make each of them once.
    FrameShares shares(double time, int derivative);

private:
    std::vector<double> times_;
    std::vector<i64> starts_;  // of the stretches, and the number of frames
    std::size_t stretch_ = 0;  // that the spline is of
    std::optional<FrameSpline> spline_;
};

}  // namespace pdeanim
