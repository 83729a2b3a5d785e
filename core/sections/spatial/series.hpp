// The functions that solve w^(n) = rate^n w, n = 4 or 8, in a form that stays well conditioned.
//
//     phi_j(x) = sum over k of  rate^(n k) x^(n k + j) / (n k + j)!,     j = 0 .. n - 1
#pragma once

#include <span>
#include <vector>

#include "mesh/z_order.hpp"

namespace pdeanim {

constexpr int space_functions = 8;  // functions along a curve (Eqs. 14 and 16)

// Return phi_0 to phi_(order - 1) at each point, row after row, for |rate * x| at most 12 and order 4 or 8.
//
// The power series uses only additions, products and quotients, so every machine gets the same bits. All terms of one
// function have the same sign, so nothing cancels.
std::vector<double> series_functions(std::span<const double> points, double rate, int order);

// Return the parameter u in [-1, 1] along each piece, by the arc length of the reference frame. If all points of a
// piece coincide, u is by index; for a piece of one point it is 0. Pieces follow each other in `order`, each beginning
// at one of `starts`.
std::vector<double> arc_length_parameters(std::span<const GridPoint> grid, std::span<const i32> order,
                                          std::span<const i64> starts);

}  // namespace pdeanim
