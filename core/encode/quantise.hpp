// Encoder steps before coding: displacements, quantised coefficients, residuals.
#pragma once

#include <span>
#include <vector>

#include "base/arithmetic.hpp"
#include "base/arrays.hpp"
#include "sections/residuals/residuals.hpp"

namespace pdeanim {

// Subtract one shape from positions; functions of time and space are fitted to the rest.
//
// Write, for each vertex, its displacements: x, y, z of one frame after another. points: (frames, vertices, 3); shape:
// (vertices, 3); rows: (vertices, 3 frames). Displacements larger than `farthest` are not motion to be fitted, and
// become 0. Return the largest remaining magnitude.
template <class Real> double take_displacements(std::span<const float> points, std::span<const double> shape,
                                                double farthest, std::span<Real> rows, int threads);

// Dead zone of the quantiser of coefficients, wider among zeros.
struct DeadZone {
    double round_up_at;        // numbers beyond a whole one by more than this (in steps) are rounded up
    double round_up_alone_at;  // the same bound for a coefficient whose neighbours are all zero
};

struct Quantised {
    LargeArray<i64> coefficients;
    std::vector<i64> largest;  // magnitude in each channel
};

// Quantise coefficients in steps, rows of `channels` each. Neighbours are the rows before and after, and the functions
// of time before and after, which are `axes` channels away. Of float or double.
template <class Real> Quantised quantise_sparsely(std::span<const Real> values, i64 channels, int axes, double step,
                                                  const DeadZone &zone, int threads);

// Return residuals of the vertices that some decoder might place beyond the bound, and raw vertices where a rounded
// residual would not keep it.
//
// points, base: (frames, vertices), the input, and the model's positions before they are rounded to float32. order: the
// vertex at each place, each once. margins: per frame, how far from `base` another decoder's coordinates may be before
// it rounds them. bound: largest Euclidean distance. step: see pdecodec/codec/sections/residuals.py.
Residuals quantise_residuals(std::span<const Position> points, std::span<const std::array<double, 3>> base,
                             std::span<const i32> order, std::span<const double> margins, double bound, double step);

// Join residuals of consecutive runs of frames.
Residuals join_residuals(std::span<const Residuals *const> parts);

template <class T> void append(std::vector<T> &all, const std::vector<T> &more) {
    all.insert(all.end(), more.begin(), more.end());
}

}  // namespace pdeanim
