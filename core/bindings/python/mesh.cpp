// Sections of meshes, as an encoder writes them: SEQN, CONN, ORDR, REST, ATTR; and the curves of a mesh.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <cstring>
#include <memory>

#include "bindings/python/bindings.hpp"
#include "mesh/curves.hpp"
#include "sections/attributes/attribute_mesh.hpp"
#include "sections/connectivity/cells.hpp"
#include "sections/connectivity/solids.hpp"
#include "sections/description/description.hpp"
#include "sections/reference/reference.hpp"

namespace pdeanim::bindings {

namespace {

// Return whether the sizes are each at least `smallest` and add up to the number of indices, and the indices refer to
// existing vertices.
bool fit_together(std::span<const i32> sizes, i32 smallest, std::span<const i32> indices, i64 vertices) {
    i64 sum = 0;
    bool is_sound = true;
    for (const i32 size : sizes) {
        is_sound = is_sound && size >= smallest;
        sum += size;
    }
    for (const i32 index : indices) is_sound = is_sound && index >= 0 && index < vertices;
    return is_sound && sum == static_cast<i64>(indices.size());
}

}  // namespace

std::vector<ConnectivityView> views_of(const nb::list &parts) {
    std::vector<ConnectivityView> views;
    for (const nb::handle part : parts) {
        const nb::tuple fields = nb::cast<nb::tuple>(part);
        require(fields.size() == 8, "an object has vertices, faces, lines and cells");
        const auto numbers = [&](std::size_t place) { return view(nb::cast<Flat<i32>>(fields[place])); };
        views.push_back({nb::cast<i64>(fields[0]), numbers(1), numbers(2), numbers(3), numbers(4),
                         view(nb::cast<Flat<u8>>(fields[5])), numbers(6), numbers(7)});
        const ConnectivityView &own = views.back();
        require(own.vertices >= 0 && fit_together(own.face_sizes, 3, own.face_indices, own.vertices) &&
                    fit_together(own.line_sizes, 1, own.line_indices, own.vertices) &&
                    fit_together(own.cell_sizes, 1, own.cell_indices, own.vertices) &&
                    own.cell_shapes.size() == own.cell_sizes.size(),
                "counts and indices of faces, lines or cells do not fit together");
        for (std::size_t cell = 0; cell < own.cell_shapes.size(); ++cell) {
            const std::size_t shape = own.cell_shapes[cell];
            require(shape < cell_shapes && own.cell_sizes[cell] >= smallest_cells[shape],
                    "a cell has an unknown shape, or too few nodes");
        }
    }
    return views;
}

std::span<const GridPoint> grid_of(const Rows<i64, 3> &grid, const std::vector<ConnectivityView> &objects) {
    i64 vertices = 0;
    for (const ConnectivityView &object : objects) vertices += object.vertices;
    require(vertices == static_cast<i64>(grid.shape(0)), "there must be one grid point per vertex");
    return {reinterpret_cast<const GridPoint *>(grid.data()), grid.shape(0)};
}

namespace {

nb::bytes py_encode_description(const Flat<double> &times, const std::vector<std::string> &names) {
    std::vector<u8> data;
    {
        nb::gil_scoped_release release;
        data = encode_description(view(times), names);
    }
    return to_bytes(data);
}

nb::object py_encode_connectivity(const nb::list &parts, bool keep_order) {
    const std::vector<ConnectivityView> views = views_of(parts);
    std::pair<std::vector<u8>, std::vector<u8>> sections;
    {
        nb::gil_scoped_release release;
        sections = encode_connectivity(views, keep_order);
    }
    return named("CodedConnectivity", to_bytes(sections.first), to_bytes(sections.second));
}

nb::bytes py_encode_cells(const nb::list &parts) {
    const std::vector<ConnectivityView> views = views_of(parts);
    std::vector<u8> data;
    {
        nb::gil_scoped_release release;
        data = encode_cells(views);
    }
    return to_bytes(data);
}

nb::object py_inner_sides(const nb::list &parts) {
    const std::vector<ConnectivityView> views = views_of(parts);
    require(views.size() == 1, "inner sides are of one object");
    Connectivity found;
    {
        nb::gil_scoped_release release;
        found = inner_sides(views[0]);
    }
    return nb::make_tuple(to_array(std::move(found.face_sizes)), to_array(std::move(found.face_indices)));
}

nb::list py_coded_orders(const nb::list &parts) {
    const std::vector<ConnectivityView> views = views_of(parts);
    std::vector<CodedOrder> orders;
    {
        nb::gil_scoped_release release;
        orders = coded_orders(views);
    }
    nb::list found;
    for (CodedOrder &order : orders) {
        if (order.faces.empty()) {
            found.append(nb::none());
        } else {
            found.append(named("CodedOrder", to_array(std::move(order.vertices)), to_array(std::move(order.faces)),
                               to_array(std::move(order.corners))));
        }
    }
    return found;
}

nb::object py_extract_curves(const nb::list &parts, const Rows<i64, 3> &reference) {
    const std::vector<ConnectivityView> views = views_of(parts);
    const std::span<const GridPoint> grid = grid_of(reference, views);
    Curves found;
    {
        nb::gil_scoped_release release;
        found = extract_curves(views, grid);
    }
    return named("Curves", to_array(std::move(found.order)), to_array(std::move(found.starts)));
}

// Make polygons of the faces and lines of all objects, whose vertices are numbered in one row.
Polygons polygons_of(const Flat<i64> &starts, const Flat<i32> &vertex, i64 faces, i64 vertices) {
    Polygons mesh;
    mesh.starts.assign(starts.data(), starts.data() + starts.size());
    mesh.vertex.assign(vertex.data(), vertex.data() + vertex.size());
    mesh.faces = faces;
    mesh.vertices = vertices;
    return mesh;
}

// View ties, after checking them: for each vertex, the first vertex that it is tied to; or an empty array.
Ties ties_of(const Flat<i32> &ties, std::size_t vertices) {
    require(ties.size() == 0 || ties.size() == vertices, "ties are of other vertices");
    const auto found = view(ties);
    for (std::size_t vertex = 0; vertex < found.size(); ++vertex) {
        const auto first = static_cast<std::size_t>(found[vertex]);
        require(first <= vertex && found[first] == found[vertex], "a vertex is tied to one that is not the first");
    }
    return found;
}

std::span<const Vector> vectors_of(const Rows<i64, 3> &grid) {
    return {reinterpret_cast<const Vector *>(grid.data()), grid.shape(0)};
}

nb::object py_encode_reference(const Flat<i64> &starts, const Flat<i32> &vertex, i64 faces, const Rows<i64, 3> &grid,
                               const std::optional<Rows<i32, 2>> &weights, const Flat<i32> &points,
                               const Flat<i32> &ties) {
    const Ties tied = ties_of(ties, grid.shape(0));
    std::optional<Smoothing> smoothing;
    if (weights) {
        require(weights->shape(0) == smoothing_classes, "the number of classes of the weights is wrong");
        smoothing.emplace();
        std::memcpy(&smoothing->weights, weights->data(), sizeof(smoothing->weights));
        smoothing->point_of.assign(points.data(), points.data() + points.size());
    }
    CodedReference coded;
    {
        nb::gil_scoped_release release;
        const Polygons mesh = polygons_of(starts, vertex, faces, static_cast<i64>(grid.shape(0)));
        coded = encode_reference(mesh, vectors_of(grid), smoothing ? &*smoothing : nullptr, tied);
    }
    return named("CodedReference", coded.kind, to_bytes(coded.data));
}

nb::object py_smooth_reference(const Flat<i64> &starts, const Flat<i32> &vertex, i64 faces, const Rows<i64, 3> &grid,
                               const Rows<double, 3> &wanted, const Flat<i32> &ties) {
    const Ties tied = ties_of(ties, grid.shape(0));
    require(wanted.shape(0) == grid.shape(0), "grid and wanted coordinates differ in number");
    std::optional<Smoothing> found;
    {
        nb::gil_scoped_release release;
        const Polygons mesh = polygons_of(starts, vertex, faces, static_cast<i64>(grid.shape(0)));
        found =
            smooth_reference(mesh, vectors_of(grid),
                             {reinterpret_cast<const std::array<double, 3> *>(wanted.data()), wanted.shape(0)}, tied);
    }
    if (!found) return nb::none();
    std::vector<i32> weights;
    for (const auto &own : found->weights) weights.insert(weights.end(), own.begin(), own.end());
    std::vector<i64> smooth;
    for (const Vector &own : found->grid) smooth.insert(smooth.end(), own.begin(), own.end());
    return named("Smoothing", to_rows(std::move(weights), 2), to_array(std::move(found->point_of)),
                 to_rows(std::move(smooth), 3), found->error_ratio);
}

nb::object py_decode_reference(const Flat<i64> &starts, const Flat<i32> &vertex, i64 faces, i64 vertices, u8 predictor,
                               const nb::bytes &data) {
    auto kept = std::make_unique<std::vector<Vector>>();
    std::vector<i32> ties;
    {
        nb::gil_scoped_release release;
        DecodedReference found = decode_reference(polygons_of(starts, vertex, faces, vertices), predictor, view(data));
        *kept = std::move(found.grid);
        ties = std::move(found.ties);
    }
    const std::size_t rows = kept->size();
    i64 *first = reinterpret_cast<i64 *>(kept->data());
    nb::capsule owner(kept.release(),
                      [](void *pointer) noexcept { delete static_cast<std::vector<Vector> *>(pointer); });
    return nb::make_tuple(nb::cast(nb::ndarray<nb::numpy, i64, nb::shape<-1, 3>>(first, {rows, 3}, owner)),
                          to_array(std::move(ties)));
}

AttributeView attribute_view(const nb::handle &fields) {
    const nb::tuple attribute = nb::cast<nb::tuple>(fields);
    AttributeView view_of{};
    view_of.name = nb::cast<std::string>(attribute[0]);
    const i64 domain = nb::cast<i64>(attribute[1]), type = nb::cast<i64>(attribute[2]);
    const auto values = nb::cast<nb::ndarray<nb::ro, nb::c_contig, nb::device::cpu>>(attribute[3]);
    require(domain >= 0 && domain < domain_count && type >= 0 && type < value_types,
            "an attribute has an unknown kind");
    require(values.ndim() == 1 || values.ndim() == 2, "values must have one or two dimensions");
    view_of.domain = static_cast<Domain>(domain);
    view_of.type = static_cast<ValueType>(type);
    require(static_cast<i64>(values.itemsize()) == bytes_of(view_of.type),
            "values have another type than the attribute");
    view_of.rows = static_cast<i64>(values.shape(0));
    view_of.columns = values.ndim() == 2 ? static_cast<i64>(values.shape(1)) + 1 : 0;
    view_of.values = {static_cast<const u8 *>(values.data()), values.nbytes()};
    if (!attribute[4].is_none()) {
        view_of.indices = view(nb::cast<Flat<i32>>(attribute[4]));
        for (const i32 row : *view_of.indices) {
            if (row < -1 || row >= view_of.rows) throw nb::index_error("an index of an attribute is out of range");
        }
    }
    view_of.labels = nb::cast<std::vector<std::string>>(attribute[5]);
    return view_of;
}

void check_rows(const AttributeView &attribute, const ConnectivityView &part) {
    const std::size_t rows = attribute.indices ? attribute.indices->size() : static_cast<std::size_t>(attribute.rows);
    const bool fits =
        attribute.domain == Domain::object || rows == static_cast<std::size_t>(element_count(attribute.domain, part));
    require(fits, "rows of an attribute do not fit its domain");
}

nb::bytes py_encode_attributes(const nb::list &parts, const nb::list &attributes, const Rows<i64, 3> &grid,
                               std::optional<double> uv_tolerance, bool keeps_rows) {
    const std::vector<ConnectivityView> views = views_of(parts);
    const std::span<const GridPoint> points = grid_of(grid, views);
    require(attributes.size() == views.size(), "attributes do not fit the parts");
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
        data = encode_attributes(attributed, points, {uv_tolerance, keeps_rows});
    }
    return to_bytes(data);
}

nb::object py_fan_numbers(const Flat<i32> &vertices, const Flat<i32> &keys) {
    require(vertices.size() == keys.size(), "keys do not fit the corners");
    for (const i32 vertex : view(vertices)) {
        if (vertex < 0) throw nb::index_error("a vertex number is negative");
    }
    std::vector<i32> found;
    {
        nb::gil_scoped_release release;
        found = fan_numbers(view(vertices), view(keys));
    }
    return to_array(std::move(found));
}

}  // namespace

