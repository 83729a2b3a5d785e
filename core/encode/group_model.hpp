// Compare a group of frames, as its motion gives it, with the input: residuals, excess beyond the bound, errors.
// Positions are evaluated a few frames at a time and never stored.
#pragma once

#include <span>
#include <vector>

#include "decode/evaluate/motion.hpp"
#include "sections/residuals/residuals.hpp"

namespace pdeanim {

template <class Real> struct GroupModel {
    const Motion<Real> &motion;
    std::span<const double> time;  // (frames, time axes, functions)
    const AnchoredReference<Real> &reference;
    i64 frames;
};

// The input positions to compare with.
struct Wanted {
    std::span<const Position> points;  // (frames, vertices)
    std::span<const i32> order;        // the vertex at each place
    double bound, step;                // largest distance; size of a residual's step
};

// How far vertices are off beyond the target.
struct Excess {
    std::vector<i32> frames, vertices;
    std::vector<Position> excess;

    // Add `push` times the excess, as coefficients of functions of time, to values on vertices. functions: (frames, 3,
    // functions) and values (vertices, functions) on one axis; (frames, functions) and (vertices, functions, 3) on
    // three.
    template <class Real>
    void add_to(std::span<Real> values, std::span<const double> functions, i64 count, int axes, double push) const;
};

// Move vertices that are off by more than `most` bounds to that distance, by at most `farthest` bounds.
struct Aim {
    double most, farthest;
};

struct Errors {
    double largest_square = 0.0, sum_of_squares = 0.0;
};

// Return residuals. margins: of each frame, see `quantise_residuals`. If given, `excess` and the errors of the float32
// positions that a decoder returns with the residuals are added to.
template <class Real> Residuals missing(const GroupModel<Real> &model, const Wanted &wanted,
                                        std::span<const double> margins, const Aim &aim, Excess *excess, Errors *errors,
                                        int threads);

// Return the largest difference, in a coordinate, between two ways to add up the same sums.
template <class One, class Other>
double farthest_apart(const GroupModel<One> &one, const GroupModel<Other> &other, int threads);

}  // namespace pdeanim
