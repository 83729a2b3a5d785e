// Section MODL: what the space basis of a file is built from.
#pragma once

#include <span>
#include <vector>

#include "base/errors.hpp"
#include "sections/spatial/space_layout.hpp"

namespace pdeanim {

struct Model {
    SpaceForm form;
    double residual_step = 0.0;  // quantisation step of residuals [scene units]
    std::vector<u8> layout;      // of its functions, coded (`SpaceLayout`)

    // Read section MODL; CorruptError where a field is out of range.
    static Model of_bytes(std::span<const u8> data);
};

}  // namespace pdeanim
