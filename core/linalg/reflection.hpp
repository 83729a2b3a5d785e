// Householder reflections, I - factor v v^T.
#pragma once

#include <cmath>

#include "linalg/scale.hpp"
#include "linalg/vectors.hpp"

namespace pdeanim {

struct Reflection {
    double factor, image;  // what v v^T is multiplied by, and the one number of what is reflected that is not zero
};

// Of a row, whole eights long, the reflection that leaves it only the number at a place; the row becomes v. A row of zeros,
// or next to them, is left as it is: its factor is 0. Numbers are about one at most.
template <int bytes> PDEANIM_INLINE Reflection reflection_of(double *row, i64 count, i64 place) {
    const double length = std::sqrt(dot<bytes>(row, row, count));
    if (!(length > no_length)) return {0.0, 0.0};
    const double shorter = 1.0 / length;
    for (i64 i = 0; i < count; i += abreast) (shorter * Eight<bytes>::at(row + i)).put(row + i);
    const double pivot = row[place], sign = pivot < 0.0 ? -1.0 : 1.0;
    row[place] = pivot + sign;
    return {1.0 / (1.0 + std::abs(pivot)), -sign * length};
}

}  // namespace pdeanim
