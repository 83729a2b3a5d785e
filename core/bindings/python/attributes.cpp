// Python's view of section ATTR.
#include "sections/attributes/attributes.hpp"

#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include "bindings/python/bindings.hpp"
#include "sections/attributes/attribute_mesh.hpp"

namespace pdeanim::bindings {

namespace {

std::span<const GridPoint> points_of(const Rows<i64, 3> &grid) {
    return {reinterpret_cast<const GridPoint *>(grid.data()), grid.shape(0)};
}

// ValueError unless the grid fits the vertices.
void check(const std::vector<ConnectivityView> &parts, const Rows<i64, 3> &grid) {
    i64 vertices = 0;
    for (const ConnectivityView &part : parts) vertices += part.vertices;
    if (vertices != static_cast<i64>(grid.shape(0))) throw nb::value_error("grid coordinates do not fit the vertices");
}

AttributeView attribute_view(const nb::handle &fields) {
    const nb::tuple attribute = nb::cast<nb::tuple>(fields);
    AttributeView view_of{};
    view_of.name = nb::cast<std::string>(attribute[0]);
    const i64 domain = nb::cast<i64>(attribute[1]), type = nb::cast<i64>(attribute[2]);
    const auto values = nb::cast<nb::ndarray<nb::ro, nb::c_contig, nb::device::cpu>>(attribute[3]);
    if (domain < 0 || domain >= domain_count || type < 0 || type >= value_types) {
        throw nb::value_error("an attribute is of no known kind");
    }
    if (values.ndim() < 1 || values.ndim() > 2) throw nb::value_error("values are no rows");
    view_of.domain = static_cast<Domain>(domain);
    view_of.type = static_cast<ValueType>(type);
    if (static_cast<i64>(values.itemsize()) != bytes_of(view_of.type))
        throw nb::value_error("values are of another type");
    view_of.rows = static_cast<i64>(values.shape(0));
    view_of.columns = values.ndim() == 2 ? static_cast<i64>(values.shape(1)) + 1 : 0;
    view_of.values = {static_cast<const u8 *>(values.data()), values.nbytes()};
    if (!attribute[4].is_none()) {
        view_of.indices = view(nb::cast<Flat<i32>>(attribute[4]));
        for (const i32 row : *view_of.indices) {
            if (row < -1 || row >= view_of.rows) throw nb::index_error("a row of an attribute is not there");
        }
    }
    view_of.labels = nb::cast<std::vector<std::string>>(attribute[5]);
    return view_of;
}

void check_rows(const AttributeView &attribute, const ConnectivityView &part) {
    const std::size_t rows = attribute.indices ? attribute.indices->size() : static_cast<std::size_t>(attribute.rows);
    const std::size_t wanted = attribute.domain == Domain::vertex   ? static_cast<std::size_t>(part.vertices)
                               : attribute.domain == Domain::face   ? part.face_sizes.size()
                               : attribute.domain == Domain::corner ? part.face_indices.size()
                                                                    : rows;
    if (rows != wanted) throw nb::value_error("rows of an attribute do not fit its domain");
}

nb::bytes py_encode_attributes(const nb::list &parts, const nb::list &attributes, const Rows<i64, 3> &grid,
                               std::optional<double> uv_tolerance, bool keeps_rows) {
    const std::vector<ConnectivityView> views = views_of(parts);
    check(views, grid);
    if (attributes.size() != views.size()) throw nb::value_error("attributes do not fit the parts");
    std::vector<AttributedPart> attributed;
    for (std::size_t part = 0; part < views.size(); ++part) {
        attributed.push_back({views[part], {}});
        for (const nb::handle fields : nb::cast<nb::list>(attributes[part])) {
            attributed.back().attributes.push_back(attribute_view(fields));
            check_rows(attributed.back().attributes.back(), views[part]);
        }
    }
    std::vector<u8> data;
    {
        nb::gil_scoped_release release;
        data = encode_attributes(attributed, points_of(grid), {uv_tolerance, keeps_rows});
    }
    return to_bytes(data);
}

nb::dlpack::dtype dtype_of(ValueType type) {
    switch (type) {
        case ValueType::float32: return nb::dtype<float>();
        case ValueType::float64: return nb::dtype<double>();
        case ValueType::int32: return nb::dtype<i32>();
        case ValueType::uint8: return nb::dtype<u8>();
        default: return nb::dtype<i64>();
    }
}

nb::object to_values(const Attribute &attribute, const nb::capsule &owner) {
    const std::size_t shape[] = {static_cast<std::size_t>(attribute.rows),
                                 static_cast<std::size_t>(attribute.numbers())};
    return nb::cast(nb::ndarray<nb::numpy, nb::ro>(attribute.values.data(), attribute.columns ? 2 : 1, shape, owner,
                                                   nullptr, dtype_of(attribute.type)));
}

}  // namespace

nb::list to_list(const std::shared_ptr<const std::vector<std::vector<Attribute>>> &decoded) {
    const nb::capsule owner = owner_of(decoded);
    nb::list found;
    for (const std::vector<Attribute> &of_part : *decoded) {
        nb::list attributes;
        for (const Attribute &attribute : of_part) {
            nb::object indices = nb::none();
            if (attribute.indices) indices = shared_array(*attribute.indices, owner);
            attributes.append(nb::make_tuple(attribute.name, static_cast<i64>(attribute.domain),
                                             to_values(attribute, owner), indices,
                                             nb::tuple(nb::cast(attribute.labels))));
        }
        found.append(attributes);
    }
    return found;
}

namespace {

nb::list py_decode_attributes(const nb::bytes &data, const nb::list &parts, const Rows<i64, 3> &grid, i64 most_bytes) {
    const std::vector<ConnectivityView> views = views_of(parts);
    check(views, grid);
    std::vector<std::vector<Attribute>> decoded;
    {
        nb::gil_scoped_release release;
        MemoryLimit limit(static_cast<u64>(most_bytes));
        TakenMemory taken(limit);
        decoded = decode_attributes(view(data), views, points_of(grid), taken);
    }
    return to_list(std::make_shared<const std::vector<std::vector<Attribute>>>(std::move(decoded)));
}

nb::object py_fan_numbers(const Flat<i32> &vertices, const Flat<i32> &keys) {
    if (vertices.size() != keys.size()) throw nb::value_error("keys do not fit the corners");
    for (const i32 vertex : view(vertices)) {
        if (vertex < 0) throw nb::index_error("a vertex is not there");
    }
    std::vector<i32> found;
    {
        nb::gil_scoped_release release;
        found = fan_numbers(view(vertices), view(keys));
    }
    return to_array(std::move(found));
}

}  // namespace

void bind_attributes(nb::module_ &module) {
    module.def(
        "encode_attributes", &py_encode_attributes, nb::arg("parts"), nb::arg("attributes"), nb::arg("grid"),
        nb::arg("uv_tolerance"), nb::arg("keeps_rows"),
        "Section ATTR of parts as in encode_connectivity, with a list of attributes (name, domain, type, values, "
        "indices or None, labels) each.");
    module.def("decode_attributes", &py_decode_attributes, nb::arg("data"), nb::arg("parts"), nb::arg("grid"),
               nb::arg("most_bytes"), "Attributes (name, domain, values, indices or None, labels) of each part.");
    module.def("fan_numbers", &py_fan_numbers, nb::arg("vertices"), nb::arg("keys"),
               "Of each corner, the number of its key among those of its vertex, as they come first, int32.");
}

}  // namespace pdeanim::bindings