void bind_mesh(nb::module_ &module) {
    add_tuple(module, "CodedConnectivity", "conn ordr");
    add_tuple(module, "CodedOrder", "vertices faces corners");
    add_tuple(module, "CodedReference", "predictor data");
    add_tuple(module, "Curves", "order starts");
    add_tuple(module, "Smoothing", "weights points grid error_ratio");
    module.def("encode_description", &py_encode_description, nb::arg("times"), nb::arg("names"));
    module.def("encode_connectivity", &py_encode_connectivity, nb::arg("parts"), nb::arg("keep_order"));
    module.def("encode_cells", &py_encode_cells, nb::arg("parts"));
    module.def("inner_sides", &py_inner_sides, nb::arg("parts"));
    module.def("coded_orders", &py_coded_orders, nb::arg("parts"));
    module.def("extract_curves", &py_extract_curves, nb::arg("parts"), nb::arg("reference"));
    module.def("encode_reference", &py_encode_reference, nb::arg("starts"), nb::arg("vertex"), nb::arg("faces"),
               nb::arg("grid"), nb::arg("weights").none(), nb::arg("points"), nb::arg("ties"));
    module.def("smooth_reference", &py_smooth_reference, nb::arg("starts"), nb::arg("vertex"), nb::arg("faces"),
               nb::arg("grid"), nb::arg("wanted"), nb::arg("ties"));
    module.def("decode_reference", &py_decode_reference, nb::arg("starts"), nb::arg("vertex"), nb::arg("faces"),
               nb::arg("vertices"), nb::arg("predictor"), nb::arg("data"));
    module.def("encode_attributes", &py_encode_attributes, nb::arg("parts"), nb::arg("attributes"), nb::arg("grid"),
               nb::arg("uv_tolerance").none(), nb::arg("keeps_rows"));
    module.def("fan_numbers", &py_fan_numbers, nb::arg("vertices"), nb::arg("keys"));
}

}  // namespace pdeanim::bindings
