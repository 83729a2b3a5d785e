#include "decode/evaluate/spline.hpp"

#include <algorithm>
#include <array>
#include <utility>

namespace pdeanim {

namespace {

// Number of frames on either side of a time that contribute. At even times, frames further away weigh (2 - sqrt 3)^16 <
// 1e-9, a fiftieth of float32's resolution.
constexpr i64 half_window = 16;
// This number at uneven times: each further frame weighs at most half as much as the one before it, and 2^-30 < 1e-9.
constexpr i64 half_window_uneven = 30;
// Times are even if no two steps differ by more than this factor: then each further frame weighs 0.28 as much.
constexpr double even = 1.1;

// Return the weights of the values and slopes at both ends of a piece, at the fraction u (0 to 1) of its length.
std::array<double, 4> hermite(double u, double step, int derivative) {
    if (derivative == 0) {
        const double back = 1.0 - u;
        return {(1.0 + 2.0 * u) * (back * back), u * u * (3.0 - 2.0 * u), u * (back * back) * step,
                -u * u * back * step};
    }
    if (derivative == 1) {
        const double slope = 6.0 * u * (u - 1.0) / step;
        return {slope, -slope, (3.0 * u - 1.0) * (u - 1.0), u * (3.0 * u - 2.0)};
    }
    const double bend = (12.0 * u - 6.0) / step / step;
    return {bend, -bend, (6.0 * u - 4.0) / step, (6.0 * u - 2.0) / step};
}

}  // namespace

FrameSpline::FrameSpline(std::vector<double> times) : times_(std::move(times)) {
    steps_.reserve(frames());
    for (i64 i = 1; i < frames(); ++i) steps_.push_back(times_[i] - times_[i - 1]);
    const auto [shortest, longest] = std::minmax_element(steps_.begin(), steps_.end());
    half_ = steps_.empty() || *longest <= even * *shortest ? half_window : half_window_uneven;
    width_ = least(frames(), 2 * half_ + 2);
    if (frames() > 3) set_up_rows();
}

// The condition at the ends ties the slope of the end frame to the next two slopes; it is substituted into the
// neighbouring rows. Every diagonal entry is stored as its excess over the rest of its row, so there are only sums,
// products and quotients of positive numbers: nothing cancels, however uneven the steps.
void FrameSpline::set_up_rows() {
    const i64 last_row = frames() - 2;
    rows_.resize(frames());
    for (i64 i = 1; i <= last_row; ++i) {
        const double before = steps_[i - 1], after = steps_[i];
        rows_[i] = {after, before, before + after, 3.0 * after, 3.0 * before};
    }
    const double first = steps_[0], second = steps_[1], last = steps_[last_row], last_but_one = steps_[last_row - 1];
    rows_[1].below = 0.0;
    rows_[1].excess = second;
    rows_[1].left = second * second / (first + second);
    rows_[1].right = first * (2.0 * first + 3.0 * second) / (first + second);
    rows_[last_row].above = 0.0;
    rows_[last_row].excess = last_but_one;
    rows_[last_row].left = last * (2.0 * last + 3.0 * last_but_one) / (last + last_but_one);
    rows_[last_row].right = last_but_one * last_but_one / (last + last_but_one);
    double remains = 0.0;  // 1 minus the quotient from eliminating the previous row
    for (i64 i = 1; i <= last_row; ++i) {
        Row &row = rows_[i];
        row.centre = row.excess + row.below * remains;
        row.down = row.centre + row.above;
        remains = row.centre / row.down;
    }
    remains = 0.0;
    for (i64 i = last_row; i > 0; --i) {
        Row &row = rows_[i];
        const double own = row.excess + row.above * remains;
        row.centre += row.above * remains;
        row.up = own + row.below;
        remains = own / row.up;
    }
}

// Add the slope at a frame, times `share`. Slopes are expressed by weights of the mean slopes between the frames of a
// window that begins at frame `first`.
void FrameSpline::add_slope(i64 frame, double share, i64 first, std::span<double> slopes) const {
    const i64 last = frames() - 1, end = first + static_cast<i64>(slopes.size());
    i64 row = frame;
    if (frame == 0 || frame == last) {  // the first two pieces are one cubic, and so are the last two
        const i64 outer = frame == 0 ? 0 : last - 1, inner = frame == 0 ? 1 : last - 2;
        const double h = steps_[outer], k = steps_[inner];
        slopes[outer - first] += share * ((3.0 * h + 2.0 * k) / (h + k));
        slopes[inner - first] += share * (h / k * (h / (h + k)));
        share *= -(h + k) / k;
        row = frame == 0 ? 1 : last - 1;
    }
    double entry = share / rows_[row].centre;  // entry of the slope's row in the inverse matrix
    for (i64 i = row; i < least(end, last); ++i) {
        if (i > row) entry *= -rows_[i - 1].above / rows_[i].up;
        slopes[i - 1 - first] += entry * rows_[i].left;
        slopes[i - first] += entry * rows_[i].right;
    }
    entry = share / rows_[row].centre;
    for (i64 i = row - 1; i > first; --i) {
        entry *= -rows_[i + 1].below / rows_[i].down;
        slopes[i - 1 - first] += entry * rows_[i].left;
        slopes[i - first] += entry * rows_[i].right;
    }
}

// Weights of the polynomial through all frames of a clip of 1 to 3 frames (Lagrange).
void FrameSpline::weights_of_polynomial(double time, int derivative, std::span<double> weights) const {
    for (i64 i = 0; i < frames(); ++i) {
        double value = 1.0, slope = 0.0, bend = 0.0, distances = 1.0;
        for (i64 k = 0; k < frames(); ++k) {
            if (k == i) continue;
            const double gap = time - times_[k];
            bend = bend * gap + 2.0 * slope;
            slope = slope * gap + value;
            value *= gap;
            distances *= times_[i] - times_[k];
        }
        weights[i] = (derivative == 0 ? value : derivative == 1 ? slope : bend) / distances;
    }
}

i64 FrameSpline::weights(double time, int derivative, std::span<double> weights) const {
    const double inside = clamp(time, times_.front(), times_.back());
    if (rows_.empty()) {
        weights_of_polynomial(inside, derivative, weights);
        return 0;
    }
    const i64 at = std::upper_bound(times_.begin(), times_.end(), inside) - times_.begin();
    const i64 piece = clamp<i64>(at - 1, 0, frames() - 2), first = clamp<i64>(piece - half_, 0, frames() - width_);
    const std::array<double, 4> counts = hermite((inside - times_[piece]) / steps_[piece], steps_[piece], derivative);
    std::vector<double> slopes(width_ - 1);
    add_slope(piece, counts[2], first, slopes);
    add_slope(piece + 1, counts[3], first, slopes);
    std::fill(weights.begin(), weights.end(), 0.0);
    for (i64 i = 0; i < width_ - 1; ++i) {
        const double share = slopes[i] / steps_[first + i];
        weights[i] -= share;
        weights[i + 1] += share;
    }
    weights[piece - first] += counts[0];
    weights[piece + 1 - first] += counts[1];
    return first;
}

namespace {

// Return the weights of both ends of a straight line that lasts `step` [s], at the fraction u (0 to 1) of its length.
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
