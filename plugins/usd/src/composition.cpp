#ifndef PDEANIM_USD_NO_SCENES
#include "composition.hpp"

#include <algorithm>

#include "clip.hpp"

namespace pdeanim_usd {

namespace {

const std::string inverse_mark = "!invert!", reset_mark = "!resetXformStack!";

const TfToken spline_field("spline");

// Prims above each other, as far as recursion can bear.
constexpr std::size_t max_depth = 1000;

// Places that the opinions on a prim may come from: the time that USD takes to find them grows with their square.
constexpr std::size_t max_nodes = 1000;

// Memory that a composed prim takes, and each place where its opinions may come from: references multiply both.
constexpr std::uint64_t prim_bytes = 4096, node_bytes = 256;

bool is_block(const VtValue &value) { return value.IsHolding<SdfValueBlock>(); }

Varying samples_of(const SdfLayerHandle &layer, const SdfPath &path, const SdfLayerOffset &offset) {
    Varying found;
    for (const double code : layer->ListTimeSamplesForPath(path)) {
        VtValue value;
        if (!layer->QueryTimeSample(path, code, &value) || is_block(value)) continue;
        found.codes.push_back(offset * code);
        found.values.push_back(value);
    }
    return found;
}

// Return the steps that place a prim, and whether they start from the scene's space.
std::pair<std::vector<TransformStep>, bool> steps_of(const Prim &prim) {
    std::vector<TransformStep> steps;
    bool is_reset = false;
    const Varying order = prim.attribute("xformOpOrder");
    if (order.values.empty() || !order.values[0].IsHolding<VtTokenArray>()) return {};
    for (const TfToken &token : order.values[0].UncheckedGet<VtTokenArray>()) {
        std::string name = token.GetString();
        if (name == reset_mark) {
            steps.clear();
            is_reset = true;
            continue;
        }
        const bool is_inverse = TfStringStartsWith(name, inverse_mark);
        if (is_inverse) name = name.substr(inverse_mark.size());
        const std::vector<std::string> parts = TfStringSplit(name, ":");
        if (parts.size() < 2) throw Failure("a transform of the scene is of a kind that is not known");
        steps.push_back({parts[1], is_inverse, prim.attribute(name)});
    }
    return {std::move(steps), is_reset};
}

}  // namespace

Prim::Prim(const PcpPrimIndex &index) : index_(index), path_(index.GetPath()) {}

void Prim::visit_specs(
    const std::string &property,
    const std::function<bool(const SdfLayerHandle &, const SdfPath &, const SdfLayerOffset &)> &visit) const {
    const TfToken name(property);
    for (const PcpNodeRef &node : index_.GetNodeRange()) {
        if (!node.CanContributeSpecs()) continue;
        const SdfPath path = property.empty() ? node.GetPath() : node.GetPath().AppendProperty(name);
        const SdfLayerRefPtrVector &layers = node.GetLayerStack()->GetLayers();
        for (std::size_t i = 0; i < layers.size(); ++i) {
            if (!layers[i]->HasSpec(path)) continue;
            SdfLayerOffset offset = node.GetMapToRoot().GetTimeOffset();
            if (const SdfLayerOffset *own = node.GetLayerStack()->GetLayerOffsetForLayer(i)) offset = offset * *own;
            if (visit(layers[i], path, offset)) return;
        }
    }
}

VtValue Prim::field(const TfToken &field, const std::string &property) const {
    VtValue found;
    visit_specs(property, [&](const auto &layer, const SdfPath &path, const auto &) {
        return layer->HasField(path, field, &found);
    });
    return found;
}

VtValue Prim::custom(const std::string &key) const {
    VtValue found;
    visit_specs("", [&](const auto &layer, const SdfPath &path, const auto &) {
        return layer->HasFieldDictKey(path, SdfFieldKeys->CustomData, TfToken(key), &found);
    });
    return found;
}

bool Prim::is_a(const std::string &schema) const {
    static const TfType &schemas = TfType::FindByName("UsdSchemaBase");
    const VtValue type = field(SdfFieldKeys->TypeName);
    if (!type.IsHolding<TfToken>() || type.UncheckedGet<TfToken>().IsEmpty()) return false;
    const TfType &found = schemas.FindDerivedByName(type.UncheckedGet<TfToken>().GetString());
    return found && found.IsA(TfType::FindByName(schema));
}

Varying Prim::attribute(const std::string &name) const {
    Varying found;
    visit_specs(name, [&](const SdfLayerHandle &layer, const SdfPath &path, const SdfLayerOffset &offset) {
        if (layer->GetNumTimeSamplesForPath(path)) {
            found = samples_of(layer, path, offset);
            return true;
        }
        if (layer->HasField(path, spline_field)) throw Failure("transforms of the scene follow splines");
        VtValue value;
        if (!layer->HasField(path, SdfFieldKeys->Default, &value)) return false;
        if (!is_block(value)) found.values = {value};
        return true;
    });
    return found;
}

bool Prim::has_targets(const std::string &relationship) const {
    SdfPathVector targets;
    visit_specs(relationship, [&](const SdfLayerHandle &layer, const SdfPath &path, const auto &) {
        const VtValue value = layer->GetField(path, SdfFieldKeys->TargetPaths);
        if (!value.IsHolding<SdfPathListOp>()) return false;
        value.UncheckedGet<SdfPathListOp>().ApplyOperations(&targets);
        return true;
    });
    return !targets.empty();
}

Composition::Composition(const SdfLayerRefPtr &root, const Carrier &carrier)
    : carrier_(carrier), cache_(std::make_unique<PcpCache>(PcpLayerStackIdentifier(root), "usd", true)) {
    PcpErrorVector errors;
    cache_->ComputeLayerStack(cache_->GetLayerStackIdentifier(), &errors);
    TfTokenVector names;
    PcpTokenSet prohibited;
    cache_->ComputePrimIndex(SdfPath::AbsoluteRootPath(), &errors).ComputePrimChildNames(&names, &prohibited);
    for (const TfToken &name : names) visit(SdfPath::AbsoluteRootPath().AppendChild(name), {});
}

bool Composition::is_instance(const std::string &object) const {
    return std::any_of(instances_.begin(), instances_.end(),
                       [&](const std::string &one) { return TfStringStartsWith(object, one + "/") || object == one; });
}

void Composition::visit(const SdfPath &path, Above above) {
    if (path.GetPathElementCount() > max_depth) throw Failure("the scene is nested too deeply");
    PcpErrorVector errors;
    const PcpPrimIndex *index = &cache_->ComputePrimIndex(path, &errors);
    if (index->HasAnyPayloads() && !cache_->IsPayloadIncluded(path)) {
        cache_->RequestPayloads({path}, {});
        index = &cache_->ComputePrimIndex(path, &errors);
    }
    const auto nodes = index->GetNodeRange();
    const auto node_count = static_cast<std::size_t>(std::distance(nodes.first, nodes.second));
    if (node_count > max_nodes) throw Failure("a prim of the scene has too many references");
    carrier_.reserve(prim_bytes + node_bytes * node_count);
    const Prim prim(*index);
    // USD draws prims that are defined, active and not abstract.
    SdfSpecifier specifier = SdfSpecifierOver;
    prim.visit_specs("", [&](const SdfLayerHandle &layer, const SdfPath &at, const auto &) {
        specifier = layer->GetFieldAs<SdfSpecifier>(at, SdfFieldKeys->Specifier, SdfSpecifierOver);
        return specifier != SdfSpecifierOver;
    });
    if (specifier != SdfSpecifierDef || !prim.field(SdfFieldKeys->Active).GetWithDefault<bool>(true)) return;
    if (!prim.custom("pdecodec:added").GetWithDefault<bool>(false)) {
        const std::string name = prim.custom("pdecodec:name").GetWithDefault<std::string>(path.GetName());
        above.name += (above.name.empty() ? "" : "/") + name;
    }
    if (index->IsInstanceable() || prim.is_a("UsdGeomPointInstancer")) {
        instances_.push_back(above.name);
        return;
    }
    if (prim.is_a("UsdGeomXformable")) {
        auto [steps, is_reset] = steps_of(prim);
        if (is_reset || !steps.empty()) {
            above.placement = std::make_shared<const Placement>(std::move(steps), is_reset ? nullptr : above.placement);
        }
    }
    if (const Varying purpose = prim.attribute("purpose"); !purpose.values.empty()) {
        above.purpose = purpose.values[0].GetWithDefault<TfToken>();
    }
    above.is_skinned = above.is_skinned || prim.is_a("UsdSkelRoot");
    above.has_skeleton = above.has_skeleton || prim.has_targets("skel:skeleton");
    above.has_joints = above.has_joints ||
                       (prim.has_value("primvars:skel:jointIndices") && prim.has_value("primvars:skel:jointWeights"));
    const bool has_shapes = prim.has_value("skel:blendShapes") && prim.has_targets("skel:blendShapeTargets");
    const bool is_drawn = above.purpose.IsEmpty() || above.purpose == "default" || above.purpose == "render";
    if (prim.is_a("UsdGeomGprim") && is_drawn) {
        const bool is_deformed = above.is_skinned && above.has_skeleton && (above.has_joints || has_shapes);
        shapes_.push_back({prim, above.name, above.placement, is_deformed});
    }
    TfTokenVector names;
    PcpTokenSet prohibited;
    index->ComputePrimChildNames(&names, &prohibited);
    for (const TfToken &name : names) visit(path.AppendChild(name), above);
}

}  // namespace pdeanim_usd

#endif
