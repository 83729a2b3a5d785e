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
#include <vector>

#include "mesh/bisection.hpp"
#include "sections/spatial/local_coordinates.hpp"
#include "sections/spatial/orthonormal.hpp"
#include "sections/spatial/polynomials.hpp"
#include "sections/spatial/space_form.hpp"

namespace pdeanim {

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
