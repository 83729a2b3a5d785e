// Metadata of a layer: time codes, up axis, unit, and the texts that USD has no place for.
#pragma once

#include "evaluator.hpp"

namespace pdeanim_usd {

// Return the fields of the layer's pseudo-root, but for the default prim.
std::vector<std::pair<TfToken, VtValue>> layer_fields(const Evaluator &evaluator);

}  // namespace pdeanim_usd
