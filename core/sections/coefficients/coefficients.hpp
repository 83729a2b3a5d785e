// Quantised coefficients of a group of frames (a chunk of section COEF).
//
// They stand in rows, one for each function of space, of as many numbers as there are channels: functions of time, or
// three times as many where each axis has its own. Functions of time stand by falling importance and so do those of
// space within a subband, so that what is not zero gathers in a corner. Rows are coded subband by subband: the whole's
// affine functions, the wavelets of each node of the partition tree, the other functions of each element.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "base/arithmetic.hpp"
#include "sections/coefficients/coefficient_rows.hpp"

namespace pdeanim {

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
