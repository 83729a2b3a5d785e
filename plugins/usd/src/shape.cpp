#include "shape.hpp"

#include <algorithm>
#include <cstring>
#include <numeric>
#include <set>

#include "clip.hpp"
#include "names.hpp"

namespace pdeanim_usd {

namespace {

const char *const interpolations[] = {"vertex", "uniform", "faceVarying", "constant"};  // by domain

// Attributes that say what kind of shape an object is, or where it is.
const std::set<std::string> written_elsewhere{"subdivision", "curve_basis", "curve_wrap", "transform"};

std::span<const std::int32_t> span_of(const std::int32_t *data, std::int64_t count) {
    return {data, static_cast<std::size_t>(count)};
}

VtValue int_array(std::span<const std::int32_t> values) { return VtValue(VtIntArray(values.begin(), values.end())); }

TfToken int_array_type() { return SdfValueTypeNames->IntArray.GetAsToken(); }

// Reads one object.
class Reader {
public:
    Reader(pdeanim_animation *animation, std::int64_t index, bool changes) : changes_(changes) {
        pdeanim_error error;
        check(pdeanim_get_object(animation, index, &object_, &error), error);
        std::int64_t count;
        check(pdeanim_attribute_count(animation, index, &count, &error), error);
        attributes_.resize(count);
        for (std::int64_t i = 0; i < count; ++i) {
            check(pdeanim_get_attribute(animation, index, i, &attributes_[i], &error), error);
        }
    }

    Shape read() {
        shape_.key.name = object_.name;
        shape_.vertex_count = object_.vertex_count;
        shape_.face_sizes = span_of(object_.face_sizes, object_.face_count);
        shape_.face_indices = span_of(object_.face_indices, object_.corner_count);
        shape_.key.subdivision = label_of("subdivision");
        shape_.key.curve_basis = label_of("curve_basis");
        shape_.key.wrap = label_of("curve_wrap");
        find_form();
        read_transform();
        read_normals();
        read_attributes();
        return std::move(shape_);
    }

private:
    const pdeanim_attribute *find(const std::string &name, pdeanim_domain domain) const {
        for (const pdeanim_attribute &one : attributes_) {
            if (name == one.name && one.domain == domain) return &one;
        }
        return nullptr;
    }

    std::string label_of(const std::string &name) const {
        const pdeanim_attribute *found = find(name, PDEANIM_OF_OBJECT);
        if (!found || found->row_count * found->column_count != 1 || number_type(found->type).kind == 'f') return "";
        if (found->index_count && found->indices[0] < 0) return "";
        const std::int32_t label = as_int32(found->values, 1, number_type(found->type))[0];
        return label >= 0 && label < found->label_count ? found->labels[label] : "";
    }

    std::int64_t element_count(pdeanim_domain domain) const {
        switch (domain) {
            case PDEANIM_OF_VERTICES: return object_.vertex_count;
            case PDEANIM_OF_FACES: return object_.face_count;
            case PDEANIM_OF_CORNERS: return object_.corner_count;
            default: return 1;
        }
    }

    void add(const std::string &name, std::span<const std::int32_t> values, bool is_own = false) {
        shape_.properties.push_back({name, int_array_type(), int_array(values), "", is_own});
    }

    // A mesh if it has faces; curves if it has only lines and every vertex is in one; else points.
    void find_form() {
        const auto sizes = span_of(object_.line_sizes, object_.line_count);
        const auto vertices = span_of(object_.line_indices, object_.line_point_count);
        bool has_hidden_lines = object_.line_count > 0;
        if (object_.face_count) {
            shape_.key.schema = "Mesh";
            add("faceVertexCounts", shape_.face_sizes);
            add("faceVertexIndices", shape_.face_indices);
        } else if (has_hidden_lines && *std::min_element(sizes.begin(), sizes.end()) >= 2 &&
                   static_cast<std::int64_t>(std::set<std::int32_t>(vertices.begin(), vertices.end()).size()) ==
                       object_.vertex_count) {
            shape_.key.schema = "BasisCurves";
            has_hidden_lines = false;
            add("curveVertexCounts", sizes);
            std::vector<std::int32_t> all(object_.vertex_count);
            std::iota(all.begin(), all.end(), 0);
            if (!std::equal(vertices.begin(), vertices.end(), all.begin(), all.end())) {
                shape_.gather.assign(vertices.begin(), vertices.end());
                add("pdecodec:vertex", vertices, true);
            }
        } else {
            shape_.key.schema = "Points";
            if (changes_) read_ids();
        }
        if (has_hidden_lines) {
            add("pdecodec:lineCounts", sizes, true);
            add("pdecodec:lineIndices", vertices, true);
        }
    }

