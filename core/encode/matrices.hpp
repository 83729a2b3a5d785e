// Linear algebra that only the encoder needs: products of matrices on several threads, QR decomposition, eigenproblems.
#pragma once

#include <vector>

#include "base/arithmetic.hpp"
#include "linalg/products.hpp"

namespace pdeanim {

// out = left * right, with contiguous rows of `right` and of `out`.
void multiply(double *out, const Strided<double> &left, const double *right, const ProductSizes &sizes, int threads);

// out = rows * factors on each axis, in the precision of the rows. out (rows x columns x axes), rows (rows x depth x
// axes), factors (depth x columns).
template <class Real> void multiply_rows(Real *out, const Real *rows, const double *factors, const ProductSizes &sizes,
                                         i64 axes, int threads);

// out (columns x columns) = rows^T * rows, summed block by block in the given precision.
template <class Real, class Row>
void sums_of_squares(double *out, const Row *rows, i64 count, i64 columns, int threads);

// out (columns x other_columns) = rows^T * others, summed block by block in their precision.
template <class Real> void sums_of_products(double *out, const Real *rows, const Real *others, i64 count, i64 columns,
                                            i64 other_columns, int threads);

// QR decomposition of a matrix A (rows x columns) with at least as many rows as columns: A = Q R. The columns of Q are
// orthonormal even if those of A are linearly dependent.
struct OrthonormalColumns {
    std::vector<double> vectors;   // Q^T, columns x rows
    std::vector<double> triangle;  // R, columns x columns, upper triangular
};

OrthonormalColumns orthonormal_columns(const double *matrix, i64 rows, i64 columns);

struct Eigen {
    std::vector<double> values;   // decreasing
    std::vector<double> vectors;  // one per row, of unit length; empty if not requested
};

// Return the eigenvalues and, if requested, the eigenvectors of a symmetric matrix (size x size) of finite numbers.
// Only its diagonal and the part below are read.
Eigen symmetric_eigen(const double *matrix, i64 size, bool with_vectors, int threads);

// The eigenproblem of a diagonal matrix that is changed by one vector, diag(d) + weight z z^T.
//
// d increases, z has no zeros, and the weight is positive. Then each eigenvalue lies between two neighbouring d, or
// beyond the last one. It is stored as its distance from one of these two, so its distance from any d is exact to the
// last digits.
class Secular {
public:
    Secular(std::vector<double> d, std::vector<double> z, double weight, int threads);

    i64 count() const { return count_; }
    double value(i64 i) const { return d_[origins_[i]] + offsets_[i]; }

    // Write eigenvector i, of unit length, in another order: number j belongs to d[order[j]]. at: d in that order;
    // weights: z() in that order.
    void vector(double *out, i64 i, const double *at, const double *weights) const;

    // Return the z for which the computed eigenvalues are exact: eigenvectors made with it are orthogonal.
    const std::vector<double> &z() const { return exact_z_; }

private:
    i64 count_;
    double weight_;
    std::vector<double> d_, z_, exact_z_;
    std::vector<i64> origins_;
    std::vector<double> offsets_;
};

}  // namespace pdeanim
