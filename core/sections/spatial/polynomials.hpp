// Polynomials of an element's local coordinates, in the order in which functions are made of them.
//
// The affine four, 1, x, y and z, come first, then the others by degree. A factor of the third coordinate counts twice:
// across a surface there is less to describe than along it. Of equal degrees, higher powers of the first coordinate come
// first, then of the second.
#pragma once

#include <array>

#include "base/arithmetic.hpp"

namespace pdeanim {

constexpr int affine_count = 4;
constexpr int largest_degree = 10;  // what comes after it is left to unit vectors
constexpr int normal_degree = 2;    // of a factor of the third coordinate

// How a polynomial is made of those before it.
struct Polynomial {
    std::array<int, 3> exponents{};
    std::array<int, 3> lower = {-1, -1, -1};  // the polynomial of a degree less along each axis, -1 for none
    int along = -1;                           // the first of these axes: it is that polynomial times this coordinate

    constexpr int degree() const { return exponents[0] + exponents[1] + normal_degree * exponents[2]; }
};

constexpr int polynomial_count = [] {
    int count = 0;
    for (int a = 0; a <= largest_degree; ++a) {
        for (int b = 0; a + b <= largest_degree; ++b) count += (largest_degree - a - b) / normal_degree + 1;
    }
    return count;
}();

inline constexpr std::array<Polynomial, polynomial_count> polynomials = [] {
    std::array<Polynomial, polynomial_count> found{};
    for (int axis = 0; axis < 3; ++axis) found[1 + axis].exponents[axis] = 1;
    int count = affine_count;
    for (int degree = 2; degree <= largest_degree; ++degree) {
        for (int a = degree; a >= 0; --a) {
            for (int b = degree - a; b >= 0; --b) {
                const int left = degree - a - b;
                const bool is_affine = a + b == 0 && left == normal_degree;
                if (left % normal_degree == 0 && !is_affine) found[count++].exponents = {a, b, left / normal_degree};
            }
        }
    }
    // By their exponents; looking for them would take longer than compilers evaluate at compile time.
    std::array<std::array<std::array<int, largest_degree + 1>, largest_degree + 1>, largest_degree + 1> numbers{};
    for (int j = 0; j < polynomial_count; ++j) {
        const auto &[a, b, c] = found[j].exponents;
        numbers[a][b][c] = j;
    }
    for (Polynomial &own : found) {
        for (int axis = 2; axis >= 0; --axis) {
            if (own.exponents[axis] == 0) continue;
            std::array<int, 3> wanted = own.exponents;
            --wanted[axis];
            own.lower[axis] = numbers[wanted[0]][wanted[1]][wanted[2]];
            own.along = axis;
        }
    }
    return found;
}();

}  // namespace pdeanim
