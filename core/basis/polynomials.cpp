#include "basis/polynomials.hpp"

namespace pdeanim {

constexpr std::array<Polynomial, polynomial_count> polynomials = [] {
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
    for (Polynomial &own : found) {
        for (int axis = 2; axis >= 0; --axis) {
            if (own.exponents[axis] == 0) continue;
            std::array<int, 3> wanted = own.exponents;
            --wanted[axis];
            for (int j = 0; j < polynomial_count; ++j) {
                if (found[j].exponents == wanted) own.lower[axis] = j;
            }
            own.along = axis;
        }
    }
    return found;
}();

}  // namespace pdeanim