    // Ids tell which points of two runs are the same.
    void read_ids() {
        VtInt64Array ids(object_.vertex_count);
        std::iota(ids.begin(), ids.end(), 0);
        const pdeanim_attribute *found = find("id", PDEANIM_OF_VERTICES);
        if (found && !found->index_count && found->column_count == 1 && number_type(found->type).kind != 'f') {
            id_is_written_ = true;
            if (found->type == PDEANIM_INT64) {
                ids = array_of<int64_t>(found->values, object_.vertex_count);
            } else {
                const auto numbers = as_int32(found->values, object_.vertex_count, number_type(found->type));
                std::copy(numbers.begin(), numbers.end(), ids.begin());
            }
        }
        shape_.properties.push_back({"ids", SdfValueTypeNames->Int64Array.GetAsToken(), VtValue(ids)});
    }

    void read_transform() {
        const pdeanim_attribute *found = find("transform", PDEANIM_OF_OBJECT);
        if (!found || changes_) return;
        if (found->type != PDEANIM_FLOAT64 || found->column_count != 17 || !found->row_count) {
            throw Failure("the attribute 'transform' of object '" + shape_.key.name +
                          "' is not a list of times and matrices");
        }
        const double *rows = static_cast<const double *>(found->values);
        shape_.transform.assign(rows, rows + found->row_count * 17);
    }

    // Return one whole number for each element of an attribute; another one for an element without a value.
    std::vector<std::int32_t> expanded(const pdeanim_attribute &one, std::int32_t missing = 0) const {
        std::vector<std::int32_t> values = as_int32(one.values, one.row_count, number_type(one.type));
        if (!one.index_count) return values;
        std::vector<std::int32_t> found(one.index_count);
        for (std::int64_t i = 0; i < one.index_count; ++i) {
            found[i] = one.indices[i] < 0 ? missing : values[one.indices[i]];
        }
        return found;
    }

    static bool is_whole(const pdeanim_attribute *one) {
        return one && one->column_count == 1 && number_type(one->type).kind != 'f';
    }

    void read_normals() {
        if (!object_.face_count) return;
        const auto sizes = shape_.face_sizes;
        std::vector<std::int32_t> keys, shared;
        if (const pdeanim_attribute *groups = find("normal_group", PDEANIM_OF_CORNERS); is_whole(groups)) {
            keys = expanded(*groups);
            const pdeanim_attribute *tied = find("shared_normal", PDEANIM_OF_VERTICES);
            if (is_whole(tied)) shared = expanded(*tied);
        } else if (const pdeanim_attribute *smoothing = find("smoothing", PDEANIM_OF_FACES); is_whole(smoothing)) {
            const std::vector<std::int32_t> numbers = expanded(*smoothing);
            for (std::size_t face = 0; face < sizes.size(); ++face) {
                // A face in no group is smooth with no other face.
                const std::int32_t key = numbers[face] > 0 ? numbers[face] : -1 - static_cast<std::int32_t>(face);
                keys.insert(keys.end(), sizes[face], key);
            }
        } else {
            return;
        }
        shape_.normals = std::make_shared<NormalRows>(object_.vertex_count, sizes, shape_.face_indices, keys, shared);
        // Programs compute the normals of subdivision surfaces.
        shape_.shows_normals = shape_.key.subdivision.empty();
        if (shape_.shows_normals && (changes_ || !shape_.normals->is_smooth())) {
            shape_.properties.push_back(
                {"primvars:normals:indices", int_array_type(), VtValue(shape_.normals->corner_rows())});
        }
    }

