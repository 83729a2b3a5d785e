// Orthonormal functions on the points of an element, made one after another.
//
// Classical Gram-Schmidt, a second time where the first cancels, is as orthogonal as the modified one (Giraud, Langou and
// Rozloznik 2005, "The loss of orthogonality in the Gram-Schmidt orthogonalization process"), and runs along all functions
// at once. The functions are floating-point numbers that no decision hangs on but one, whether a column is dropped, and the
// encoder keeps clear of it (`nearest`).
#pragma once

#include <limits>
#include <memory>

#include "arithmetic.hpp"
#include "linear_algebra/add_product.hpp"

namespace pdeanim {

class OrthonormalFunctions {
public:
    // Begin anew, for so many points and functions at most.
    void begin(i64 points, i64 most);

    i64 count() const { return count_; }
    bool is_complete() const { return count_ == most_; }
    const double *function(i64 k) const { return functions_.get() + k * width_; }

    // A row for each.
    Strided<double> all() const { return {functions_.get(), width_, 1}; }

    // What `add` adds: a number for each point.
    double *column() { return column_.get(); }

    // Orthonormalise the column on the functions that there are; false where too little of it is new. `share`: that of
    // its squared norm that must be new; 0 where the column is one that the file names. Of such a column that is all old
    // the function is zero.
    bool add(double share);

    // Add unit vectors, point after point, as long as functions are missing. None are then, where `share` is below
    // 1 / points: as long as one is, some point has not been looked at or has more than that to add.
    void add_unit_vectors(double share);

    // Make the functions zero that are missing.
    void add_zeros();

    // The least distance of a column's new share from the one that decides, relative to it; so far.
    double nearest = std::numeric_limits<double>::infinity();

private:
    double squared_norm() const;

    // Room that grows, without values.
    struct Room {
        void grow(i64 size);
        double *get() const { return values.get(); }
        std::unique_ptr<double[]> values;
        i64 size = 0;
    };

    i64 points_ = 0, most_ = 0, count_ = 0;
    i64 width_ = 0;  // of a function in memory, where zeros follow it
    Room column_, part_, functions_;
};

}  // namespace pdeanim
