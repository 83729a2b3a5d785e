#include "stage.hpp"

#include "layer_fields.hpp"
#include "names.hpp"

namespace pdeanim_usd {

namespace {

// Root prim that is added if there are several roots: a layer has one default prim.
const std::string added_root = "scene";

// Scope of the materials of face sets, below the default prim, so that references to that include them.
const std::string materials_scope = "pdecodecMaterials";

const std::map<std::string, std::string> schemes{
    {"catmull-clark", "catmullClark"}, {"loop", "loop"}, {"bilinear", "bilinear"}};

const std::map<std::string, std::string> curve_bases{
    {"bezier", "bezier"}, {"bspline", "bspline"}, {"catmullrom", "catmullRom"}};

class Stage {
public:
    explicit Stage(std::shared_ptr<const Evaluator> evaluator)
        : evaluator_(evaluator), data_(TfCreateRefPtr(new LayerData(evaluator))) {
        data_->CreateSpec(root_, SdfSpecTypePseudoRoot);
    }

    TfRefPtr<LayerData> write(bool metadata_only) {
        describe();
        if (!metadata_only) {
            find_codes();
            write_shapes();
        }
        return data_;
    }

private:
    void set(const SdfPath &path, const TfToken &field, const VtValue &value) { data_->Set(path, field, value); }

    void describe() {
        for (const auto &[field, value] : layer_fields(*evaluator_)) set(root_, field, value);
        std::vector<std::string> names;
        for (const ShapeKey &key : evaluator_->keys()) names.push_back(key.name);
        paths_ = tree_paths(names);
        std::set<std::string> roots;
        for (const Steps &steps : paths_) roots.insert(steps.front());
        above_ = roots.size() > 1 ? root_.AppendChild(TfToken(added_root)) : root_;
        default_prim_ = roots.size() == 1 ? root_.AppendChild(TfToken(*roots.begin())) : above_;
        if (!roots.empty()) set(root_, SdfFieldKeys->DefaultPrim, VtValue(default_prim_.GetNameToken()));
    }

    // Find the time codes at which each shape varies with its frames, and those at which runs begin.
    void find_codes() {
        const std::vector<Sample> &samples = evaluator_->samples();
        run_codes_ = std::make_shared<std::vector<double>>();
        for (std::size_t i = 0; i < samples.size(); ++i) {
            const bool begins = i == 0 || samples[i].run != samples[i - 1].run;
            if (begins) {
                run_codes_->push_back(samples[i].code);
                runs_.push_back(samples[i].run);
            }
            frame_codes_.push_back({samples[i].code, samples[i].run, begins});
        }
    }

    // Return the codes of frames in runs for which `has_it`, and of the first frame of each other run.
    std::shared_ptr<const std::vector<double>> codes_where(const std::set<int> &runs) {
        std::shared_ptr<const std::vector<double>> &known = codes_[runs];
        if (!known) {
            std::vector<double> found;
            for (const auto &[code, run, begins] : frame_codes_) {
                if (begins || runs.contains(run)) found.push_back(code);
            }
            known = std::make_shared<const std::vector<double>>(std::move(found));
        }
        return known;
    }

    void define(const SdfPath &path, const std::string &type) {
        data_->CreateSpec(path, SdfSpecTypePrim);
        set(path, SdfFieldKeys->Specifier, VtValue(SdfSpecifierDef));
        set(path, SdfFieldKeys->TypeName, VtValue(TfToken(type)));
        append(path.GetParentPath(), SdfChildrenKeys->PrimChildren, path.GetNameToken());
    }

    void append(const SdfPath &path, const TfToken &field, const TfToken &name) {
        VtValue value = data_->Get(path, field);
        TfTokenVector names = value.IsHolding<TfTokenVector>() ? value.UncheckedGet<TfTokenVector>() : TfTokenVector();
        names.push_back(name);
        set(path, field, VtValue(names));
    }

    SdfPath add_attribute(const SdfPath &prim, const std::string &name, const TfToken &type, const VtValue &value,
                          bool is_uniform = false, bool is_custom = false) {
        const SdfPath path = prim.AppendProperty(TfToken(name));
        data_->CreateSpec(path, SdfSpecTypeAttribute);
        set(path, SdfFieldKeys->TypeName, VtValue(type));
        set(path, SdfFieldKeys->Custom, VtValue(is_custom));
        set(path, SdfFieldKeys->Variability, VtValue(is_uniform ? SdfVariabilityUniform : SdfVariabilityVarying));
        if (!value.IsEmpty()) set(path, SdfFieldKeys->Default, value);
        append(prim, SdfChildrenKeys->PropertyChildren, path.GetNameToken());
        return path;
    }

