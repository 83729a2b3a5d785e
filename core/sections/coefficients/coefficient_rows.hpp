// Quantised coefficients in rows, one for each function of space, each as long as it was coded: most are short.
//
// A row stays where it is when others are added, so that another thread may read those that are there.
#pragma once

#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "base/arithmetic.hpp"
#include "base/memory_limit.hpp"

namespace pdeanim {

// Of each function of space its channels up to the last that may not be zero.
using QuantisedRows = std::span<const std::span<const i64>>;

class CoefficientRows {
public:
    // Rows of no numbers; a row takes memory for a multiple of `block` numbers, and zeros follow its own there.
    CoefficientRows(i64 rows, i64 block, TakenMemory taken) : taken_(std::move(taken)), block_(block) {
        taken_.take(sizeof(rows_[0]) * static_cast<u64>(rows), what);
        rows_.resize(rows);
    }

    QuantisedRows all() const { return rows_; }
    std::span<const i64> operator[](i64 row) const { return rows_[row]; }

    // In the place of a row that is not there.
    std::span<const i64> none() const { return {}; }

    // From one row that `add` has made room for to the next.
    i64 width(i64 count) const { return (count + block_ - 1) / block_ * block_; }

    // Make room for so many numbers in each of the rows `first` to `end` - 1; returns where the first one's begin, zeros.
    i64 *add(i64 first, i64 end, i64 count) {
        if (count == 0) return nullptr;
        const i64 wide = width(count), needed = (end - first) * wide;
        if (needed > left_) {
            left_ = most(needed, piece);
            taken_.take(sizeof(i64) * static_cast<u64>(left_), what);
            pieces_.push_back(std::make_unique<i64[]>(left_));
            next_ = pieces_.back().get();
        }
        i64 *const begin = next_;
        for (i64 row = first; row < end; ++row, next_ += wide) {
            rows_[row] = {next_, static_cast<std::size_t>(count)};
        }
        left_ -= needed;
        return begin;
    }

private:
    static constexpr i64 piece = 1 << 13;  // numbers that memory is taken for at once: they fit into the nearest caches
    static constexpr const char *what = "coefficients of a group of frames";

    TakenMemory taken_;
    i64 block_, left_ = 0;
    i64 *next_ = nullptr;
    std::vector<std::span<const i64>> rows_;
    std::vector<std::unique_ptr<i64[]>> pieces_;
};

}  // namespace pdeanim
