// Elements, patches of a mesh or pieces of its curves, and the orthonormal functions on each.
//
// The affine four, 1, x, y and z, come first, then polynomials of local coordinates by degree, or the functions of Eqs. 14
// and 16 along a piece, then unit vectors. How many of them there are is in the file (`SpaceLayout`).
//
// A polynomial is made of one that is orthonormal already, times a coordinate (Brubeck, Nakatsukasa and Trefethen 2021,
// "Vandermonde with Arnoldi"): little of it cancels then, where powers of coordinates are nearly dependent.
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

// Orthonormal functions on the points of an element, made some at a time.
//
// Gram-Schmidt, a second time where the first cancels, which is as orthogonal as rounding allows (Giraud, Langou and
// Rozloznik 2005, "The loss of orthogonality in the Gram-Schmidt orthogonalization process"); where products with the first
// functions are known to be nothing but rounding, and not computed, that rounding grows along with the degree, to 1e-8 at
// worst. The functions are floating-point numbers that no decision hangs on but one, whether a column is dropped, and the
// encoder keeps clear of it (`nearest`).
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

// Local coordinates of an element: about its mean, along its principal axes, the widest first.
//
// They are found by one-sided Jacobi rotations in integers, so that everyone finds the same. Coordinates that are hardly
// correlated are left as they are: axes of equal width have no direction of their own, and where rounding chose one, every
// element would have another.
struct LocalCoordinates {
    // Find those of these vertices; how many of the coordinates, from the first, are more than rounding.
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
    std::span<const GridPoint> grid;        // the caller's
    std::array<double, sort_count> shares;  // of a column's squared norm that must be new for it to be kept
    std::vector<double> series;             // of pieces: their functions at each vertex in order, not orthonormal yet
};

// Sums of an element's affine functions times 1, x, y and z about its first vertex.
using AffineSums = std::array<std::array<double, affine_count>, affine_count>;

// Makes the functions of one element after another.
class ElementFunctions {
public:
    explicit ElementFunctions(const Elements &elements) : elements_(elements) {}

    // Sums of an element's affine functions. `local`: how many local coordinates these take, -1 for as many as are more than
    // rounding; returns how many.
    int describe(i64 element, int local, AffineSums &sums);

    // The first functions of an element, at most its points, of which so many are affine. Those that are still missing are
    // zero.
    void make(i64 element, i64 affine, i64 count);

    // Memory that it takes for elements of so many points and functions at most.
    static u64 bytes(i64 points, i64 functions) {
        constexpr i64 coordinates = 9;  // of a point: on the grid, local ones, and these as they are multiplied
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
    std::array<std::vector<double>, 3> axes_;  // the same coordinates
    std::array<i64, polynomial_count> made_;   // which function each polynomial has become, -1 for none
    i64 points_ = 0;
};

}  // namespace pdeanim
