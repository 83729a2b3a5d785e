// Interpolation between frames: the cubic spline through all frames of a clip, as weights of the frames near a time.
//
// Eq. 12 of Fang et al. 2024 gives the four functions of time of one segment. In their well-conditioned form and at
// alpha = 0 they are the polynomials 1, t, t^2/2, t^3/6: a cubic. Between two frames the motion is one combination of
// these four; at a frame, where two pieces meet, the value and two derivatives agree. That is the cubic spline. At each
// end the first two pieces are one cubic (not-a-knot). A clip of 3 frames gives a parabola, of 2 a line, of 1 a
// constant.
//
// The spline depends on every frame, but on the frame k frames away only by 0.27^k. So a time needs only the frames of
// a window, and any frame can be decoded without the whole clip.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "base/arithmetic.hpp"

namespace pdeanim {

class FrameSpline {
public:
    // times: of the frames [s], at least one; increasing by at least 2^-53, within 2^53 of 0.
    explicit FrameSpline(std::vector<double> times);

    // Return the number of frames in a window.
    i64 width() const { return width_; }

    // Write the weights of the frames of a window for the position (derivative 0), the velocity (1) [1/s] or the
    // acceleration (2) [1/s^2] at a time, which is clamped to the clip; return the first frame of the window. For the
    // position at the time of a frame, this frame's weight is exactly 1, and all others are 0.
    i64 weights(double time, int derivative, std::span<double> weights) const;

private:
    // The equation for the slope s at a frame i: below s[i - 1] + (below + above + excess) s[i] + above s[i + 1] = left
    // d[i - 1] + right d[i], with d[i] the mean slope from frame i to frame i + 1. The first and the last frame have no
    // equation.
    struct Row {
        double below = 0.0, above = 0.0, excess = 0.0, left = 0.0, right = 0.0;
        // Pivots of the elimination that starts at the first row, that starts at the last row, and where both meet.
        double down = 1.0, up = 1.0, centre = 1.0;
    };

    void set_up_rows();
    void add_slope(i64 frame, double share, i64 first, std::span<double> slopes) const;
    void weights_of_polynomial(double time, int derivative, std::span<double> weights) const;

    i64 frames() const { return static_cast<i64>(times_.size()); }

    std::vector<double> times_;
    std::vector<double> steps_;  // from each frame to the next [s]
    std::vector<Row> rows_;      // one row per frame, for clips of 4 frames or more
    i64 half_ = 0;               // frames of a window on either side of a time
    i64 width_ = 0;
};

// Weights of consecutive frames, beginning at `first`. In a clip with discontinuities, a spline joins the frames of
// each stretch, and a straight line joins two stretches.
struct FrameShares {
    i64 first = 0;
    std::vector<double> values;

    i64 end() const { return first + static_cast<i64>(values.size()); }
};

class BrokenSpline {
public:
    // times: of the frames [s], as in FrameSpline. jumps: first frames of stretches other than the first, increasing,
    // each from 1 to the last frame.
    BrokenSpline(std::vector<double> times, std::vector<i64> jumps);

    // Return weights like FrameSpline::weights. The spline of the latest stretch is kept, so increasing times build
    // each spline once.
    FrameShares shares(double time, int derivative);

private:
    std::vector<double> times_;
    std::vector<i64> starts_;  // first frame of each stretch, then the number of frames
    std::size_t stretch_ = 0;  // stretch that the spline belongs to
    std::optional<FrameSpline> spline_;
};

}  // namespace pdeanim
