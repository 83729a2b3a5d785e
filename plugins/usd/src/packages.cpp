// Files of a scene by names like `walk.pdeanim[textures/wood.png]`: programs open textures and layers by them.
#include <cstring>

#include "clip.hpp"

using namespace PXR_NS;

class PdeanimPackageResolver : public ArPackageResolver {
public:
    std::string Resolve(const std::string &package, const std::string &name) override {
        try {
            const auto carrier = carrier_of(package);
            return carrier && carrier->has(name) ? name : "";
        } catch (const std::exception &) {
            return "";
        }
    }

    std::shared_ptr<ArAsset> OpenAsset(const std::string &package, const std::string &name) override {
        try {
            const auto carrier = carrier_of(package);
            if (!carrier || !carrier->has(name)) return nullptr;
            const auto content = std::make_shared<const std::string>(carrier->content(name));
            return ArInMemoryAsset::FromBuffer(std::shared_ptr<const char>(content, content->data()), content->size());
        } catch (const std::exception &error) {
            TF_RUNTIME_ERROR("%s: %s", package.c_str(), error.what());
            return nullptr;
        }
    }

    void BeginCacheScope(VtValue *) override {}
    void EndCacheScope(VtValue *) override {}

private:
    static std::shared_ptr<const pdeanim_usd::Carrier> carrier_of(const std::string &package) {
        return pdeanim_usd::Clip(package, 0, 0).carrier();
    }
};

AR_DEFINE_PACKAGE_RESOLVER(PdeanimPackageResolver, ArPackageResolver)
