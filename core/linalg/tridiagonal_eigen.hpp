// Eigenvalues and eigenvectors of a symmetric matrix with three diagonals.
#pragma once

#include <vector>

#include "base/arithmetic.hpp"

namespace pdeanim {

constexpr i64 worth_threads = 160;  // rows from which on several threads are faster than one

// Eigenvalues, in no order, in the place of the diagonal; `beside` has a zero at its end, and is used up. Numbers are about
// one at most.
void tridiagonal_values(std::vector<double> &diagonal, std::vector<double> &beside);

// The same with eigenvectors, a row each: (size x size).
std::vector<double> tridiagonal_eigen(std::vector<double> &diagonal, std::vector<double> &beside, int threads);

}  // namespace pdeanim