    void add_token(const SdfPath &prim, const std::string &name, const std::string &value) {
        add_attribute(prim, name, SdfValueTypeNames->Token.GetAsToken(), VtValue(TfToken(value)), true);
    }

    void set_custom(const SdfPath &path, const std::string &key, const VtValue &value) {
        VtDictionary data;
        const VtValue known = data_->Get(path, SdfFieldKeys->CustomData);
        if (known.IsHolding<VtDictionary>()) data = known.UncheckedGet<VtDictionary>();
        data.SetValueAtPath("pdecodec:" + key, value);
        set(path, SdfFieldKeys->CustomData, VtValue(data));
    }

    void write_shapes() {
        if (above_ != root_) {
            define(above_, "Xform");
            set_custom(above_, "added", VtValue(true));
        }
        const std::vector<ShapeKey> &keys = evaluator_->keys();
        std::vector<ShapePrim> shapes;
        for (std::size_t i = 0; i < keys.size(); ++i) {
            shapes.emplace_back(*this, static_cast<int>(i), make_prims(keys[i], paths_[i]));
        }
        // Runs are opened one after the other, each once.
        for (const int index : runs_) {
            const std::shared_ptr<const Run> run = evaluator_->clip().run(index);
            for (std::size_t i = 0; i < keys.size(); ++i) {
                if (const Shape *shape = evaluator_->shape(*run, index, static_cast<int>(i))) {
                    shapes[i].add_run(index, *run, *shape);
                }
            }
        }
        for (ShapePrim &shape : shapes) shape.finish();
    }

    SdfPath make_prims(const ShapeKey &key, const Steps &steps) {
        const Steps names = path_steps(key.name);
        SdfPath path = above_;
        for (std::size_t i = 0; i < steps.size(); ++i) {
            path = path.AppendChild(TfToken(steps[i]));
            if (data_->HasSpec(path)) continue;
            define(path, i + 1 == steps.size() ? key.schema : "Xform");
            if (i < names.size() && valid_name(names[i]) != names[i]) {
                set_custom(path, "name", VtValue(names[i]));
                set(path, SdfFieldKeys->DisplayName, VtValue(names[i]));
            }
        }
        return path;
    }

    // Return the material of a name, without a surface: programs identify sets of faces by their bound materials.
    SdfPath material(const std::string &label) {
        const SdfPath scope = default_prim_.AppendChild(TfToken(materials_scope));
        if (!data_->HasSpec(scope)) define(scope, "Scope");
        if (const auto known = materials_.find(label); known != materials_.end()) return known->second;
        const std::string name = unique_name(valid_name(label), material_names_);
        const SdfPath path = scope.AppendChild(TfToken(name));
        define(path, "Material");
        if (name != label) set_custom(path, "name", VtValue(label));
        return materials_[label] = path;
    }

    // The prim of one shape, with what its runs have.
    class ShapePrim {
    public:
        ShapePrim(Stage &stage, int index, const SdfPath &prim) : stage_(stage), index_(index), prim_(prim) {
            const ShapeKey &key = stage.evaluator_->keys()[index];
            if (key.schema == "Mesh") {
                const auto scheme = schemes.find(key.subdivision);
                stage.add_token(prim, "subdivisionScheme", scheme == schemes.end() ? "none" : scheme->second);
            } else if (key.schema == "BasisCurves") {
                const bool is_cubic = key.curve_basis.starts_with("cubic ");
                const auto basis = curve_bases.find(is_cubic ? key.curve_basis.substr(6) : key.curve_basis);
                stage.add_token(prim, "type", basis == curve_bases.end() ? "linear" : "cubic");
                if (basis != curve_bases.end()) stage.add_token(prim, "basis", basis->second);
                const bool is_known = key.wrap == "periodic" || key.wrap == "pinned";
                stage.add_token(prim, "wrap", is_known ? key.wrap : "nonperiodic");
            }
        }

        void add_run(int index, const Run &run, const Shape &shape) {
            runs_.insert(index);
            for (const Property &one : shape.properties) add_property(one);
            write_sets(shape);
            if (shape.shows_normals) {
                is_by_corner_ = is_by_corner_ || stage_.evaluator_->changes() || !shape.normals->is_smooth();
                has_normals_ = true;
            }
            if (!shape.transform.empty() && !has_transform_) add_transform();
            has_vertices_ = has_vertices_ || shape.vertex_count > 0;
            for (const Field &one : run.fields()) {
                if (!stage_.evaluator_->field(run, index, index_, one.name)) continue;
                const auto [known, is_new] = fields_.try_emplace(one.name, FieldRuns{one, {}});
                known->second.runs.insert(index);
                if (is_new) field_order_.push_back(one.name);
            }
        }

