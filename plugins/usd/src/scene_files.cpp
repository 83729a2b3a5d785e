// Layers of a scene: opened from the file that holds them, with their arrays, and with references that find its other files.
#include <algorithm>

#include "scene.hpp"
#include "values.hpp"

namespace pdeanim_usd {

namespace {

const std::string udim_mark = "<UDIM>", first_udim = "1001";

bool is_layer(const std::string &name) {
    const std::string extension = TfStringToLower(TfGetExtension(name));
    return extension == "usd" || extension == "usda" || extension == "usdc";
}

// Rewrites the names of files in a layer.
class Renaming {
public:
    Renaming(const Clip &clip, const Carrier &carrier, const std::string &name,
             const SdfFileFormat::FileFormatArguments &arguments)
        : clip_(clip), carrier_(carrier), arguments_(arguments), folder_(TfGetPathName(name)) {}

    void rewrite(const SdfLayerRefPtr &layer) const {
        for (const std::string &name : layer->GetCompositionAssetDependencies()) {
            rename_dependency(layer, name, renamed(name));
        }
        layer->Traverse(SdfPath::AbsoluteRootPath(), [&](const SdfPath &path) {
            const bool is_asset =
                TfStringStartsWith(layer->GetFieldAs<TfToken>(path, SdfFieldKeys->TypeName).GetString(), "asset");
            for (const TfToken &field : layer->ListFields(path)) {
                if (field == SdfFieldKeys->TimeSamples) continue;
                VtValue value = layer->GetField(path, field);
                if (rewrite(value)) layer->SetField(path, field, value);
            }
            for (const double code : is_asset ? layer->ListTimeSamplesForPath(path) : std::set<double>()) {
                VtValue value;
                if (layer->QueryTimeSample(path, code, &value) && rewrite(value))
                    layer->SetTimeSample(path, code, value);
            }
        });
    }

private:
    // Return what a file's name is in the clip's file; the name itself, from the clip's folder, if it is none of the scene.
    std::string renamed(const std::string &name) const {
        const auto [outer, inner] = ArSplitPackageRelativePathOuter(name);
        std::string path;
        SdfFileFormat::FileFormatArguments arguments;
        if (outer.empty() || !TfIsRelativePath(outer) || outer.find("://") != std::string::npos ||
            SdfLayer::IsAnonymousLayerIdentifier(outer) || !SdfLayer::SplitIdentifier(outer, &path, &arguments)) {
            return name;
        }
        const std::string here = TfNormPath(folder_ + path);
        for (const std::string &one : {here, TfNormPath(path)}) {
            if (one != here && path[0] == '.') continue;
            if (!carrier_.has(TfStringReplace(one, udim_mark, first_udim))) continue;
            if (!inner.empty() || !is_layer(one)) {
                return ArJoinPackageRelativePath(std::vector<std::string>{clip_.path(), one, inner});
            }
            // The scene does not choose the memory limit.
            arguments.erase("memory");
            arguments.insert(arguments_.begin(), arguments_.end());
            arguments[layer_argument] = one;
            return SdfLayer::CreateIdentifier(clip_.path(), arguments);
        }
        return folder_.empty() ? name : here;
    }

    // Rewrite the names in a value; return whether there were any.
    bool rewrite(VtValue &value) const {
        if (value.IsHolding<SdfAssetPath>()) {
            value = SdfAssetPath(renamed(value.UncheckedGet<SdfAssetPath>().GetAssetPath()));
        } else if (value.IsHolding<VtArray<SdfAssetPath>>()) {
            VtArray<SdfAssetPath> all = value.UncheckedGet<VtArray<SdfAssetPath>>();
            for (SdfAssetPath &one : all) one = SdfAssetPath(renamed(one.GetAssetPath()));
            value = VtValue::Take(all);
        } else if (value.IsHolding<VtDictionary>()) {
            VtDictionary all = value.UncheckedGet<VtDictionary>();
            bool is_changed = false;
            for (auto &[key, member] : all) is_changed = rewrite(member) || is_changed;
            value = VtValue::Take(all);
            return is_changed;
        } else {
            return false;
        }
        return true;
    }

