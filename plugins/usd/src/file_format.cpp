// The file format plug-in: `.pdeanim` files as layers of OpenUSD.
#include <cmath>
#include <cstdlib>

#include "stage.hpp"

using namespace PXR_NS;

TF_DEFINE_ENV_SETTING(PDEANIM_USD_CACHE, 512,
                      "Size of each layer's cache of decoded motion, unless it has the argument 'cache' [MiB]");

namespace {

using namespace pdeanim_usd;

// Part of the cache for evaluated values; the rest is for decoded groups of frames.
constexpr double share_of_values = 0.125;

// Return the number that an argument of the layer gives, or another if it does not.
double number_argument(const SdfFileFormat::FileFormatArguments &arguments, const std::string &name, double otherwise) {
    const auto found = arguments.find(name);
    if (found == arguments.end()) return otherwise;
    char *end;
    const double number = std::strtod(found->second.c_str(), &end);
    if (found->second.empty() || *end || !(number > 0) || !std::isfinite(number)) {
        throw Failure("the argument '" + name + "' must be a positive number, not '" + found->second + "'");
    }
    return number;
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
            const double fps = number_argument(arguments, "fps", 0);
            const double cache = number_argument(arguments, "cache", TfGetEnvSetting(PDEANIM_USD_CACHE)) * (1 << 20);
            const auto of_values = static_cast<std::size_t>(cache * share_of_values);
            const auto memory = static_cast<std::size_t>(number_argument(arguments, "memory", 0) * (1 << 20));
            const auto clip = std::make_shared<Clip>(path, memory, static_cast<std::size_t>(cache) - of_values);
            const auto evaluator = std::make_shared<Evaluator>(clip, fps, of_values);
            SdfAbstractDataRefPtr data = layer_data_of(evaluator, metadata_only);
            _SetLayerData(layer, data);
            return true;
        } catch (const std::exception &error) {
            TF_RUNTIME_ERROR("%s: %s", path.c_str(), error.what());
            return false;
        }
    }
};

TF_REGISTRY_FUNCTION(TfType) { SDF_DEFINE_FILE_FORMAT(PdeanimFileFormat, SdfFileFormat); }
