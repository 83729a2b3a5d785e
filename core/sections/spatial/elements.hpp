// Elements (patches of a mesh or pieces of its curves) and the orthonormal functions on each.
//
// The four affine functions 1, x, y and z come first, then polynomials of local coordinates by degree, or the functions
// of Eqs. 14 and 16 along a piece, then unit vectors. The file gives their number (`SpaceLayout`).
//
// A polynomial is made by multiplying an orthonormal one by a coordinate (Brubeck, Nakatsukasa and Trefethen 2021,
// "Vandermonde with Arnoldi"): this cancels few digits, even if powers of coordinates are nearly dependent.
#pragma once

#include <array>
#include <limits>
#include <memory>
#include <span>
#include <vector>

#include "base/arithmetic.hpp"
#include "base/arrays.hpp"
#include "linalg/products.hpp"
#include "mesh/bisection.hpp"
#include "mesh/z_order.hpp"
#include "sections/spatial/space_layout.hpp"

namespace pdeanim {

// Orthonormal functions on the points of an element, made a few at a time.
//
// This is Gram-Schmidt with a second pass for columns that lose many digits to cancellation, which is as orthogonal as
// rounding allows (Giraud, Langou and Rozloznik 2005, "The loss of orthogonality in the Gram-Schmidt orthogonalization
// process"). Products with the first functions are left out if they are known to be only rounding errors; the error of
// leaving them out grows with the degree, to 1e-8 at worst. The functions are floating-point numbers. Only one decision
// depends on them, whether a column is dropped, and the encoder keeps well away from its threshold (`nearest`).
class OrthonormalFunctions {
public:
    static constexpr i64 columns_at_once = 8;

    // Start an element of `points` points, with at most `most` functions.
    void begin(i64 points, i64 most);

    i64 count() const { return count_; }
    i64 missing() const { return most_ - count_; }
    bool is_complete() const { return missing() == 0; }
    const double *function(i64 k) const { return functions_.data() + k * width_; }

    // Return all functions, one per row.
    Strided<double> all() const { return {functions_.data(), width_, 1}; }

    // Return column k of those to be added next: one number per point.
    double *column(i64 k = 0) { return columns_.data() + k * width_; }

    // Orthonormalise columns against the functions so far and against each other, and add them until no function is
    // missing. Return the function that each column has become; -1 if too little of it is new, or no function is
    // missing. The result for a column does not depend on how many functions are wanted. share: fraction of a column's
    // squared norm that must be new; 0 for a column that the file names, whose function is zero if nothing is new.
    // first: the functions before it have no component in any of the columns, except for rounding errors.
    std::array<i64, columns_at_once> add(i64 columns, double share, i64 first);

    // Add one column; return whether it has become a function.
    bool add(double share) { return add(1, share, 0)[0] >= 0; }

    // Add unit vectors, point after point, until no function is missing. If `share` is below 1 / points, this always
    // succeeds: as long as a function is missing, more than `share` of some point's unit vector is new, or a point is
    // untried.
    void add_unit_vectors(double share);

    // Set the missing functions to zero.
    void add_zeros();

    // Smallest distance so far between the new fraction of a column and the deciding fraction, relative to the deciding
    // one.
    double nearest = std::numeric_limits<double>::infinity();

private:
    // A column in work, with its squared norm: at first, before the last subtraction, and now.
    struct Column {
        double *values;
        double before, begun, left;
    };

    double squared_norm(const double *column) const;
    void take_away(std::span<Column *const> columns, i64 first, i64 end);
    void take_away_again(std::span<Column *const> columns, i64 end);
    i64 keep(const Column &column, double share);

    // left: the new part of a column divided by the threshold.
    void note_nearest(double left);

    i64 points_ = 0, most_ = 0, count_ = 0;
    i64 width_ = 0;  // length of a function in memory, padding included
    AlignedArray<double> columns_, functions_;
};

// Local coordinates of an element: relative to its mean, along its principal axes, the widest first.
//
// One-sided Jacobi rotations in integers find the axes, so every machine finds the same. Coordinates that are nearly
// uncorrelated are not rotated: axes of equal width have no preferred direction, so rounding errors would choose a
// different one for every element.
struct LocalCoordinates {
    // Find the local coordinates of some vertices; return how many of them, from the first, exceed rounding errors.
    int locate(std::span<const GridPoint> grid, std::span<const i32> vertices);

    std::array<std::vector<i64>, 3> axes;
};

// Kinds of an element's columns that may be dropped.
enum Sort { polynomial_column, series_column, unit_vector, sort_count };

struct Elements {
    Elements(const SpaceForm &form, std::shared_ptr<const Patches> patches, std::span<const GridPoint> grid);

    i64 count() const { return patches->count(); }

    SpaceForm form;
    std::shared_ptr<const Patches> patches;
    std::span<const GridPoint> grid;        // must outlive the elements
    std::array<double, sort_count> shares;  // fraction of a column's squared norm that must be new, by kind
    std::vector<double> series;             // functions along pieces, at each vertex in order, not yet orthonormal
};

// Sums over an element of its affine functions times 1, x, y and z, relative to its first vertex.
using AffineSums = std::array<std::array<double, affine_count>, affine_count>;

// Makes the functions of one element after another.
class ElementFunctions {
public:
    explicit ElementFunctions(const Elements &elements) : elements_(elements) {}

    // Compute the sums of an element's affine functions. local: number of local coordinates that the affine functions
    // use, or -1 for as many as are more than rounding errors. Return this number.
    int describe(i64 element, int local, AffineSums &sums);

    // Make the first `count` functions of an element, `affine` of them affine; `count` is at most the number of points.
    // Functions that are missing are zero.
    void make(i64 element, i64 affine, i64 count);

    // Return the memory for elements of at most `points` points and `functions` functions [bytes].
    static u64 bytes(i64 points, i64 functions) {
        constexpr i64 coordinates = 9;  // per point: grid and local coordinates, and factors of polynomials
        constexpr i64 padding = cache_line / sizeof(double);
        const i64 columns = least(functions, points) + OrthonormalFunctions::columns_at_once + coordinates;
        return sizeof(double) * static_cast<u64>((points + padding) * columns);
    }

    const double *function(i64 k) const { return functions_.function(k); }
    Strided<double> functions() const { return functions_.all(); }
    double nearest() const { return functions_.nearest; }

private:
    int locate(i64 element);
    void add_affine(i64 count);
    bool set_column(int polynomial, i64 k);
    void add_polynomials();

    const Elements &elements_;
    OrthonormalFunctions functions_;
    LocalCoordinates local_;
    std::array<std::vector<double>, 3> axes_;  // the local coordinates as floating-point numbers
    std::array<i64, polynomial_count> made_;   // the function that each polynomial has become, -1 for none
    i64 points_ = 0;
};

}  // namespace pdeanim
