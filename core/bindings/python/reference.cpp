// Python's view of section REST.
#include <memory>

#include "bindings/python/bindings.hpp"
#include "sections/reference/reference.hpp"

namespace pdeanim::bindings {

namespace {

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
    nb::capsule owner(kept.release(),
                      [](void *pointer) noexcept { delete static_cast<std::vector<Vector> *>(pointer); });
    return nb::cast(nb::ndarray<nb::numpy, i64, nb::shape<-1, 3>>(first, {rows, 3}, owner));
}

}  // namespace

void bind_reference(nb::module_ &module) {
    module.def("encode_reference", &py_encode_reference, nb::arg("starts"), nb::arg("vertex"), nb::arg("faces"),
               nb::arg("grid"),
               "The predictor that makes them smallest, and the coded grid coordinates of section REST.");
    module.def("decode_reference", &py_decode_reference, nb::arg("starts"), nb::arg("vertex"), nb::arg("faces"),
               nb::arg("vertices"), nb::arg("predictor"), nb::arg("data"), "Grid coordinates, (vertices, 3) int64.");
}

}  // namespace pdeanim::bindings
