// Patches, space bases, and positions from coefficients.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>

#include <algorithm>
#include <functional>
#include <memory>
#include <optional>
#include <variant>

#include "base/parallel.hpp"
#include "bindings/python/bindings.hpp"
#include "sections/spatial/series.hpp"
#include "sections/spatial/space_basis.hpp"
#include "sections/spatial/still_vertices.hpp"

namespace pdeanim::bindings {

namespace {

using Grid = Rows<i64, 3>;
constexpr const char *still_differ = "the vertices that stand still belong to another mesh";
template <class Real> using Values = nb::ndarray<const Real, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Quantised = nb::ndarray<const i64, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

std::span<const GridPoint> points_of(const Grid &grid) {
    return {reinterpret_cast<const GridPoint *>(grid.data()), grid.shape(0)};
}

// Return an array that views a vector within an object of the core.
template <class T> nb::object inside(nb::handle owner, const std::vector<T> &values) {
    return nb::cast(nb::ndarray<nb::numpy, T, nb::ndim<1>>(const_cast<T *>(values.data()), {values.size()}, owner));
}

template <auto member> nb::object patches_array(nb::handle self) {
    return inside(self, nb::cast<Patches &>(self).*member);
}

std::shared_ptr<Patches> py_early_patches(const nb::list &objects, i64 points, const Flat<u8> &still) {
    require(points > 0, "patches must have points");
    const std::vector<ConnectivityView> views = views_of(objects);
    i64 vertices = 0;
    for (const ConnectivityView &object : views) vertices += object.vertices;
    require(still.size() == 0 || still.size() == static_cast<std::size_t>(vertices), still_differ);
    nb::gil_scoped_release release;
    return early_patches(views, points, view(still));
}

std::shared_ptr<Patches> py_build_patches(const nb::list &objects, const Grid &grid, i64 points, const Flat<i32> &ties,
                                          const Flat<u8> &still, const std::shared_ptr<Patches> &early) {
    require(points > 0, "patches must have points");
    const std::vector<ConnectivityView> views = views_of(objects);
    const std::span<const GridPoint> points_of_grid = grid_of(grid, views);
    require(!points_of_grid.empty(), "a mesh must have vertices");
    require(!early || early->order.size() == grid.shape(0), "the early patches belong to another mesh");
    require(ties.size() == 0 || ties.size() == grid.shape(0), "the ties belong to another mesh");
    require(still.size() == 0 || still.size() == grid.shape(0), still_differ);
    nb::gil_scoped_release release;
    return build_patches(views, points_of_grid, points, view(ties), view(still), early);
}

std::shared_ptr<Patches> py_cut_curves(const Flat<i32> &order, const Flat<i64> &starts, i64 points,
                                       const Flat<i32> &ties, const Flat<u8> &still) {
    require(ties.size() == 0 || ties.size() == order.size(), "the ties belong to another mesh");
    require(still.size() == 0 || still.size() == order.size(), still_differ);
    require(points > 0, "pieces must have points");
    const i64 vertices = static_cast<i64>(order.size());
    const auto bounds = view(starts);
    require(bounds.size() > 1 && bounds.front() == 0 && bounds.back() == vertices &&
                std::is_sorted(bounds.begin(), bounds.end()),
            "curves do not cover the vertices");
    for (const i32 vertex : view(order)) require(vertex >= 0 && vertex < vertices, "a curve has a missing vertex");
    nb::gil_scoped_release release;
    return std::make_shared<Patches>(cut_curves({order.data(), order.data() + vertices}, {bounds.begin(), bounds.end()},
                                                points, view(ties), view(still)));
}

nb::bytes py_encode_still(const Flat<u8> &still, const Flat<i64> &first_vertices) {
    const auto bounds = view(first_vertices);
    require(!bounds.empty() && bounds.front() == 0 && std::is_sorted(bounds.begin(), bounds.end()) &&
                bounds.back() == static_cast<i64>(still.size()),
            still_differ);
    return to_bytes(encode_still(view(still), bounds));
}

// Return a selection of subbands of a basis; ValueError unless the subbands exist and ascend from 0.
SpaceSelection selected(std::span<const i64> subbands, const SpaceBasis &basis) {
    const i64 count = static_cast<i64>(basis.layout().subbands().kinds.size());
    require(!subbands.empty() && subbands.front() == 0 && subbands.back() < count &&
                std::adjacent_find(subbands.begin(), subbands.end(), std::greater_equal()) == subbands.end(),
            "subbands must exist and ascend from 0");
    return SpaceSelection(basis.layout(), subbands);
}

// A space basis, and the array that it keeps a reference to.
struct PySpaceBasis {
    PySpaceBasis(int kind, i64 points, int functions, int threshold, double rate, bool affine,
                 const std::shared_ptr<Patches> &patches, Grid of_grid, const std::optional<nb::bytes> &coded,
                 int threads)
        : grid(std::move(of_grid)) {
        require(0 <= kind && kind <= 1 && functions > 0,
                "the kind of a space basis must be 0 or 1, and it must have functions");
        require(patches && patches->vertices() == static_cast<i64>(grid.shape(0)),
                "the patches belong to another mesh");
        const SpaceForm form{static_cast<SpaceKind>(kind), points, functions, threshold, rate, affine};
        std::optional<std::span<const u8>> bytes;
        if (coded) bytes = view(*coded);
        nb::gil_scoped_release release;
        if (bytes) {
            auto layout = std::make_shared<const SpaceLayout>(SpaceLayout::of_bytes(form, patches, *bytes));
            basis.emplace(std::move(layout), points_of(grid), threads);
        } else {
            basis.emplace(form, patches, points_of(grid), threads);
        }
    }

