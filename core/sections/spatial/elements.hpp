// Elements, patches of a mesh or pieces of its curves, and the orthonormal functions on each.
//
// The affine four, 1, x, y and z, come first, then polynomials of local coordinates by degree, or the functions of Eqs. 14
// and 16 along a piece, then unit vectors. How many of them there are is in the file (`SpaceLayout`).
//
// A polynomial is made of one that is orthonormal already, times a coordinate (Brubeck, Nakatsukasa and Trefethen 2021,
// "Vandermonde with Arnoldi"): little of it cancels then, where powers of coordinates are nearly dependent.
#pragma once

#include <array>
#include <memory>
#include <span>
#include <vector>

#include "mesh/bisection.hpp"
#include "mesh/z_order.hpp"
#include "sections/spatial/orthonormal.hpp"
#include "sections/spatial/space_layout.hpp"

namespace pdeanim {

// The largest integer whose square is at most `square`, 0 to 2^62.
i64 integer_root(i64 square);

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