    const Clip &clip_;
    const Carrier &carrier_;
    const SdfFileFormat::FileFormatArguments &arguments_;
    std::string folder_;  // with a slash at its end, or empty
};

// Return an array of an object that a layer lacks.
VtValue array_of(pdeanim_animation *animation, const Carrier &carrier, const CutArray &cut) {
    pdeanim_error error;
    pdeanim_object object;
    check(pdeanim_get_object(animation, cut.object, &object, &error), error);
    const std::span<const std::int32_t> sizes(object.face_sizes, static_cast<std::size_t>(object.face_count));
    const NumberType whole{'i', 4};
    // Return rows in the order that the layer has them in.
    const auto made = [&](const ArrayType *type, const void *rows, std::int64_t count) {
        if (!type) throw Failure("the scene (section SCEN) lacks an array of a type that no attribute has");
        carrier.reserve(static_cast<std::uint64_t>(count) * type->row_bytes);
        if (cut.part != "turned") return type->make(rows, count);
        if (count != object.corner_count) throw Failure("the scene (section SCEN) does not fit the meshes");
        return type->make(rows_in_order(rows, type->row_bytes, reversed_corners(sizes)).data(), count);
    };
    if (cut.array == "faceVertexCounts") {
        carrier.reserve(sizes.size_bytes());
        return array_type("", whole, 1)->make(object.face_sizes, object.face_count);
    }
    if (cut.array == "faceVertexIndices")
        return made(array_type("", whole, 1), object.face_indices, object.corner_count);
    std::int64_t count;
    check(pdeanim_attribute_count(animation, cut.object, &count, &error), error);
    for (std::int64_t i = 0; i < count; ++i) {
        pdeanim_attribute one;
        check(pdeanim_get_attribute(animation, cut.object, i, &one, &error), error);
        if (cut.array != one.name) continue;
        if (cut.part == "indices" || (cut.part == "turned" && one.index_count)) {
            return made(array_type("", whole, 1), one.indices, one.index_count);
        }
        return made(array_type("", number_type(one.type), one.column_count), one.values, one.row_count);
    }
    throw Failure("the scene (section SCEN) needs the attribute '" + cut.array + "', which the file lacks");
}

}  // namespace

void rename_dependency(const SdfLayerRefPtr &layer, const std::string &name, const std::string &other) {
    // A first call changes only sublayers, if there is one of this name.
    for (int call = 0; name != other && call < 2; ++call) layer->UpdateCompositionAssetDependency(name, other);
}

SdfLayerRefPtr open_scene_layer(const Clip &clip, const Carrier &carrier, const std::string &name,
                                SdfFileFormat::FileFormatArguments arguments) {
    // Another format may open its files in turn: .pdeanim does.
    if (!carrier.has(name) || !is_layer(name))
        throw Failure("the scene (section SCEN) has no layer of USD '" + name + "'");
    const std::string place = ArJoinPackageRelativePath(clip.path(), name);
    // USD's errors are in the thread's list until they are taken out. Its functions for single errors, which the headers hold,
    // need the very TBB that USD is built with.
    const TfErrorMark errors;
    const SdfLayerRefPtr layer = SdfLayer::OpenAsAnonymous(place);
    if (!errors.Transport().IsEmpty() || !layer) {
        throw Failure("the layer '" + name + "' of the scene (section SCEN) is damaged");
    }
    const SdfChangeBlock block;
    const std::shared_ptr<const Run> run = clip.run(0);
    for (const CutArray &cut : carrier.arrays_of(name)) {
        const VtValue value = array_of(run->handle(), carrier, cut);
        const TfToken type = layer->GetFieldAs<TfToken>(cut.attribute, SdfFieldKeys->TypeName);
        if (SdfSchema::GetInstance().FindType(type).GetDefaultValue().GetType() != value.GetType()) {
            throw Failure("the scene (section SCEN) does not fit the meshes");
        }
        const std::set<double> codes = layer->ListTimeSamplesForPath(cut.attribute);
        if (codes.empty()) {
            layer->SetField(cut.attribute, SdfFieldKeys->Default, value);
        } else {
            layer->SetTimeSample(cut.attribute, *codes.begin(), value);
        }
    }
    arguments.erase("fps");
    arguments.erase("cache");
    Renaming(clip, carrier, name, arguments).rewrite(layer);
    return layer;
}

}  // namespace pdeanim_usd
