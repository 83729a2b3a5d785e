// Compares the model of a group of frames with the input: residuals, excess beyond the bound, errors. Positions are
// evaluated a few frames at a time and never stored.
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
    std::span<const i32> order;        // the vertex at each position of the element order
    double bound, step;                // largest distance allowed; step of residuals [scene units]
};

// Vertices that are off by too much, and the part of their error by which they shall move.
struct Excess {
    std::vector<i32> frames, vertices;
    std::vector<Position> excess;

    // Add `push` times the excess to the values of functions of time at the vertices: the product of the excess with
    // each function. axes 1: functions (frames, 3, functions), values (vertices, functions). axes 3: functions (frames,
    // functions), values (vertices, functions, 3).
    template <class Real>
    void add_to(std::span<Real> values, std::span<const double> functions, i64 count, int axes, double push) const;
};

// Vertices that are off by more than `most` bounds shall end up `most` bounds off, but move by at most `farthest`
// bounds.
struct Aim {
    double most, farthest;
};

struct Errors {
    double largest_square = 0.0, sum_of_squares = 0.0;
};

// Return the residuals of a group. margins: for each frame, see `quantise_residuals`. If they are not null, `excess` is
// appended to, and the errors of a decoder's float32 positions with these residuals are added to `errors`.
template <class Real> Residuals missing(const GroupModel<Real> &model, const Wanted &wanted,
                                        std::span<const double> margins, const Aim &aim, Excess *excess, Errors *errors,
                                        int threads);

// Return the largest difference of a coordinate between the same model evaluated in two precisions.
template <class One, class Other>
double farthest_apart(const GroupModel<One> &one, const GroupModel<Other> &other, int threads);

}  // namespace pdeanim