        // Add what varies with the frames.
        void finish() {
            const TfToken vectors = SdfValueTypeNames->Vector3fArray.GetAsToken();
            const TfToken places = SdfValueTypeNames->Point3fArray.GetAsToken();
            if (!has_vertices_) {
                stage_.add_attribute(prim_, "points", places, no_vectors());
                stage_.add_attribute(prim_, "extent", SdfValueTypeNames->Float3Array.GetAsToken(), VtValue());
                return;
            }
            vary("points", places, Quantity::points);
            vary("extent", SdfValueTypeNames->Float3Array.GetAsToken(), Quantity::extent);
            if (has_normals_) {
                const TfToken type = SdfValueTypeNames->Normal3fArray.GetAsToken();
                const SdfPath path = vary(is_by_corner_ ? "primvars:normals" : "normals", type, Quantity::normals);
                if (is_by_corner_) set_interpolation(path, "faceVarying");
            }
            for (const std::string &name : field_order_) add_field(fields_.at(name));
            if (!has_property("velocities")) vary("velocities", vectors, Quantity::velocities);
            if (!has_property("accelerations")) vary("accelerations", vectors, Quantity::accelerations);
        }

    private:
        struct FieldRuns {
            Field field;
            std::set<int> runs;
        };

        bool has_property(const std::string &name) const { return stage_.data_->HasSpec(path_of(name)); }
        SdfPath path_of(const std::string &name) const { return prim_.AppendProperty(TfToken(name)); }
        VtValue no_vectors() const { return VtValue(VtVec3fArray()); }

        void set_interpolation(const SdfPath &path, const std::string &interpolation) {
            stage_.set(path, TfToken("interpolation"), VtValue(TfToken(interpolation)));
        }

        SdfPath vary(const std::string &name, const TfToken &type, Quantity quantity) {
            const SdfPath path = stage_.add_attribute(prim_, name, type, VtValue());
            stage_.data_->add_series(path, {quantity, index_, name, no_vectors(), stage_.codes_where(runs_)});
            return path;
        }

        // Add an attribute that is constant in a run: a value if there is one run, else samples where runs begin.
        SdfPath add_constant(const SdfPath &prim, const std::string &name, const std::string &found_by,
                             const TfToken &type, const VtValue &value, bool is_own = false) {
            const bool changes = stage_.evaluator_->changes();
            const SdfPath path =
                stage_.add_attribute(prim, name, type, changes ? VtValue() : value, is_own && !changes, is_own);
            if (changes) {
                const VtValue empty = SdfSchema::GetInstance().FindType(type).GetDefaultValue();
                stage_.data_->add_series(path, {Quantity::constant, index_, found_by, empty, stage_.run_codes_});
            }
            return path;
        }

        void add_property(const Property &one) {
            if (has_property(one.name)) return;
            const SdfPath path = add_constant(prim_, one.name, one.name, one.type, one.value, one.is_own);
            if (!one.interpolation.empty()) set_interpolation(path, one.interpolation);
        }

        void write_sets(const Shape &shape) {
            std::map<std::string, std::size_t> sizes;
            std::set<std::string> taken;
            for (const FaceSet &one : shape.face_sets) {
                const std::string label = one.label.empty() ? one.role : one.label;
                const std::string name = unique_name(valid_name(label), taken);
                sizes[one.role] += one.members.size();
                const std::string key = one.role + ":" + one.label;
                if (sets_.insert(key).second) add_set(one, key, unique_name(name, set_names_));
            }
            for (const auto &[role, size] : sizes) {
                if (size > shape.face_sizes.size()) overlapping_.insert(role);
                const std::string name = "subsetFamily:" + family_of(role) + ":familyType";
                const std::string type = overlapping_.contains(role) ? "unrestricted" : "nonOverlapping";
                if (has_property(name)) {
                    stage_.set(path_of(name), SdfFieldKeys->Default, VtValue(TfToken(type)));
                } else {
                    stage_.add_token(prim_, name, type);
                }
            }
        }

        static std::string family_of(const std::string &role) {
            return role == "material" ? "materialBind" : "pdecodecGroup";
        }

