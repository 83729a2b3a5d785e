// Steps of the encoder before entropy coding: displacements, quantised coefficients, residuals.
#pragma once

#include <span>
#include <vector>

#include "base/arithmetic.hpp"
#include "base/arrays.hpp"
#include "sections/residuals/residuals.hpp"

namespace pdeanim {

// Subtract a shape from the positions of all frames; functions of time and space are fitted to these displacements.
//
// The result has one row per vertex: x, y, z of one frame after another. Displacements larger than `farthest` are not
// motion to be fitted, and become 0. Return the largest magnitude written. points: (frames, vertices, 3); shape:
// (vertices, 3); rows: (vertices, 3 frames).
template <class Real> double take_displacements(std::span<const float> points, std::span<const double> shape,
                                                double farthest, std::span<Real> rows, int threads);

// Dead zone of the quantiser of coefficients, which is wider if all neighbours are zero.
struct DeadZone {
    double round_up_at;        // fraction of a step beyond a whole number from which a coefficient is rounded up
    double round_up_alone_at;  // magnitude [steps] below which it becomes zero if its neighbours are all zero
};

struct Quantised {
    LargeArray<i64> coefficients;
    std::vector<i64> largest;  // largest magnitude in each channel
};

// Quantise rows of `channels` coefficients, float or double. The neighbours of a coefficient are those in the rows
// before and after, and those of the functions of time before and after, which are `axes` channels away.
template <class Real> Quantised quantise_sparsely(std::span<const Real> values, i64 channels, int axes, double step,
                                                  const DeadZone &zone, int threads);

// Return residuals for the vertices that some decoder might place beyond the bound, and raw vertices where a rounded
// residual would not keep the bound.
//
// points, base: (frames, vertices), the input, and the model's positions before they are rounded to float32. order: the
// vertex at each position of the element order. margins: for each frame, the largest difference between another
// decoder's coordinates and `base`, before rounding. bound: largest Euclidean distance. step: see
// pdecodec/codec/sections/residuals.py.
Residuals quantise_residuals(std::span<const Position> points, std::span<const std::array<double, 3>> base,
                             std::span<const i32> order, std::span<const double> margins, double bound, double step);

// Join the residuals of consecutive frames into one object.
Residuals join_residuals(std::span<const Residuals *const> parts);

template <class T> void append(std::vector<T> &all, const std::vector<T> &more) {
    all.insert(all.end(), more.begin(), more.end());
}

}  // namespace pdeanim
