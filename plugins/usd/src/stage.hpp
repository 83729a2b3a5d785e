// Writes the prims of a clip into the data of a layer.
#pragma once

#include "layer_data.hpp"

namespace pdeanim_usd {

// Return the content of a layer, its metadata alone if asked.
TfRefPtr<LayerData> layer_data_of(std::shared_ptr<const Evaluator> evaluator, bool metadata_only);

}  // namespace pdeanim_usd
