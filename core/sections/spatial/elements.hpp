// Elements (patches of a mesh or pieces of its curves) and the orthonormal functions on each.
//
// The four affine functions 1, x, y and z come first, then polynomials of local coordinates by degree, or the functions
// of Eqs. 14 and 16 along a piece, then unit vectors. Their number is in the file (`SpaceLayout`).
//
// A polynomial is made from an orthonormal one, times a coordinate (Brubeck, Nakatsukasa and Trefethen 2021,
// "Vandermonde with Arnoldi"): little of it cancels then, even where powers of coordinates are nearly dependent.
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
// Gram-Schmidt, with a second pass where the first cancels, which is as orthogonal as rounding allows (Giraud, Langou
// and Rozloznik 2005, "The loss of orthogonality in the Gram-Schmidt orthogonalization process"). Products with the
// first functions are left out where they are known to be only rounding; that rounding grows with the degree, to 1e-8
// at worst. The functions are floating-point numbers. Only one decision depends on them, whether a column is dropped,
// and the encoder keeps well away from its threshold (`nearest`).
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

    // The k-th column to add next: one number per point.
    double *column(i64 k = 0) { return columns_.data() + k * width_; }

    // Orthonormalise columns against the functions so far and against each other, and add them as long as functions are
    // missing. Return the function that each column has become; -1 if too little of it is new, or none is missing. The
    // result for a column does not depend on how many functions are wanted. `share`: fraction of its squared norm that
    // must be new; 0 for a column that the file names, whose function is zero if nothing is new. `first`: the functions
    // before it have no component in any of the columns, except for rounding.
    std::array<i64, columns_at_once> add(i64 columns, double share, i64 first);

    // Add one column; return whether it was added.
    bool add(double share) { return add(1, share, 0)[0] >= 0; }

    // Add unit vectors, point after point, as long as functions are missing. If `share` is below 1 / points, none is
    // missing afterwards: as long as one is, some point has not been tried or has more than `share` to add.
    void add_unit_vectors(double share);

    // Set the missing functions to zero.
    void add_zeros();

    // Smallest distance so far between a column's new fraction and the deciding one, relative to the latter.
    double nearest = std::numeric_limits<double>::infinity();

private:
    // A column in work, with its squared norm: as given, before the last subtraction, and now.
    struct Column {
        double *values;
        double before, begun, left;
    };

    double squared_norm(const double *column) const;
    void take_away(std::span<Column *const> columns, i64 first, i64 end);
    void take_away_again(std::span<Column *const> columns, i64 end);
    i64 keep(const Column &column, double share);

    // left: the new part of a column, as a multiple of the part that decides.
    void note_nearest(double left);

    i64 points_ = 0, most_ = 0, count_ = 0;
    i64 width_ = 0;  // numbers of a function in memory, padding included
    AlignedArray<double> columns_, functions_;
};

// Local coordinates of an element: about its mean, along its principal axes, the widest first.
//
// One-sided Jacobi rotations in integers find them, so that every machine finds the same. Coordinates that are nearly
// uncorrelated stay as they are: axes of equal width have no direction of their own, and rounding would choose another
// one for every element.
struct LocalCoordinates {
    // Find the coordinates of these vertices; return how many of them, from the first, are more than rounding.
    int locate(std::span<const GridPoint> grid, std::span<const i32> vertices);

    std::array<std::vector<i64>, 3> axes;
};

// Columns of an element that may be dropped.
enum Sort { polynomial_column, series_column, unit_vector, sort_count };

struct Elements {
    Elements(const SpaceForm &form, std::shared_ptr<const Patches> patches, std::span<const GridPoint> grid);

    i64 count() const { return patches->count(); }

    SpaceForm form;
    std::shared_ptr<const Patches> patches;
    std::span<const GridPoint> grid;        // owned by the caller
    std::array<double, sort_count> shares;  // fraction of a column's squared norm that must be new
    std::vector<double> series;             // functions of pieces at each vertex in order, not yet orthonormal
};

// Sums of an element's affine functions times 1, x, y and z about its first vertex.
using AffineSums = std::array<std::array<double, affine_count>, affine_count>;

// Makes the functions of one element after another.
class ElementFunctions {
public:
    explicit ElementFunctions(const Elements &elements) : elements_(elements) {}

    // Compute the sums of an element's affine functions. `local`: number of local coordinates that these use, -1 for as
    // many as are more than rounding; return this number.
    int describe(i64 element, int local, AffineSums &sums);

    // Make the first `count` functions of an element, at most its points, `affine` of them affine. Missing functions
    // are zero.
    void make(i64 element, i64 affine, i64 count);

    // Memory for elements of at most `points` points and `functions` functions [bytes].
    static u64 bytes(i64 points, i64 functions) {
        constexpr i64 coordinates = 9;  // per point: grid coordinates, local ones, and factors of polynomials
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
    std::array<i64, polynomial_count> made_;   // function that each polynomial has become, -1 for none
    i64 points_ = 0;
};

}  // namespace pdeanim
