#include "sections/spatial/orthonormal.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "linalg/products.hpp"

namespace pdeanim {

namespace {

// Share of the squared norm that must be left after one pass for the second to be skipped: then little more than one
// binary digit was lost.
constexpr double once_is_enough = 0.125;

// Of the share that must be new of a unit vector, so much less is certainly too little, however it is computed.
constexpr double certainly = 0.5;

void grow(AlignedArray<double> &numbers, i64 size) {
    if (static_cast<i64>(numbers.size()) < size) numbers = AlignedArray<double>(size);
}

}  // namespace

void OrthonormalFunctions::begin(i64 points, i64 most) {
    points_ = points;
    most_ = most;
    count_ = 0;
    width_ = row_width(points);
    grow(columns_, columns_at_once * width_);
    grow(functions_, most * width_);
}

double OrthonormalFunctions::squared_norm(const double *column) const {
    return sum_of_products(column, column, width_);
}

// Take away from columns what lies along functions `first` to `end` - 1.
void OrthonormalFunctions::take_away(std::span<Column *const> columns, i64 first, i64 end) {
    std::array<double *, columns_at_once> values;
    for (std::size_t k = 0; k < columns.size(); ++k) values[k] = columns[k]->values;
    take_away_parts({values.data(), columns.size()}, function(first), end - first, width_);
    for (Column *own : columns) own->left = squared_norm(own->values);
}

// A second time, along all of the first `end` functions, from those of which little was left.
void OrthonormalFunctions::take_away_again(std::span<Column *const> columns, i64 end) {
    std::array<Column *, columns_at_once> again;
    std::size_t count = 0;
    for (Column *own : columns) {
        if (own->left > once_is_enough * own->begun) continue;
        own->begun = own->left;
        again[count++] = own;
    }
    take_away({again.data(), count}, 0, end);
}

std::array<i64, OrthonormalFunctions::columns_at_once> OrthonormalFunctions::add(i64 columns, double share, i64 first) {
    const i64 known = count_;
    std::array<Column, columns_at_once> own;
    std::array<Column *, columns_at_once> all;
    for (i64 k = 0; k < columns; ++k) {
        double *values = column(k);
        std::fill(values + points_, values + width_, 0.0);
        const double norm = squared_norm(values);
        own[k] = {values, norm, norm, norm};
        all[k] = &own[k];
    }
    std::array<i64, columns_at_once> added;
    added.fill(-1);
    for (i64 begin = 0, end = 0; begin < columns && !is_complete(); begin = end) {
        // No more than can be added, if none of them is dropped.
        end = least(columns, begin + missing());
        const std::span<Column *const> some{all.data() + begin, all.data() + end};
        take_away(some, first, known);
        take_away_again(some, known);
        for (i64 k = begin; k < end; ++k) {
            const std::span<Column *const> one(&all[k], 1);
            if (count_ > known) {
                take_away(one, known, count_);
                take_away_again(one, count_);
            }
            added[k] = keep(own[k], share);
        }
    }
    return added;
}

void OrthonormalFunctions::note_nearest(double left) { nearest = std::min(nearest, std::abs(left - 1.0)); }

// Add what is left of a column.
i64 OrthonormalFunctions::keep(const Column &column, double share) {
    if (share > 0.0) {
        const double least_left = share * column.before;
        if (column.before > 0.0) note_nearest(column.left / least_left);
        if (!(column.left > least_left)) return -1;
    }
    const double scale = column.left > 0.0 ? 1.0 / std::sqrt(column.left) : 0.0;
    double *found = functions_.data() + count_ * width_;
    for (i64 i = 0; i < width_; ++i) found[i] = column.values[i] * scale;
    return count_++;
}

void OrthonormalFunctions::add_unit_vectors(double share) {
    // Of the squares of unit vectors, what is along no function: next to nothing of those that come last.
    std::vector<double> left(points_, 1.0);
    for (i64 j = 0, known = 0; j < points_ && !is_complete(); ++j) {
        for (; known < count_; ++known) {
            for (i64 i = j; i < points_; ++i) left[i] -= function(known)[i] * function(known)[i];
        }
        if (left[j] < certainly * share) {
            note_nearest(left[j] / share);
            continue;
        }
        std::fill_n(column(), points_, 0.0);
        column()[j] = 1.0;
        add(share);
    }
}

void OrthonormalFunctions::add_zeros() {
    std::fill_n(functions_.data() + count_ * width_, (most_ - count_) * width_, 0.0);
    count_ = most_;
}

}  // namespace pdeanim