    template <class Real> nb::object project(const Values<Real> &values, int threads) {
        {
            nb::gil_scoped_release release;
            basis->make_functions(threads);
        }
        return projected(values, nullptr, threads);
    }

    template <class Real> nb::object project_some(const Values<Real> &values, const Flat<i64> &subbands, int threads) {
        const SpaceSelection selection = selected(view(subbands), *basis);
        return projected(values, &selection, threads);
    }

    template <class Real>
    nb::object projected(const Values<Real> &values, const SpaceSelection *selection, int threads) const {
        require(static_cast<i64>(values.shape(0)) == basis->vertices(), "there must be one row of values per vertex");
        LargeArray<Real> found;
        {
            nb::gil_scoped_release release;
            const std::span<const Real> all(values.data(), values.size());
            found = basis->project(all, static_cast<i64>(values.shape(1)), selection, threads);
        }
        const i64 functions = selection ? selection->functions : basis->functions();
        return to_matrix(std::move(found), static_cast<std::size_t>(functions), values.shape(1));
    }

    Grid grid;
    std::optional<SpaceBasis> basis;
};

nb::object py_subbands(const PySpaceBasis &self) {
    SubbandTable found = self.basis->layout().subbands();
    return named("Subbands", to_array(std::move(found.starts)), to_array(std::move(found.kinds)),
                 to_array(std::move(found.parents)));
}

nb::object py_functions_of(nb::handle self, i64 element) {
    SpaceBasis &basis = *nb::cast<PySpaceBasis &>(self).basis;
    require(element >= 0 && element < basis.elements().count(), "no element of this number");
    const std::span<const double> found = basis.functions_of(element);
    const std::size_t points = static_cast<std::size_t>(basis.elements().patches->size(element));
    return nb::cast(nb::ndarray<nb::numpy, double, nb::ndim<2>>(const_cast<double *>(found.data()),
                                                                {found.size() / points, points}, self));
}

template <class Real> Motion<Real> take(const SpaceBasis &basis, const Quantised &quantised, int axes, double step,
                                        std::optional<SpaceSelection> selection, int threads) {
    nb::gil_scoped_release release;
    Motion<Real> found(basis, static_cast<i64>(quantised.shape(1)) / axes, axes, step);
    if (selection) found.choose(std::move(*selection));
    std::vector<std::span<const i64>> rows;
    rows.reserve(quantised.shape(0));
    for (std::size_t row = 0; row < quantised.shape(0); ++row) {
        rows.emplace_back(quantised.data() + row * quantised.shape(1), quantised.shape(1));
    }
    found.take_tree(rows);
    in_shares(basis.elements().count(), threads, [&](i64 first, i64 end) { found.take_elements(first, end, rows); });
    found.end();
    return found;
}

void make_motion(PyMotion *made, const PySpaceBasis &of_basis, const Quantised &quantised, int axes, double step,
                 bool single, const std::optional<Flat<i64>> &subbands, int threads) {
    const SpaceBasis &basis = *of_basis.basis;
    std::optional<SpaceSelection> selection;
    if (subbands) selection.emplace(selected(view(*subbands), basis));
    const i64 functions = selection ? selection->functions : basis.functions();
    require((axes == 1 || axes == 3) && static_cast<i64>(quantised.shape(0)) == functions &&
                quantised.shape(1) % axes == 0 &&
                static_cast<i64>(quantised.shape(1)) / axes <= Motion<float>::most_functions,
            "there must be one row of coefficients per function of space");
    if (single) {
        new (made) PyMotion{take<float>(basis, quantised, axes, step, std::move(selection), threads)};
    } else {
        new (made) PyMotion{take<double>(basis, quantised, axes, step, std::move(selection), threads)};
    }
}

nb::object py_series_functions(const Flat<double> &points, double rate, int order) {
    require(order == 4 || order == 8, "the series must have order 4 or 8");
    std::vector<double> found;
    {
        nb::gil_scoped_release release;
        found = series_functions(view(points), rate, order);
    }
    return to_rows(std::move(found), static_cast<std::size_t>(order));
}

nb::object py_arc_length_parameters(const Grid &grid, const std::shared_ptr<Patches> &pieces) {
    require(pieces->vertices() == static_cast<i64>(grid.shape(0)), "the pieces belong to another mesh");
    std::vector<double> found;
    {
        nb::gil_scoped_release release;
        found = arc_length_parameters(points_of(grid), pieces->order, pieces->starts);
    }
    return to_array(std::move(found));
}

template <class Real> void bind_projections(nb::class_<PySpaceBasis> &of_space) {
    of_space.def("project", &PySpaceBasis::project<Real>, nb::arg("values").noconvert(), nb::arg("threads"))
        .def("project_some", &PySpaceBasis::project_some<Real>, nb::arg("values").noconvert(), nb::arg("subbands"),
             nb::arg("threads"));
}

}  // namespace

void bind_space(nb::module_ &module) {
    add_tuple(module, "Subbands", "starts kinds parents");
    nb::class_<Patches>(module, "Patches")
        .def_prop_ro("order", &patches_array<&Patches::order>)
        .def_prop_ro("starts", &patches_array<&Patches::starts>)
        .def_prop_ro("begins", &patches_array<&Patches::begins>)
        .def_prop_ro("children", &patches_array<&Patches::children>)
        .def_prop_ro("node_of", &patches_array<&Patches::node_of>);
    module.def("early_patches", &py_early_patches, nb::arg("objects"), nb::arg("points"), nb::arg("still"));
    module.def("build_patches", &py_build_patches, nb::arg("objects"), nb::arg("grid"), nb::arg("points"),
               nb::arg("ties"), nb::arg("still"), nb::arg("early").none());
    module.def("cut_curves", &py_cut_curves, nb::arg("order"), nb::arg("starts"), nb::arg("points"), nb::arg("ties"),
               nb::arg("still"));
    module.def("encode_still", &py_encode_still, nb::arg("still"), nb::arg("first_vertices"));
    nb::class_<PySpaceBasis> of_space(module, "SpaceBasis");
    of_space
        .def(nb::init<int, i64, int, int, double, bool, const std::shared_ptr<Patches> &, Grid,
                      const std::optional<nb::bytes> &, int>(),
             nb::arg("kind"), nb::arg("points"), nb::arg("functions"), nb::arg("threshold"), nb::arg("rate"),
             nb::arg("affine"), nb::arg("patches"), nb::arg("grid"), nb::arg("layout").none(), nb::arg("threads"))
        .def_prop_ro("functions", [](const PySpaceBasis &self) { return self.basis->functions(); })
        .def_prop_ro("coefficient_starts",
                     [](nb::handle self) {
                         return inside(self, nb::cast<PySpaceBasis &>(self).basis->layout().coefficient_starts());
                     })
        .def_prop_ro("nearest", [](const PySpaceBasis &self) { return self.basis->nearest(); })
        .def("subbands", &py_subbands)
        .def("encode_layout", [](const PySpaceBasis &self) { return to_bytes(self.basis->layout().to_bytes()); })
        .def(
            "make_functions",
            [](PySpaceBasis &self, int threads) {
                nb::gil_scoped_release release;
                self.basis->make_functions(threads);
            },
            nb::arg("threads"))
        .def("functions_of", &py_functions_of, nb::arg("element"));
    bind_projections<float>(of_space);
    bind_projections<double>(of_space);
    nb::class_<PyMotion>(module, "Motion")
        .def("__init__", &make_motion, nb::arg("basis"), nb::arg("quantised").noconvert(), nb::arg("axes"),
             nb::arg("step"), nb::arg("single"), nb::arg("subbands").none(), nb::arg("threads"),
             nb::keep_alive<1, 2>());
    module.def("series_functions", &py_series_functions, nb::arg("points"), nb::arg("rate"), nb::arg("order"));
    module.def("arc_length_parameters", &py_arc_length_parameters, nb::arg("grid"), nb::arg("pieces"));
}

}  // namespace pdeanim::bindings
