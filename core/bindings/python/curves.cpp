// Python's view of the curves of a mesh.
#include "mesh/curves.hpp"
#include "bindings/python/bindings.hpp"

namespace pdeanim::bindings {

namespace {

nb::tuple py_extract_curves(const nb::list &parts, const Rows<i64, 3> &reference) {
    const std::vector<ConnectivityView> views = views_of(parts);
    i64 vertices = 0;
    for (const ConnectivityView &view : views) vertices += view.vertices;
    if (vertices != static_cast<i64>(reference.shape(0))) throw nb::value_error("one grid point a vertex is needed");
    Curves found;
    {
        nb::gil_scoped_release release;
        found = extract_curves(views, {reinterpret_cast<const GridPoint *>(reference.data()), reference.shape(0)});
    }
    return nb::make_tuple(to_array(std::move(found.order)), to_array(std::move(found.starts)));
}

}  // namespace

void bind_curves(nb::module_ &module) {
    module.def("extract_curves", &py_extract_curves, nb::arg("parts"), nb::arg("reference"),
               "Vertices of all curves, int32, and where in them each curve begins, int64.");
}

}  // namespace pdeanim::bindings
