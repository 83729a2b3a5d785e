#include "basis/orthonormal.hpp"

#include <algorithm>
#include <cmath>

#include "basis/add_multiples.hpp"

namespace pdeanim {

namespace {

// Share of the squared norm that must be left after one pass for the second to be skipped: then little more than one
// binary digit was lost.
constexpr double once_is_enough = 0.125;

constexpr i64 lane = 8;  // rows in memory are a multiple of this long, so that inner loops have no odd end

constexpr i64 padded(i64 count) { return (count + lane - 1) / lane * lane; }

}  // namespace

void OrthonormalFunctions::Room::grow(i64 wanted) {
    if (wanted <= size) return;
    values = std::make_unique_for_overwrite<double[]>(wanted);
    size = wanted;
}

void OrthonormalFunctions::begin(i64 points, i64 most) {
    points_ = points;
    most_ = most;
    count_ = 0;
    width_ = padded(points);
    height_ = padded(most);
    column_.grow(width_);
    weights_.grow(height_);
    by_function_.grow(most * width_);
    by_point_.grow(points * height_);
    rows_.resize(most);
    for (i64 k = 0; k < most; ++k) rows_[k] = by_function_.get() + k * width_;
    point_rows_.resize(points);
    for (i64 i = 0; i < points; ++i) point_rows_[i] = by_point_.get() + i * height_;
}

double OrthonormalFunctions::squared_norm() const {
    const double *column = column_.get();
    double total = 0.0;
    for (i64 i = 0; i < points_; ++i) total += column[i] * column[i];
    return total;
}

bool OrthonormalFunctions::add(double share) {
    double *column = column_.get(), *weights = weights_.get();
    std::fill(column + points_, column + width_, 0.0);
    const double before = squared_norm();
    double after = before;
    if (count_ > 0) {
        for (int pass = 0; pass < 2; ++pass) {
            std::fill_n(weights, padded(count_), 0.0);
            add_multiples(weights, padded(count_), point_rows_.data(), column, points_);
            for (i64 k = 0; k < count_; ++k) weights[k] = -weights[k];
            add_multiples(column, width_, rows_.data(), weights, count_);
            after = squared_norm();
            if (after > once_is_enough * before) break;
        }
    }
    if (share > 0.0) {
        if (before > 0.0) nearest = std::min(nearest, std::abs(after / (share * before) - 1.0));
        if (!(after > share * before)) return false;
    }
    const double scale = after > 0.0 ? 1.0 / std::sqrt(after) : 0.0;
    double *row = rows_[count_];
    for (i64 i = 0; i < width_; ++i) row[i] = column[i] * scale;
    // Nothing is made orthogonal to the last function.
    if (count_ + 1 < most_) {
        if (count_ % lane == 0) {
            for (double *point : point_rows_) std::fill_n(point + count_, lane, 0.0);
        }
        for (i64 i = 0; i < points_; ++i) point_rows_[i][count_] = row[i];
    }
    ++count_;
    return true;
}

void OrthonormalFunctions::add_unit_vectors(double share) {
    for (i64 j = 0; j < points_ && !is_complete(); ++j) {
        std::fill_n(column_.get(), points_, 0.0);
        column_.get()[j] = 1.0;
        add(share);
    }
}

void OrthonormalFunctions::add_zeros() {
    for (; count_ < most_; ++count_) std::fill_n(rows_[count_], width_, 0.0);
}

}  // namespace pdeanim
