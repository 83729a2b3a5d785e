#include "linalg/symmetric_eigen.hpp"

#include <algorithm>
#include <numeric>

#include "linalg/scale.hpp"
#include "linalg/tridiagonal.hpp"
#include "linalg/tridiagonal_eigen.hpp"

namespace pdeanim {

Eigen symmetric_eigen(const double *matrix, i64 size, bool with_vectors, int threads) {
    const double scale = scale_of(matrix, size * size), down = 1.0 / scale;
    std::vector<double> scaled(matrix, matrix + size * size);
    for (double &number : scaled) number *= down;
    Tridiagonal reduced(scaled.data(), size);
    std::vector<double> vectors;
    if (with_vectors) {
        vectors = tridiagonal_eigen(reduced.diagonal, reduced.beside, threads);
    } else {
        tridiagonal_values(reduced.diagonal, reduced.beside);
    }
    std::vector<i64> order(size);
    std::iota(order.begin(), order.end(), i64{0});
    const std::vector<double> &values = reduced.diagonal;
    std::stable_sort(order.begin(), order.end(), [&](i64 a, i64 b) { return values[a] > values[b]; });
    Eigen found{std::vector<double>(size), std::vector<double>(vectors.size())};
    for (i64 i = 0; i < size; ++i) {
        found.values[i] = scale * values[order[i]];
        if (with_vectors) std::copy_n(vectors.data() + order[i] * size, size, found.vectors.data() + i * size);
    }
    if (with_vectors) reduced.turn_back(found.vectors.data(), size, size, size < worth_threads ? 1 : threads);
    return found;
}

}  // namespace pdeanim
