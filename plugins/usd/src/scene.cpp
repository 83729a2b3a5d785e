#ifndef PDEANIM_USD_NO_SCENES
#include "scene.hpp"

#include <algorithm>

#include "composition.hpp"

namespace pdeanim_usd {

namespace {

// Shapes that have sizes instead of points.
const std::vector<std::string> implicit_types{"UsdGeomCube",      "UsdGeomSphere",  "UsdGeomCylinder",
                                              "UsdGeomCone",      "UsdGeomCapsule", "UsdGeomCylinder_1",
                                              "UsdGeomCapsule_1", "UsdGeomPlane"};

// Time codes a second by USD's rules.
constexpr double usd_rate = 24;

const TfToken interpolation_field("interpolation"), schemas_field("apiSchemas");

using SceneLayers = std::map<std::string, SdfLayerRefPtr>;  // by name

// Writes the motion over the prims of a scene, as stronger opinions in its root layer.
class Over {
public:
    Over(const Evaluator &evaluator, const Carrier &carrier, const SdfLayerRefPtr &layer, const SceneLayers &layers,
         const Composition &composition)
        : evaluator_(evaluator), carrier_(carrier), layer_(layer), layers_(layers), run_(evaluator.clip().run(0)) {
        std::map<std::string, std::vector<const ScenePrim *>> prims;
        for (const ScenePrim &one : composition.shapes()) prims[one.name].push_back(&one);
        std::map<std::string, std::size_t> next;
        for (const ShapeKey &key : evaluator.keys()) {
            const std::vector<const ScenePrim *> &alike = prims[key.name];
            const std::size_t number = next[key.name]++;
            if (number < alike.size()) {
                matches_.push_back(alike[number]);
            } else if (alike.empty() && composition.is_instance(key.name)) {
                matches_.push_back(nullptr);
            } else {
                throw Failure("the scene has no mesh '" + key.name + "'");
            }
        }
        std::vector<double> codes;
        for (const Sample &one : evaluator.samples()) codes.push_back(one.code);
        codes_ = std::make_shared<const std::vector<double>>(std::move(codes));
    }

    std::vector<std::pair<SdfPath, Series>> write() {
        for (std::size_t i = 0; i < matches_.size(); ++i) {
            if (matches_[i] && run_->shapes()[i].vertex_count) write_shape(static_cast<int>(i), *matches_[i]);
        }
        extend_range();
        return std::move(series_);
    }

private:
    // Return the place of an attribute in the root layer, without a value.
    SdfPath cleared(const Prim &prim, const std::string &name, const SdfValueTypeName &type) {
        const SdfPath path = prim.path().AppendProperty(TfToken(name));
        if (!layer_->HasSpec(path)) SdfAttributeSpec::New(SdfCreatePrimInLayer(layer_, prim.path()), name, type);
        layer_->EraseField(path, SdfFieldKeys->TimeSamples);
        layer_->EraseField(path, SdfFieldKeys->Default);
        return path;
    }

    void set(const Prim &prim, const std::string &name, const SdfValueTypeName &type, const VtValue &value) {
        layer_->SetField(cleared(prim, name, type), SdfFieldKeys->Default, value);
    }

    // Block an attribute that has a value.
    void block(const Prim &prim, const std::string &name) {
        const TfToken type = prim.field(SdfFieldKeys->TypeName, name).GetWithDefault<TfToken>();
        if (prim.has_value(name)) set(prim, name, SdfSchema::GetInstance().FindType(type), VtValue(SdfValueBlock()));
    }

    SdfPath vary(const Prim &prim, const std::string &name, const SdfValueTypeName &type, Quantity quantity,
                 int shape) {
        const SdfPath path = cleared(prim, name, type);
        series_.push_back({path, {quantity, shape, name, VtValue(VtVec3fArray()), codes_, in_scene_}});
        return path;
    }

