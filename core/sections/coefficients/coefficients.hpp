// Quantised coefficients of a group of frames (a chunk of section COEF).
//
// They form rows, one per function of space, with one number per channel. There is a channel for each function of time,
// or three if each axis has its own coefficients. Functions of time are ordered by falling importance, as are the
// functions of space within a subband, so nonzero values gather in a corner. Rows are coded subband by subband: the
// affine functions of the whole mesh, the wavelets of each node of the partition tree, the other functions of each
// element.
//
// This folder codes section COEF (14 of the specification). Begin here: coefficients.cpp goes through the rows and
// finds their neighbours, coefficient_model.hpp codes the values.
#pragma once

#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "base/arithmetic.hpp"
#include "base/errors.hpp"

namespace pdeanim {

// For each function of space, its row up to the last channel that may not be zero.
using QuantisedRows = std::span<const std::span<const i64>>;

// Rows, each as long as it was coded: most are short. A row keeps its address when other rows are added, so another
// thread may read existing rows.
class CoefficientRows {
public:
    // Make empty rows. A row takes memory for a multiple of `block` numbers, and is padded with zeros.
    CoefficientRows(i64 rows, i64 block, TakenMemory taken) : taken_(std::move(taken)), block_(block) {
        taken_.take(sizeof(rows_[0]) * static_cast<u64>(rows), what);
        rows_.resize(rows);
    }

    QuantisedRows all() const { return rows_; }
    std::span<const i64> operator[](i64 row) const { return rows_[row]; }

    // Return an empty row, for use as a row that does not exist.
    std::span<const i64> none() const { return {}; }

    // Return the distance in memory between the rows that one call of `add` allocates.
    i64 width(i64 count) const { return (count + block_ - 1) / block_ * block_; }

    // Allocate `count` zeros in each of the rows `first` to `end` - 1; return the start of row `first`.
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
    // Count of numbers that are allocated together; they fit in the first-level cache.
    static constexpr i64 piece = 1 << 13;
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
    // The depth of a node (0 for the affine functions of the whole mesh); or for an element, -1 minus the number of its
    // affine functions.
    std::span<const i64> kinds;
    std::span<const i64> parents;  // subband of the node above; unused for subband 0

    i64 count() const { return static_cast<i64>(kinds.size()); }
};

struct CoefficientLayout {
    Subbands subbands;
    i64 rows = 0, channels = 0;
    int axes = 1;  // 3 if each axis has its own channel

    // Raise std::invalid_argument unless all members fit together.
    void check() const;
};

// Encode coefficients of at most 2^40 in magnitude; empty if all are zero.
std::vector<u8> encode_coefficients(const CoefficientLayout &layout, std::span<const i64> coefficients);

// Measure the bits that `encode_coefficients` takes. copies: how many subbands each subband stands for, of which only
// the first trains the models; may be empty.
double measure_coefficients(const CoefficientLayout &layout, std::span<const i64> coefficients,
                            std::span<const double> copies = {});

// Undoes `encode_coefficients` a few subbands at a time, so that other threads can use the decoded subbands while the
// next ones are decoded.
class CoefficientDecoder {
public:
    // The layout's arrays and the data must outlive this object, which cannot be moved. LimitError, here or later, if
    // rows take more memory than is left.
    CoefficientDecoder(const CoefficientLayout &layout, std::span<const u8> data, TakenMemory taken = {});
    ~CoefficientDecoder();

    // Decode the subbands up to `end` - 1 that are not decoded yet; CorruptError if a number is out of range.
    void decode(i64 end);

    // Return all rows; rows that are not decoded yet are empty.
    QuantisedRows rows() const { return rows_.all(); }

    // Raise CorruptError unless the bytes end where the coefficients end.
    void finish() const;

private:
    class State;

    CoefficientRows rows_;
    std::unique_ptr<State> state_;  // null without bytes: all coefficients are zero
};

}  // namespace pdeanim
