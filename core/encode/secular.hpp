// The eigenproblem of a diagonal matrix that is changed by one vector, diag(d) + weight z z^T.
#pragma once

#include <vector>

#include "base/arithmetic.hpp"

namespace pdeanim {

// Of d that rise, z without zeros, and a positive weight: each eigenvalue lies between two of d, or beyond the last one.
// What is kept is how far it is from one of those two, so that its distance from any of d is known to the last digits.
class Secular {
public:
    Secular(std::vector<double> d, std::vector<double> z, double weight, int threads);

    i64 count() const { return count_; }
    double value(i64 i) const { return d_[origins_[i]] + offsets_[i]; }

    // Eigenvector i of unit length, its numbers in another order: number j is that of d[order[j]]. `at` has d in that order,
    // and `weights` z() in it.
    void vector(double *out, i64 i, const double *at, const double *weights) const;

    // The z that makes the eigenvalues found exact: eigenvectors made with it are orthogonal.
    const std::vector<double> &z() const { return exact_z_; }

private:
    i64 count_;
    double weight_;
    std::vector<double> d_, z_, exact_z_;
    std::vector<i64> origins_;
    std::vector<double> offsets_;
};

}  // namespace pdeanim