    void write_shape(int number, const ScenePrim &match) {
        const auto &types = *SdfValueTypeNames;
        const Prim &prim = match.prim;
        const Shape &shape = run_->shapes()[number];
        const bool is_implicit = std::any_of(implicit_types.begin(), implicit_types.end(),
                                             [&](const std::string &one) { return prim.is_a(one); });
        const VtIntArray own_faces(shape.face_indices.begin(), shape.face_indices.end());
        const Varying stored_faces = prim.attribute("faceVertexIndices");
        InScene in_scene{match.placement, prim.is_a("UsdGeomBasisCurves") && !shape.gather.empty(), false};
        if (!is_implicit && !stored_faces.values.empty())
            in_scene.is_turned = stored_faces.values[0] != VtValue(own_faces);
        in_scene_ = std::make_shared<const InScene>(in_scene);
        if (is_implicit) {
            layer_->SetField(SdfCreatePrimInLayer(layer_, prim.path())->GetPath(), SdfFieldKeys->TypeName,
                             VtValue(TfToken("Mesh")));
            set(prim, "faceVertexCounts", types.IntArray,
                VtValue(VtIntArray(shape.face_sizes.begin(), shape.face_sizes.end())));
            set(prim, "faceVertexIndices", types.IntArray, VtValue(own_faces));
            set(prim, "subdivisionScheme", types.Token, VtValue(TfToken("none")));
        } else {
            const std::size_t points = in_scene.is_gathered ? shape.gather.size() : shape.vertex_count;
            const Varying stored = prim.attribute("points");
            if (stored.values.empty() || !stored.values[0].IsHolding<VtVec3fArray>() ||
                stored.values[0].GetArraySize() != points) {
                throw Failure("the mesh '" + shape.key.name + "' of the scene has another number of points");
            }
        }
        if (match.placement) match.placement->inverse(codes_->front());
        if (match.is_deformed) stop_deforming(prim);
        vary(prim, "points", types.Point3fArray, Quantity::points, number);
        vary(prim, "extent", types.Float3Array, Quantity::extent, number);
        const bool has_normals = prim.has_value("normals") || prim.has_value("primvars:normals");
        if (shape.normals && (is_implicit || has_normals)) write_normals(number, prim, shape);
        write_fields(number, prim);
        const bool is_steady = !match.placement || match.placement->is_constant();
        for (const bool second : {false, true}) {
            const std::string name = second ? "accelerations" : "velocities";
            if (prim.has_value(name) || (second && !is_steady)) continue;
            vary(prim, name, types.Vector3fArray, second ? Quantity::accelerations : Quantity::velocities, number);
        }
    }

    void write_normals(int number, const Prim &prim, const Shape &shape) {
        block(prim, "normals");
        const SdfPath path =
            vary(prim, "primvars:normals", SdfValueTypeNames->Normal3fArray, Quantity::normals, number);
        const bool is_smooth = shape.normals->is_smooth();
        layer_->SetField(path, interpolation_field, VtValue(TfToken(is_smooth ? "vertex" : "faceVarying")));
        VtIntArray rows = shape.normals->corner_rows();
        if (in_scene_->is_turned) {
            VtIntArray turned;
            for (const std::int32_t corner : reversed_corners(shape.face_sizes)) turned.push_back(rows[corner]);
            rows = turned;
        }
        const std::string indices = "primvars:normals:indices";
        if (!is_smooth) {
            set(prim, indices, SdfValueTypeNames->IntArray, VtValue(rows));
        } else {
            set(prim, indices, SdfValueTypeNames->IntArray, VtValue(SdfValueBlock()));
        }
    }

