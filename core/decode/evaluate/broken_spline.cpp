#include "decode/evaluate/broken_spline.hpp"

#include <algorithm>
#include <utility>

namespace pdeanim {

namespace {

// What both ends of a straight line of `step` seconds count at its share u, 0 to 1.
std::vector<double> straight(double u, double step, int derivative) {
    if (derivative == 0) return {1.0 - u, u};
    if (derivative == 1) return {-1.0 / step, 1.0 / step};
    return {0.0, 0.0};
}

}  // namespace

BrokenSpline::BrokenSpline(std::vector<double> times, std::vector<i64> jumps)
    : times_(std::move(times)), starts_(std::move(jumps)) {
    starts_.insert(starts_.begin(), 0);
    starts_.push_back(static_cast<i64>(times_.size()));
}

FrameShares BrokenSpline::shares(double time, int derivative) {
    const double inside = clamp(time, times_.front(), times_.back());
    const i64 frame = std::upper_bound(times_.begin(), times_.end(), inside) - times_.begin() - 1;
    const auto after = std::upper_bound(starts_.begin(), starts_.end() - 1, frame);
    const std::size_t stretch = static_cast<std::size_t>(after - starts_.begin()) - 1;
    const i64 first = starts_[stretch], end = starts_[stretch + 1];
    if (frame == end - 1 && end < starts_.back()) {
        const double step = times_[end] - times_[frame];
        return {frame, straight((inside - times_[frame]) / step, step, derivative)};
    }
    if (!spline_ || stretch_ != stretch) {
        spline_.emplace(std::vector(times_.begin() + first, times_.begin() + end));
        stretch_ = stretch;
    }
    FrameShares found{0, std::vector<double>(spline_->width())};
    found.first = first + spline_->weights(inside, derivative, found.values);
    return found;
}

}  // namespace pdeanim
