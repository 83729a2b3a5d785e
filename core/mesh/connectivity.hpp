// Faces and lines of one object, owned or in arrays of the caller's.
#pragma once

#include <span>
#include <vector>

#include "base/arithmetic.hpp"

namespace pdeanim {

struct Connectivity {
    i64 vertices = 0;
    std::vector<i32> face_sizes, face_indices, line_sizes, line_indices;
};

struct ConnectivityView {
    i64 vertices;
    std::span<const i32> face_sizes, face_indices, line_sizes, line_indices;
};

}  // namespace pdeanim
