// The file format plug-in: `.pdeanim` files as layers of OpenUSD.
#include <cmath>

#include "scene.hpp"
#include "stage.hpp"
#include "text.hpp"

using namespace PXR_NS;

TF_DEFINE_ENV_SETTING(PDEANIM_USD_CACHE, 512,
                      "Size of each layer's cache of decoded motion, unless it has the argument 'cache' [MiB]");

namespace {

using namespace pdeanim_usd;

// Part of the cache for evaluated values, as a divisor; the rest is for decoded groups of frames.
constexpr std::size_t share_of_values = 8;

constexpr double bytes_per_mib = 1 << 20, most_mib = 1 << 30, most_fps = 1e9;

// Return the number that an argument of the layer gives, or another if it does not.
double number_argument(const SdfFileFormat::FileFormatArguments &arguments, const std::string &name, double otherwise,
                       double most) {
    const auto found = arguments.find(name);
    if (found == arguments.end()) return otherwise;
    const double number = number_of(found->second).value_or(0);
    if (number >= 1 / most && number <= most) return number;
    throw Failure(TfStringPrintf("the argument '%s' must be a number from %g to %g, not '%s'", name.c_str(), 1 / most,
                                 most, found->second.c_str()));
}

std::size_t bytes_argument(const SdfFileFormat::FileFormatArguments &arguments, const std::string &name,
                           double otherwise) {
    return static_cast<std::size_t>(std::ceil(number_argument(arguments, name, otherwise, most_mib) * bytes_per_mib));
}

}  // namespace

class PdeanimFileFormat : public SdfFileFormat {
public:
    PdeanimFileFormat() : SdfFileFormat(TfToken("pdeanim"), TfToken("1.0"), TfToken("usd"), "pdeanim") {}

    bool CanRead(const std::string &path) const override {
        try {
            Clip(path, 0, 0);
            return true;
        } catch (const Failure &) {
            return false;
        }
    }

    bool Read(SdfLayer *layer, const std::string &path, bool metadata_only) const override {
        try {
            const FileFormatArguments &arguments = layer->GetFileFormatArguments();
            const double fps = number_argument(arguments, "fps", 0, most_fps);
            const auto cache = bytes_argument(arguments, "cache", std::max(TfGetEnvSetting(PDEANIM_USD_CACHE), 1));
            const auto of_values = cache / share_of_values;
            const auto clip = std::make_shared<Clip>(path, bytes_argument(arguments, "memory", 0), cache - of_values);
            if (const auto name = arguments.find(layer_argument); name != arguments.end()) {
                const auto carrier = clip->carrier();
                if (!carrier || !carrier->is_usd())
                    throw Failure("the file has no scene of USD with a layer of this name");
                show(layer, TfCreateRefPtr(new SdfData), *open_scene_layer(*clip, *carrier, name->second, arguments));
            } else if (!shows_scene(arguments) || !show_scene(layer, clip, fps, of_values, arguments)) {
                const auto evaluator = std::make_shared<const Evaluator>(clip, fps, of_values);
                SdfAbstractDataRefPtr data = layer_data_of(evaluator, metadata_only);
                _SetLayerData(layer, data);
            }
            return true;
        } catch (const std::exception &error) {
            TF_RUNTIME_ERROR("%s: %s", path.c_str(), error.what());
            return false;
        }
    }

private:
    static bool shows_scene(const FileFormatArguments &arguments) {
        const auto found = arguments.find("scene");
        if (found == arguments.end() || found->second == "keep") return true;
        if (found->second == "drop") return false;
        throw Failure("the argument 'scene' must be keep or drop, not '" + found->second + "'");
    }

    // Show the file's scene, if it has one of USD; warn and return false if the motion does not fit it.
    static bool show_scene(SdfLayer *layer, const std::shared_ptr<const Clip> &clip, double fps, std::size_t max_kept,
                           const FileFormatArguments &arguments) {
        try {
            const auto carrier = clip->carrier();
            if (!carrier || !carrier->is_usd()) return false;
#ifdef PDEANIM_USD_NO_SCENES
            throw Failure("the plug-in is built without the headers of Pcp");
#else
            const SceneLayer scene = scene_layer_of(clip, *carrier, fps, max_kept, arguments);
            const auto data = TfCreateRefPtr(new LayerData(scene.evaluator));
            show(layer, data, *scene.layer);
            for (const auto &[path, series] : scene.series) data->add_series(path, series);
            return true;
#endif
        } catch (const std::exception &error) {
            TF_WARN("%s: the meshes are shown without the scene around them: %s", clip->path().c_str(), error.what());
            return false;
        }
    }

    // Show what another layer holds.
    static void show(SdfLayer *layer, const SdfDataRefPtr &data, const SdfLayer &from) {
        data->CopyFrom(_GetLayerData(from));
        SdfAbstractDataRefPtr shown = data;
        _SetLayerData(layer, shown);
    }
};

TF_REGISTRY_FUNCTION(TfType) { SDF_DEFINE_FILE_FORMAT(PdeanimFileFormat, SdfFileFormat); }
