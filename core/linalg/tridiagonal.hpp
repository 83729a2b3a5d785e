// A symmetric matrix as one with three diagonals, by reflections, and vectors of the one as those of the other.
#pragma once

#include <vector>

#include "base/arithmetic.hpp"

namespace pdeanim {

class Tridiagonal {
public:
    // Of a symmetric matrix (size x size), whose largest number is about one.
    Tridiagonal(const double *matrix, i64 size);

    std::vector<double> diagonal, beside;  // `beside` has a zero at its end

    // Eigenvectors of the matrix, a row each, in the place of those of the three diagonals; rows are a stride apart.
    void turn_back(double *rows, i64 stride, i64 count, int threads) const;

private:
    i64 size_, stride_;
    std::vector<double> vectors_;  // of the reflections, v of the reflection that clears row i in row i
    std::vector<double> factors_;
};

}  // namespace pdeanim