    // Stop joints and blend shapes from deforming a prim; these stay.
    void stop_deforming(const Prim &prim) {
        const SdfPrimSpecHandle spec = SdfCreatePrimInLayer(layer_, prim.path());
        const TfToken api("SkelBindingAPI");
        auto schemas = layer_->GetFieldAs<SdfTokenListOp>(prim.path(), schemas_field);
        TfTokenVector items = schemas.IsExplicit() ? schemas.GetExplicitItems() : schemas.GetPrependedItems();
        if (std::find(items.begin(), items.end(), api) == items.end()) {
            items.push_back(api);
            schemas.IsExplicit() ? schemas.SetExplicitItems(items) : schemas.SetPrependedItems(items);
            layer_->SetField(prim.path(), schemas_field, VtValue(schemas));
        }
        for (const char *name : {"skel:skeleton", "skel:animationSource", "skel:blendShapeTargets"}) {
            const SdfPath path = prim.path().AppendProperty(TfToken(name));
            if (!layer_->HasSpec(path)) SdfRelationshipSpec::New(spec, name, false);
            layer_->GetRelationshipAtPath(path)->GetTargetPathList().ClearEditsAndMakeExplicit();
        }
        for (const char *name : {"skel:blendShapes", "primvars:skel:jointIndices", "primvars:skel:jointWeights"}) {
            block(prim, name);
        }
    }

    // Let samples that are values of fields come from these. They stand where the scene has them.
    void write_fields(int number, const Prim &prim) {
        std::map<std::pair<std::string, SdfPath>, std::vector<const CutSample *>> cuts;
        for (const CutSample &one : carrier_.samples()) {
            if (one.object == number) cuts[{one.file, one.attribute}].push_back(&one);
        }
        for (const auto &[place, samples] : cuts) {
            const auto layer = layers_.find(place.first);
            if (layer == layers_.end()) continue;
            const SdfPath &path = place.second;
            prim.visit_specs(path.GetName(), [&](const auto &one, const SdfPath &there, const SdfLayerOffset &offset) {
                const bool is_it = get_pointer(one) == get_pointer(layer->second) && there == path;
                if (is_it) write_field(number, prim, place.first, path, offset, samples);
                return is_it;
            });
        }
    }

    void write_field(int number, const Prim &prim, const std::string &file, const SdfPath &from,
                     const SdfLayerOffset &offset, const std::vector<const CutSample *> &samples) {
        const SdfLayerRefPtr &layer = layers_.at(file);
        const Field *field = evaluator_.field(*run_, 0, number, samples[0]->field);
        if (!field) throw Failure("the scene needs the field '" + samples[0]->field + "', which the file lacks");
        const TfToken type = layer->GetFieldAs<TfToken>(from, SdfFieldKeys->TypeName);
        const SdfValueTypeName type_name = SdfSchema::GetInstance().FindType(type);
        const std::string name = from.GetName();
        const SdfPath path = prim.path().AppendProperty(TfToken(name));
        if (file != carrier_.root() || path != from) {
            if (!layer_->HasSpec(path))
                SdfAttributeSpec::New(SdfCreatePrimInLayer(layer_, prim.path()), name, type_name);
            for (const double code : layer->ListTimeSamplesForPath(from)) {
                VtValue value;
                if (layer->QueryTimeSample(from, code, &value)) layer_->SetTimeSample(path, offset * code, value);
            }
        }
        const auto rows = static_cast<std::size_t>(field->first_rows[number + 1] - field->first_rows[number]);
        const std::size_t points = in_scene_->is_gathered ? run_->shapes()[number].gather.size() : rows;
        Series series{Quantity::sampled, number, field->name, type_name.GetDefaultValue(), nullptr, in_scene_};
        for (const CutSample *one : samples) {
            // Values that some elements share, or that some lack, stand in other rows than those of the field.
            if (one->rows != (field->interpolation == "vertex" ? points : rows)) {
                layer_->SetTimeSample(path, offset * one->code, VtValue(SdfValueBlock()));
            } else {
                series.times[offset * one->code] = nearest_frame(one->time);
            }
        }
        const std::set<double> codes = layer_->ListTimeSamplesForPath(path);
        series.codes = std::make_shared<const std::vector<double>>(codes.begin(), codes.end());
        series_.emplace_back(path, std::move(series));
    }

