#include "basis/orthonormal.hpp"

#include <algorithm>
#include <cmath>

#include "linear_algebra/gram_schmidt.hpp"
#include "linear_algebra/sum_of_products.hpp"

namespace pdeanim {

namespace {

// Share of the squared norm that must be left after one pass for the second to be skipped: then little more than one
// binary digit was lost.
constexpr double once_is_enough = 0.125;

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
    width_ = row_width(points);
    column_.grow(width_);
    part_.grow(width_);
    functions_.grow(most * width_);
}

double OrthonormalFunctions::squared_norm() const { return sum_of_products(column_.get(), column_.get(), width_); }

bool OrthonormalFunctions::add(double share) {
    double *column = column_.get();
    std::fill(column + points_, column + width_, 0.0);
    const double before = squared_norm();
    double after = before;
    if (count_ > 0) {
        for (int pass = 0; pass < 2; ++pass) {
            take_away_parts(column, functions_.get(), count_, width_, part_.get());
            after = squared_norm();
            if (after > once_is_enough * before) break;
        }
    }
    if (share > 0.0) {
        if (before > 0.0) nearest = std::min(nearest, std::abs(after / (share * before) - 1.0));
        if (!(after > share * before)) return false;
    }
    const double scale = after > 0.0 ? 1.0 / std::sqrt(after) : 0.0;
    double *found = functions_.get() + count_++ * width_;
    for (i64 i = 0; i < width_; ++i) found[i] = column[i] * scale;
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
    std::fill_n(functions_.get() + count_ * width_, (most_ - count_) * width_, 0.0);
    count_ = most_;
}

}  // namespace pdeanim
