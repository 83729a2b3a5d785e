// What moves the vertices in a group of frames, in the precision of its sums.
#pragma once

#include <variant>

#include "decode/evaluate/motion.hpp"

namespace pdeanim::bindings {

struct PyMotion {
    std::variant<Motion<float>, Motion<double>> motion;
};

}  // namespace pdeanim::bindings
