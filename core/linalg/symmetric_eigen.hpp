// Eigenvalues and eigenvectors of a symmetric matrix.
#pragma once

#include <vector>

#include "base/arithmetic.hpp"

namespace pdeanim {

struct Eigen {
    std::vector<double> values;   // falling
    std::vector<double> vectors;  // a row each, of unit length; none where they were not asked for
};

// Of a matrix (size x size) of finite numbers; what is below its diagonal counts.
Eigen symmetric_eigen(const double *matrix, i64 size, bool with_vectors, int threads);

}  // namespace pdeanim
