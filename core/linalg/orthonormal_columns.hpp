// Orthonormal vectors that span given ones (QR decomposition).
#pragma once

#include <vector>

#include "base/arithmetic.hpp"

namespace pdeanim {

// Of a matrix A (rows x columns), as many rows as columns or more, A = Q R with orthonormal columns of Q; these are
// orthonormal where those of A depend on each other, too.
struct OrthonormalColumns {
    std::vector<double> vectors;   // Q^T, columns x rows
    std::vector<double> triangle;  // R, columns x columns, upper
};

OrthonormalColumns orthonormal_columns(const double *matrix, i64 rows, i64 columns);

}  // namespace pdeanim
