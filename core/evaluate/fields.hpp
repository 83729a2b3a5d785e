// Evaluation of X(v, t) = R(v) + sum_a psi_a(t) G_a(v): R is the reference frame, psi_a are the functions of time of a
// group of frames, and the fields G_a are what each is multiplied with at each vertex.
//
// Every coordinate is one sum over the functions of time, in order, so that its bits depend neither on which other
// times are asked for nor on the number of threads.
#pragma once

#include <span>

#include "arithmetic.hpp"

namespace pdeanim {

// Frames that should be evaluated together: for so many a run of vertices' fields are used before the next run's are
// read, while the positions of so many frames stay in a second-level cache.
constexpr i64 frames_at_once = 8;

template <class T> struct Fields {
    std::span<const T> values;  // (functions, axes, vertices)
    i64 functions = 0;
    i64 axes = 0;  // 3, or 1 where all axes share a value
    i64 vertices = 0;

    const T *row(i64 function, i64 axis) const {
        return values.data() + (function * axes + (axes == 3 ? axis : 0)) * vertices;
    }
};

// Positions at frames, before residuals: sums in the precision of the fields, to which the reference frame is added in
// double. time: (frames, 3, functions); reference: (vertices, 3); out: (frames, vertices, 3), written. Overloads, not a
// template: compilers make no variants of those.
void evaluate_frames(std::span<const float> time, const Fields<float> &fields, std::span<const double> reference,
                     std::span<float> out);
void evaluate_frames(std::span<const float> time, const Fields<float> &fields, std::span<const double> reference,
                     std::span<double> out);
void evaluate_frames(std::span<const double> time, const Fields<double> &fields, std::span<const double> reference,
                     std::span<float> out);
void evaluate_frames(std::span<const double> time, const Fields<double> &fields, std::span<const double> reference,
                     std::span<double> out);

// Add what the fields give at one time. weights: (3, functions), what each counts; moved: (vertices, 3), added to.
void add_displacement(std::span<const double> weights, const Fields<float> &fields, std::span<double> moved);
void add_displacement(std::span<const double> weights, const Fields<double> &fields, std::span<double> moved);

}  // namespace pdeanim
