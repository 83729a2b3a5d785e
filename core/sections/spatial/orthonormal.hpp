// Orthonormal functions on the points of an element, made some at a time.
//
// Gram-Schmidt, a second time where the first cancels, which is as orthogonal as rounding allows (Giraud, Langou and
// Rozloznik 2005, "The loss of orthogonality in the Gram-Schmidt orthogonalization process"); where products with the first
// functions are known to be nothing but rounding, and not computed, that rounding grows along with the degree, to 1e-8 at
// worst. The functions are floating-point numbers that no decision hangs on but one, whether a column is dropped, and the
// encoder keeps clear of it (`nearest`).
#pragma once

#include <array>
#include <limits>
#include <span>

#include "base/arithmetic.hpp"
#include "base/arrays.hpp"
#include "linalg/products.hpp"

namespace pdeanim {

class OrthonormalFunctions {
public:
    static constexpr i64 columns_at_once = 8;

    // Begin anew, for so many points and functions at most.
    void begin(i64 points, i64 most);

    i64 count() const { return count_; }
    i64 missing() const { return most_ - count_; }
    bool is_complete() const { return missing() == 0; }
    const double *function(i64 k) const { return functions_.data() + k * width_; }

    // A row for each.
    Strided<double> all() const { return {functions_.data(), width_, 1}; }

    // What is added next: a number for each point.
    double *column(i64 k = 0) { return columns_.data() + k * width_; }

    // Orthonormalise columns on the functions that there are and on each other, and add them as long as functions are
    // missing; which function each has become, -1 for none: too little of it is new, or none is missing. What becomes of a
    // column does not depend on how many functions are wanted. `share`: that of its squared norm that must be; 0 where the
    // column is one that the file names. Of such a column that is all old the function is zero. `first`: the functions
    // before it have no part in any of the columns, but for rounding.
    std::array<i64, columns_at_once> add(i64 columns, double share, i64 first);

    // Add one; whether it was.
    bool add(double share) { return add(1, share, 0)[0] >= 0; }

    // Add unit vectors, point after point, as long as functions are missing. None are then, where `share` is below
    // 1 / points: as long as one is, some point has not been looked at or has more than that to add.
    void add_unit_vectors(double share);

    // Make the functions zero that are missing.
    void add_zeros();

    // The least distance of a column's new share from the one that decides, relative to it; so far.
    double nearest = std::numeric_limits<double>::infinity();

private:
    // One that is being orthonormalised, and squared norms: as it was given, when what was taken away last began to be, and
    // now.
    struct Column {
        double *values;
        double before, begun, left;
    };

    double squared_norm(const double *column) const;
    void take_away(std::span<Column *const> columns, i64 first, i64 end);
    void take_away_again(std::span<Column *const> columns, i64 end);
    i64 keep(const Column &column, double share);

    // `left`: of the share that decides, how much is new of a column.
    void note_nearest(double left);

    i64 points_ = 0, most_ = 0, count_ = 0;
    i64 width_ = 0;  // of a function in memory, where zeros follow it
    AlignedArray<double> columns_, functions_;
};

}  // namespace pdeanim
