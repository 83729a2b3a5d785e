// Python's view of sections CONN and ORDR.
#include "sections/connectivity/connectivity.hpp"
#include "bindings/python/bindings.hpp"

namespace pdeanim::bindings {

namespace {

// Whether sizes, each `smallest` or more, add up to the indices, and these are of so many vertices.
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
        views.push_back({nb::cast<i64>(fields[0]), view(nb::cast<Flat<i32>>(fields[1])),
                         view(nb::cast<Flat<i32>>(fields[2])), view(nb::cast<Flat<i32>>(fields[3])),
                         view(nb::cast<Flat<i32>>(fields[4]))});
        const ConnectivityView &own = views.back();
        if (own.vertices < 0 || !fit_together(own.face_sizes, 3, own.face_indices, own.vertices) ||
            !fit_together(own.line_sizes, 1, own.line_indices, own.vertices)) {
            throw nb::value_error("counts and indices of faces or lines do not fit together");
        }
    }
    return views;
}

namespace {

nb::tuple py_encode_connectivity(const nb::list &parts, bool keep_order) {
    const std::vector<ConnectivityView> views = views_of(parts);
    std::pair<std::vector<u8>, std::vector<u8>> sections;
    {
        nb::gil_scoped_release release;
        sections = encode_connectivity(views, keep_order);
    }
    return nb::make_tuple(to_bytes(sections.first), to_bytes(sections.second));
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
            found.append(nb::make_tuple(to_array(std::move(order.vertices)), to_array(std::move(order.faces)),
                                        to_array(std::move(order.corners))));
        }
    }
    return found;
}

nb::list py_decode_connectivity(const nb::bytes &conn, const nb::bytes &ordr, const nb::list &vertices,
                                i64 most_corners) {
    std::vector<i64> counts;
    for (const nb::handle count : vertices) counts.push_back(nb::cast<i64>(count));
    std::vector<Connectivity> parts;
    {
        nb::gil_scoped_release release;
        parts = decode_connectivity(view(conn), view(ordr), counts, most_corners);
    }
    nb::list found;
    for (Connectivity &part : parts) {
        found.append(nb::make_tuple(to_array(std::move(part.face_sizes)), to_array(std::move(part.face_indices)),
                                    to_array(std::move(part.line_sizes)), to_array(std::move(part.line_indices))));
    }
    return found;
}

}  // namespace

void bind_connectivity(nb::module_ &module) {
    module.def(
        "encode_connectivity", &py_encode_connectivity, nb::arg("parts"), nb::arg("keep_order"),
        "Streams of CONN and ORDR of parts (vertices, face sizes, face indices, line sizes, line indices), int32.");
    module.def("coded_orders", &py_coded_orders, nb::arg("parts"),
               "Of each part, the source's number of each vertex, face and corner in the order of coding, or None.");
    module.def("decode_connectivity", &py_decode_connectivity, nb::arg("conn"), nb::arg("ordr"), nb::arg("vertices"),
               nb::arg("most_corners"), "The arrays of each part, in the order that encode_connectivity takes them.");
}

}  // namespace pdeanim::bindings