    void read_attributes() {
        for (const std::string role : {"group", "material"}) {
            for (const pdeanim_attribute &one : attributes_) {
                if (one.domain == PDEANIM_OF_FACES && is_whole(&one) && role_of(one.name) == role) add_sets(one, role);
            }
        }
        std::set<std::string> taken;
        for (const pdeanim_attribute &one : attributes_) {
            const std::string name = one.name, role = role_of(name);
            const bool is_set = one.domain == PDEANIM_OF_FACES && (role == "group" || role == "material");
            const bool is_surface = one.domain == PDEANIM_OF_FACES || one.domain == PDEANIM_OF_CORNERS;
            if (written_elsewhere.contains(name) || is_set || one.domain == PDEANIM_OF_CELLS ||
                (name == "normal_group" && shape_.shows_normals) || (name == "id" && id_is_written_) ||
                (is_surface && shape_.key.schema != "Mesh")) {
                continue;
            }
            add_primvar(one, role, taken);
        }
    }

    void add_sets(const pdeanim_attribute &one, const std::string &role) {
        const std::vector<std::int32_t> values = expanded(one, -1);
        const auto members = [&](auto belongs) {
            VtIntArray found;
            for (std::size_t face = 0; face < values.size(); ++face) {
                if (belongs(values[face])) found.push_back(static_cast<int>(face));
            }
            return found;
        };
        if (role == one.name) {
            for (std::int64_t label = 0; label < one.label_count; ++label) {
                shape_.face_sets.push_back({role, one.labels[label], members([&](auto v) { return v == label; })});
            }
        } else {
            const std::string label = std::string(one.name).substr(role.size() + 1);
            shape_.face_sets.push_back({role, label, members([](auto v) { return v > 0; })});
        }
    }

    // Return whether a UV set has one row per vertex, which all corners of the vertex share.
    bool is_by_vertex(const pdeanim_attribute &one) const {
        return one.index_count == object_.corner_count && one.row_count == object_.vertex_count &&
               std::equal(one.indices, one.indices + one.index_count, object_.face_indices);
    }

    void add_primvar(const pdeanim_attribute &one, const std::string &role, std::set<std::string> &taken) {
        std::string name = one.name, interpolation = interpolations[one.domain];
        const bool is_uv =
            role == "uv" && one.domain == PDEANIM_OF_CORNERS && (one.column_count == 2 || one.column_count == 3);
        const bool is_color = role == "color" && (one.column_count == 3 || one.column_count == 4);
        NumberType type = number_type(one.type);
        auto indices = span_of(one.indices, one.index_count);
        std::vector<std::int32_t> rows;
        VtValue value;
        TfToken type_name;
        if (is_color || is_uv) {
            const std::string main = is_uv ? "st" : one.column_count == 3 ? "displayColor" : "color";
            name = name == role ? main : name.substr(role.size() + 1);
            const std::vector<float> numbers = as_floats(one, is_color);
            const ArrayType *found = array_type(is_uv ? "uv" : "color", {'f', 4}, one.column_count);
            value = found->make(numbers.data(), one.row_count);
            type_name = found->name;
            if (is_uv && !changes_ && is_by_vertex(one)) {
                interpolation = "vertex";
                indices = {};
            }
        } else if (one.label_count) {
            if (!is_whole(&one) || std::any_of(indices.begin(), indices.end(), [](auto row) { return row < 0; }))
                return;
            rows = expanded(one);
            if (rows.empty() || *std::min_element(rows.begin(), rows.end()) < 0) return;
            indices = rows;
            type_name = SdfValueTypeNames->StringArray.GetAsToken();
            value = VtValue(VtStringArray(one.labels, one.labels + one.label_count));
        } else {
            const ArrayType *found = array_type("", type, one.column_count);
            if (!found) return;
            value = found->make(one.values, one.row_count);
            type_name = found->name;
        }
        name = valid_property_name(name);
        if (!taken.insert(name).second) return;
        shape_.properties.push_back({"primvars:" + name, type_name, value, interpolation});
        if (!indices.empty()) {
            add("primvars:" + name + ":indices", indices);
        }
    }

