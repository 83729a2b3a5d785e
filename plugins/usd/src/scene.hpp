// The scene around the motion as a layer: what `pdecodec decode` writes, with values that are evaluated when asked for.
#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "evaluator.hpp"

namespace pdeanim_usd {

// Argument of a layer that names another layer of the scene than the root.
inline const std::string layer_argument = "layer";

// A layer of a scene, and its attributes that vary.
struct SceneLayer {
    SdfLayerRefPtr layer;  // anonymous
    std::shared_ptr<const Evaluator> evaluator;
    std::vector<std::pair<SdfPath, Series>> series;
};

// Return a layer of a scene by its path, with the arrays that the clip holds. References to files of the scene name these in
// the clip's file; `arguments` are those of the clip's own layer. Raise Failure if it is damaged.
SdfLayerRefPtr open_scene_layer(const Clip &clip, const Carrier &carrier, const std::string &name,
                                SdfFileFormat::FileFormatArguments arguments);

// Change the name of a file in the sublayers, references and payloads of a layer; an empty name removes them.
void rename_dependency(const SdfLayerRefPtr &layer, const std::string &name, const std::string &other);

// Return the root layer of a scene with the clip's motion. `fps` and `max_kept` are those of an Evaluator. Raise Failure if the
// motion does not fit the scene.
SceneLayer scene_layer_of(std::shared_ptr<const Clip> clip, const Carrier &carrier, double fps, std::size_t max_kept,
                          const SdfFileFormat::FileFormatArguments &arguments);

}  // namespace pdeanim_usd
