// Prims of a scene as USD composes them: the plug-in needs no other part of USD than Pcp for it.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "carrier.hpp"
#include "placement.hpp"

namespace pdeanim_usd {

// A composed prim. It is valid as long as the composition.
class Prim {
public:
    explicit Prim(const PcpPrimIndex &index);

    const SdfPath &path() const { return path_; }

    // Return the strongest value of a field of the prim, or of one of its properties; an empty one if there is none.
    VtValue field(const TfToken &field, const std::string &property = {}) const;

    // Return a member of the custom data, by its path with colons; an empty value if there is none.
    VtValue custom(const std::string &key) const;

    // Whether its type, as the schemas of USD have it, is one or derives from it: "UsdGeomMesh".
    bool is_a(const std::string &schema) const;

    // Return the value of an attribute, without samples if it has none.
    Varying attribute(const std::string &name) const;
    bool has_value(const std::string &name) const { return !attribute(name).values.empty(); }
    bool has_targets(const std::string &relationship) const;

    // Call a function with the layer, the path there and the time offset of each spec of a property, strongest first, until it
    // returns true.
    void visit_specs(
        const std::string &property,
        const std::function<bool(const SdfLayerHandle &, const SdfPath &, const SdfLayerOffset &)> &visit) const;

private:
    const PcpPrimIndex &index_;
    SdfPath path_;
};

// A prim that may be a shape, and what it inherits.
struct ScenePrim {
    Prim prim;
    std::string name;  // of the object: names from the root
    std::shared_ptr<const Placement> placement;
    bool is_deformed;  // by joints or blend shapes
};

// The prims of a scene.
class Composition {
public:
    // Compose the stage of a layer, within the memory limit of the scene.
    Composition(const SdfLayerRefPtr &root, const Carrier &carrier);

    // Return the prims that may be shapes, in order.
    const std::vector<ScenePrim> &shapes() const { return shapes_; }

    // Whether an object is an instance, which stays as the scene has it.
    bool is_instance(const std::string &object) const;

private:
    struct Above {
        std::string name;
        std::shared_ptr<const Placement> placement;
        TfToken purpose;
        bool is_skinned = false, has_skeleton = false, has_joints = false;
    };

    void visit(const SdfPath &path, Above above);

    const Carrier &carrier_;
    std::unique_ptr<PcpCache> cache_;
    std::vector<ScenePrim> shapes_;
    std::vector<std::string> instances_;
};

}  // namespace pdeanim_usd