    // Return the values as float32, whole numbers of colours divided by 255.
    static std::vector<float> as_floats(const pdeanim_attribute &one, bool is_color) {
        std::vector<float> found(one.row_count * one.column_count);
        const auto fill = [&]<class Number>(const Number *numbers, float divisor) {
            for (std::size_t i = 0; i < found.size(); ++i) found[i] = static_cast<float>(numbers[i]) / divisor;
        };
        const float divisor = is_color ? 255 : 1;
        switch (one.type) {
            case PDEANIM_FLOAT32: fill(static_cast<const float *>(one.values), 1); break;
            case PDEANIM_FLOAT64: fill(static_cast<const double *>(one.values), 1); break;
            case PDEANIM_INT32: fill(static_cast<const std::int32_t *>(one.values), divisor); break;
            case PDEANIM_INT64: fill(static_cast<const std::int64_t *>(one.values), divisor); break;
            case PDEANIM_UINT8: fill(static_cast<const std::uint8_t *>(one.values), divisor); break;
        }
        return found;
    }

    bool changes_, id_is_written_ = false;
    pdeanim_object object_;
    std::vector<pdeanim_attribute> attributes_;
    Shape shape_;
};

}  // namespace

std::vector<Shape> shapes_of(pdeanim_animation *animation, bool changes) {
    std::vector<Shape> found;
    std::map<ShapeKey, int> counts;
    for (std::int64_t i = 0; i < pdeanim_object_count(animation); ++i) {
        found.push_back(Reader(animation, i, changes).read());
        // In a file of several runs an object without vertices is no shape.
        if (!changes || found.back().vertex_count) found.back().key.number = counts[found.back().key]++;
    }
    return found;
}

std::vector<Field> fields_of(pdeanim_animation *animation) {
    pdeanim_error error;
    std::int64_t count;
    check(pdeanim_field_count(animation, &count, &error), error);
    std::vector<Field> found;
    for (std::int64_t i = 0; i < count; ++i) {
        pdeanim_field one;
        check(pdeanim_get_field(animation, i, &one, &error), error);
        // USD draws the surface of cells, without their data.
        if (one.domain == PDEANIM_OF_CELLS) continue;
        Field field{one.name,
                    one.unit,
                    interpolations[one.domain],
                    static_cast<int>(i),
                    number_type(one.type),
                    one.column_count,
                    one.row_count,
                    {0},
                    {}};
        for (std::int64_t k = 0; k < pdeanim_object_count(animation); ++k) {
            pdeanim_object object;
            check(pdeanim_get_object(animation, k, &object, &error), error);
            const bool has_it = !one.object_count || std::binary_search(one.objects, one.objects + one.object_count, k);
            const std::int64_t sizes[] = {object.vertex_count, object.face_count, object.corner_count, 1};
            field.is_of_object.push_back(has_it && object.vertex_count > 0 && sizes[one.domain] > 0);
            field.first_rows.push_back(field.first_rows.back() + (has_it ? sizes[one.domain] : 0));
        }
        found.push_back(std::move(field));
    }
    return found;
}

const ArrayType &field_type(const Field &field) {
    const ArrayType *found = array_type(role_of(field.name), field.type, field.columns);
    if (!found && field.columns > 1) found = array_type("", field.type, field.columns);
    return found ? *found : scalar_type(field.type);
}

VtValue field_value(const Field &field, const std::vector<char> &rows) {
    const ArrayType &type = field_type(field);
    const std::size_t numbers = rows.size() / field.type.bytes;
    // USD has no arrays of small integers: they become int.
    if (field.type.kind == 'b' || field.type.bytes >= 4 || (field.type.kind == 'u' && field.type.bytes == 1)) {
        return type.make(rows.data(), rows.size() / type.row_bytes);
    }
    const std::vector<std::int32_t> converted = as_int32(rows.data(), numbers, field.type);
    return type.make(converted.data(), numbers);
}

}  // namespace pdeanim_usd
