// Python's view of the core: the codecs of single sections, on numpy arrays and bytes. The interpreter lock is released
// around everything that loops.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>

#include <memory>

#include "connectivity/connectivity.hpp"
#include "errors.hpp"
#include "reference/reference.hpp"

namespace nb = nanobind;
using namespace pdeanim;

namespace {

template <class T> using Flat = nb::ndarray<const T, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

template <class T> std::span<const T> view(const Flat<T> &array) { return {array.data(), array.size()}; }

std::span<const u8> view(const nb::bytes &data) {
    return {reinterpret_cast<const u8 *>(data.data()), data.size()};
}

nb::bytes to_bytes(const std::vector<u8> &data) { return nb::bytes(data.data(), data.size()); }

template <class T> nb::object to_array(std::vector<T> &&values) {
    auto *kept = new std::vector<T>(std::move(values));
    nb::capsule owner(kept, [](void *pointer) noexcept { delete static_cast<std::vector<T> *>(pointer); });
    return nb::cast(nb::ndarray<nb::numpy, T, nb::ndim<1>>(kept->data(), {kept->size()}, owner));
}

std::vector<ConnectivityView> views_of(const nb::list &parts) {
    std::vector<ConnectivityView> views;
    for (const nb::handle part : parts) {
        const nb::tuple fields = nb::cast<nb::tuple>(part);
        views.push_back({nb::cast<i64>(fields[0]), view(nb::cast<Flat<i32>>(fields[1])),
                         view(nb::cast<Flat<i32>>(fields[2])), view(nb::cast<Flat<i32>>(fields[3])),
                         view(nb::cast<Flat<i32>>(fields[4]))});
    }
    return views;
}

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

nb::list py_decode_connectivity(const nb::bytes &conn, const nb::bytes &ordr, const nb::list &vertices, i64 most_corners) {
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

// Faces and lines of all objects, numbered through.
Polygons polygons_of(const Flat<i64> &starts, const Flat<i32> &vertex, i64 faces, i64 vertices) {
    Polygons mesh;
    mesh.starts.assign(starts.data(), starts.data() + starts.size());
    mesh.vertex.assign(vertex.data(), vertex.data() + vertex.size());
    mesh.faces = faces;
    mesh.vertices = vertices;
    return mesh;
}

using Grid = nb::ndarray<const i64, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;

nb::tuple py_encode_reference(const Flat<i64> &starts, const Flat<i32> &vertex, i64 faces, const Grid &grid) {
    CodedReference coded;
    {
        nb::gil_scoped_release release;
        const Polygons mesh = polygons_of(starts, vertex, faces, static_cast<i64>(grid.shape(0)));
        coded = encode_reference(mesh, {reinterpret_cast<const Vector *>(grid.data()), grid.shape(0)});
    }
    return nb::make_tuple(coded.kind, to_bytes(coded.data));
}

nb::object py_decode_reference(const Flat<i64> &starts, const Flat<i32> &vertex, i64 faces, i64 vertices, u8 predictor,
                               const nb::bytes &data) {
    auto kept = std::make_unique<std::vector<Vector>>();
    {
        nb::gil_scoped_release release;
        *kept = decode_reference(polygons_of(starts, vertex, faces, vertices), predictor, view(data));
    }
    const std::size_t rows = kept->size();
    i64 *first = reinterpret_cast<i64 *>(kept->data());
    nb::capsule owner(kept.release(), [](void *pointer) noexcept { delete static_cast<std::vector<Vector> *>(pointer); });
    return nb::cast(nb::ndarray<nb::numpy, i64, nb::shape<-1, 3>>(first, {rows, 3}, owner));
}

}  // namespace

NB_MODULE(_core, module) {
    module.doc() = "The native core of pdecodec.";
    nb::exception<CorruptError>(module, "CorruptError");
    nb::exception<LimitError>(module, "LimitError");
    module.def("encode_connectivity", &py_encode_connectivity, nb::arg("parts"), nb::arg("keep_order"),
               "Streams of CONN and ORDR of parts (vertices, face sizes, face indices, line sizes, line indices), int32.");
    module.def("coded_orders", &py_coded_orders, nb::arg("parts"),
               "Of each part, the source's number of each vertex, face and corner in the order of coding, or None.");
    module.def("decode_connectivity", &py_decode_connectivity, nb::arg("conn"), nb::arg("ordr"), nb::arg("vertices"),
               nb::arg("most_corners"), "The arrays of each part, in the order that encode_connectivity takes them.");
    module.def("encode_reference", &py_encode_reference, nb::arg("starts"), nb::arg("vertex"), nb::arg("faces"),
               nb::arg("grid"), "The predictor that makes them smallest, and the coded grid coordinates of section REST.");
    module.def("decode_reference", &py_decode_reference, nb::arg("starts"), nb::arg("vertex"), nb::arg("faces"),
               nb::arg("vertices"), nb::arg("predictor"), nb::arg("data"), "Grid coordinates, (vertices, 3) int64.");
}