    double nearest_frame(double time) const {
        const std::vector<double> &times = evaluator_.clip().times();
        const auto after = std::lower_bound(times.begin(), times.end(), time);
        if (after == times.begin()) return times.front();
        if (after == times.end()) return times.back();
        return *after - time < time - *std::prev(after) ? *after : *std::prev(after);
    }

    // Let the stage last as long as the motion.
    void extend_range() {
        double first = codes_->front(), last = codes_->back();
        if (layer_->HasStartTimeCode() && layer_->HasEndTimeCode()) {
            first = std::min(first, layer_->GetStartTimeCode());
            last = std::max(last, layer_->GetEndTimeCode());
        }
        layer_->SetStartTimeCode(first);
        layer_->SetEndTimeCode(last);
    }

    const Evaluator &evaluator_;
    const Carrier &carrier_;
    SdfLayerRefPtr layer_;
    const SceneLayers &layers_;
    std::shared_ptr<const Run> run_;
    std::vector<const ScenePrim *> matches_;
    std::shared_ptr<const std::vector<double>> codes_;
    std::shared_ptr<const InScene> in_scene_;
    std::vector<std::pair<SdfPath, Series>> series_;
};

double rate_of(const SdfLayerRefPtr &layer) {
    const double found = layer->HasTimeCodesPerSecond() ? layer->GetTimeCodesPerSecond()
                         : layer->HasFramesPerSecond()  ? layer->GetFramesPerSecond()
                                                        : usd_rate;
    if (!(found > 0 && found < 1e9)) throw Failure("the scene has a rate that is no positive number");
    return found;
}

// Return copies of the layers of a scene by their names, which refer to each other and to no other file: composing the layers
// themselves would read those, and wait for those that other threads open.
SceneLayers isolated_layers(const Clip &clip, const Carrier &carrier, const SdfLayerRefPtr &root,
                            const SdfFileFormat::FileFormatArguments &arguments) {
    SceneLayers found;
    std::vector<std::string> left;
    const auto add = [&](const std::string &name, const SdfLayerRefPtr &from) {
        found[name] = SdfLayer::CreateAnonymous();
        found[name]->TransferContent(from);
        left.push_back(name);
    };
    const auto name_of = [&](const std::string &identifier) {
        std::string file;
        SdfFileFormat::FileFormatArguments own;
        const bool is_own = SdfLayer::SplitIdentifier(identifier, &file, &own) && file == clip.path();
        return is_own ? own[layer_argument] : "";
    };
    add(carrier.root(), root);
    for (std::size_t i = 0; i < left.size(); ++i) {
        for (const std::string &one : found[left[i]]->GetCompositionAssetDependencies()) {
            const std::string name = name_of(one);
            if (name.empty() || found.contains(name)) continue;
            try {
                add(name, open_scene_layer(clip, carrier, name, arguments));
            } catch (const Failure &) {
                // Programs that compose the stage report layers that cannot be opened.
            }
        }
    }
    for (const auto &[name, layer] : found) {
        for (const std::string &one : layer->GetCompositionAssetDependencies()) {
            const auto other = found.find(name_of(one));
            rename_dependency(layer, one, other == found.end() ? "" : other->second->GetIdentifier());
        }
    }
    return found;
}

}  // namespace

SceneLayer scene_layer_of(std::shared_ptr<const Clip> clip, const Carrier &carrier, double fps, std::size_t max_kept,
                          const SdfFileFormat::FileFormatArguments &arguments) {
    if (clip->run_count() > 1) throw Failure("the scene (section SCEN) is of a file whose faces do not change");
    const SdfLayerRefPtr root = open_scene_layer(*clip, carrier, carrier.root(), arguments);
    const auto evaluator = std::make_shared<const Evaluator>(clip, fps, max_kept, rate_of(root));
    const SceneLayers layers = isolated_layers(*clip, carrier, root, arguments);
    const Composition composition(layers.at(carrier.root()), carrier);
    const SdfChangeBlock block;
    return {root, evaluator, Over(*evaluator, carrier, root, layers, composition).write()};
}

}  // namespace pdeanim_usd

#endif
