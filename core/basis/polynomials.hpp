// Polynomials of an element's local coordinates, in the order in which functions are made of them.
//
// The affine four, 1, x, y and z, come first, then the others by degree. A factor of the third coordinate counts twice:
// across a surface there is less to describe than along it. Of equal degrees, higher powers of the first coordinate come
// first, then of the second.
#pragma once

#include <array>

#include "arithmetic.hpp"

namespace pdeanim {

constexpr int affine_count = 4;
constexpr int largest_degree = 10;  // what comes after it is left to unit vectors
constexpr int normal_degree = 2;    // of a factor of the third coordinate

// How a polynomial is made of those before it.
struct Polynomial {
    std::array<int, 3> exponents{};
    std::array<int, 3> lower = {-1, -1, -1};  // the polynomial of a degree less along each axis, -1 for none
    int along = -1;                           // the first of these axes: it is that polynomial times this coordinate
};

constexpr int polynomial_count = [] {
    int count = 0;
    for (int a = 0; a <= largest_degree; ++a) {
        for (int b = 0; a + b <= largest_degree; ++b) count += (largest_degree - a - b) / normal_degree + 1;
    }
    return count;
}();

extern const std::array<Polynomial, polynomial_count> polynomials;

}  // namespace pdeanim