        void add_set(const FaceSet &one, const std::string &key, const std::string &name) {
            const SdfPath subset = prim_.AppendChild(TfToken(name));
            stage_.define(subset, "GeomSubset");
            stage_.add_token(subset, "elementType", "face");
            stage_.add_token(subset, "familyName", family_of(one.role));
            add_constant(subset, "indices", key, SdfValueTypeNames->IntArray.GetAsToken(), VtValue(one.members));
            if (name != one.label) stage_.set_custom(subset, "name", VtValue(one.label));
            if (one.role != "material") return;
            SdfTokenListOp schemas;
            schemas.SetPrependedItems({TfToken("MaterialBindingAPI")});
            stage_.set(subset, TfToken("apiSchemas"), VtValue(schemas));
            const SdfPath binding = subset.AppendProperty(TfToken("material:binding"));
            const SdfPath material = stage_.material(one.label);
            stage_.data_->CreateSpec(binding, SdfSpecTypeRelationship);
            stage_.append(subset, SdfChildrenKeys->PropertyChildren, binding.GetNameToken());
            SdfPathListOp targets;
            targets.SetExplicitItems({material});
            stage_.set(binding, SdfFieldKeys->Custom, VtValue(false));
            stage_.set(binding, SdfFieldKeys->Variability, VtValue(SdfVariabilityUniform));
            stage_.set(binding, SdfFieldKeys->TargetPaths, VtValue(targets));
            stage_.set(binding, SdfChildrenKeys->RelationshipTargetChildren, VtValue(SdfPathVector{material}));
            stage_.data_->CreateSpec(binding.AppendTarget(material), SdfSpecTypeRelationshipTarget);
        }

        void add_transform() {
            has_transform_ = true;
            const std::string name = "xformOp:transform";
            const SdfPath path = stage_.add_attribute(prim_, name, SdfValueTypeNames->Matrix4d.GetAsToken(), VtValue());
            stage_.data_->add_series(
                path, {Quantity::transform, index_, name, VtValue(GfMatrix4d(1)), stage_.codes_where(runs_)});
            const VtTokenArray order{TfToken("!resetXformStack!"), TfToken(name)};
            stage_.add_attribute(prim_, "xformOpOrder", SdfValueTypeNames->TokenArray.GetAsToken(), VtValue(order),
                                 true);
        }

        void add_field(const FieldRuns &one) {
            const Field &field = one.field;
            const auto codes = stage_.codes_where(one.runs);
            const bool is_vector = field.type.kind == 'f' && field.columns == 3 && field.interpolation == "vertex";
            if (is_vector && (field.name == "velocities" || field.name == "accelerations")) {
                const TfToken type = SdfValueTypeNames->Vector3fArray.GetAsToken();
                const SdfPath path = stage_.add_attribute(prim_, field.name, type, VtValue());
                stage_.data_->add_series(path, {Quantity::field, index_, field.name, no_vectors(), codes});
                return;
            }
            const ArrayType &type = field_type(field);
            const std::string wanted = valid_property_name(primvar_name(field.name, field.columns));
            std::string name = wanted;
            for (int number = 2; has_property("primvars:" + name) || has_property(name); ++number) {
                name = wanted + "_" + std::to_string(number);
            }
            const SdfPath path = stage_.add_attribute(prim_, "primvars:" + name, type.name, VtValue());
            set_interpolation(path, field.interpolation);
            const std::size_t columns = type.row_bytes / field.type.bytes;
            if (field.columns > 1 && columns != static_cast<std::size_t>(field.columns)) {
                stage_.set(path, TfToken("elementSize"), VtValue(static_cast<int>(field.columns)));
            }
            stage_.set_custom(path, "dtype", VtValue(field.type.name()));
            if (!field.unit.empty()) stage_.set_custom(path, "unit", VtValue(field.unit));
            if (field_name(name, type.name) != field.name) stage_.set_custom(path, "name", VtValue(field.name));
            stage_.data_->add_series(path, {Quantity::field, index_, field.name, type.make(nullptr, 0), codes});
        }

        Stage &stage_;
        int index_;
        SdfPath prim_;
        std::set<int> runs_;
        std::set<std::string> sets_, set_names_, overlapping_;
        bool has_vertices_ = false, has_normals_ = false, is_by_corner_ = false, has_transform_ = false;
        std::map<std::string, FieldRuns> fields_;
        std::vector<std::string> field_order_;
    };

    struct FrameCode {
        double code;
        int run;
        bool begins;
    };

    const SdfPath root_ = SdfPath::AbsoluteRootPath();
    std::shared_ptr<const Evaluator> evaluator_;
    TfRefPtr<LayerData> data_;
    std::vector<Steps> paths_;
    SdfPath above_, default_prim_;
    std::vector<FrameCode> frame_codes_;
    std::vector<int> runs_;
    std::shared_ptr<std::vector<double>> run_codes_;
    std::map<std::set<int>, std::shared_ptr<const std::vector<double>>> codes_;
    std::map<std::string, SdfPath> materials_;
    std::set<std::string> material_names_;
};

}  // namespace

TfRefPtr<LayerData> layer_data_of(std::shared_ptr<const Evaluator> evaluator, bool metadata_only) {
    return Stage(std::move(evaluator)).write(metadata_only);
}

}  // namespace pdeanim_usd
