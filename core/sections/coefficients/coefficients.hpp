// Quantised coefficients of a group of frames (a chunk of section COEF).
//
// They stand in rows, one for each function of space, of as many numbers as there are channels: functions of time, or
// three times as many where each axis has its own. Functions of time stand by falling importance and so do those of
// space within a subband, so that what is not zero gathers in a corner. Rows are coded subband by subband: the whole's
// affine functions, the wavelets of each node of the partition tree, the other functions of each element.
//
// This folder codes section COEF (14 of the specification). Begin here: coefficients.cpp walks the rows and knows their
// neighbours, coefficient_model.hpp codes what it finds there.
#pragma once

#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "base/arithmetic.hpp"
#include "base/errors.hpp"

namespace pdeanim {

// Of each function of space its channels up to the last that may not be zero.
using QuantisedRows = std::span<const std::span<const i64>>;

// Rows, each as long as it was coded: most are short. A row stays where it is when others are added, so that another thread
// may read those that are there.
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

// Rows that are coded together: subband s is rows starts[s] to starts[s + 1] - 1.
struct Subbands {
    std::span<const i64> starts;
    // The depth of a node, 0 for the whole's affine functions; or -1 less the affine functions of an element.
    std::span<const i64> kinds;
    std::span<const i64> parents;  // subband of the node above; of no meaning for subband 0

    i64 count() const { return static_cast<i64>(kinds.size()); }
};

struct CoefficientLayout {
    Subbands subbands;
    i64 rows = 0, channels = 0;
    int axes = 1;  // 3 where channels come three by three, one for each axis

    // std::invalid_argument unless its parts agree with each other.
    void check() const;
};

// The coefficients as bytes; none where all are zero. Magnitudes are 2^40 at most.
std::vector<u8> encode_coefficients(const CoefficientLayout &layout, std::span<const i64> coefficients);

// Bits that `encode_coefficients` would take. `copies`, where it is not empty: of each subband, how many there are that are
// like it, of which only the first teaches the models.
double measure_coefficients(const CoefficientLayout &layout, std::span<const i64> coefficients,
                            std::span<const double> copies = {});

// Undoes `encode_coefficients` some subbands at a time, so that others may go on with those while the next are decoded.
class CoefficientDecoder {
public:
    // The layout's arrays and the data must outlive it; it stays where it is. LimitError, here or later, where rows take
    // more than is left.
    CoefficientDecoder(const CoefficientLayout &layout, std::span<const u8> data, TakenMemory taken = {});
    ~CoefficientDecoder();

    // Decode the rows of the subbands up to `end` - 1 that are not there yet; CorruptError where the bytes hold a number
    // that cannot be.
    void decode(i64 end);

    // All rows; those that are not there yet have no numbers.
    QuantisedRows rows() const { return rows_.all(); }

    // CorruptError unless the bytes end where the coefficients do.
    void finish() const;

private:
    class State;

    CoefficientRows rows_;
    std::unique_ptr<State> state_;  // none where there are no bytes: all coefficients are zero
};

}  // namespace pdeanim
