// Python's view of what encoding loops over: displacements, quantisation, what a model leaves of the input.
#include <nanobind/stl/optional.h>

#include <optional>

#include "bindings/bindings.hpp"
#include "encode/displacements.hpp"
#include "encode/group_model.hpp"
#include "encode/quantise.hpp"

namespace pdeanim::bindings {

namespace {

template <class T> using Cube = nb::ndarray<T, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
template <class T> using Matrix = nb::ndarray<T, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

void require(bool holds, const char *message) {
    if (!holds) throw nb::value_error(message);
}

template <class T> std::span<T> all_of(const Cube<T> &array) { return {array.data(), array.size()}; }

template <class Real> double py_take_displacements(const Cube<const float> &points, const Rows<double, 3> &shape,
                                                   double farthest, const Matrix<Real> &rows, int threads) {
    require(points.shape(2) == 3 && points.shape(1) == shape.shape(0) && rows.shape(0) == shape.shape(0) &&
                rows.shape(1) == 3 * points.shape(0),
            "points, shape and rows must be of the same frames and vertices");
    nb::gil_scoped_release release;
    return take_displacements(all_of(points), std::span<const double>(shape.data(), shape.size()), farthest,
                              std::span<Real>(rows.data(), rows.size()), threads);
}

nb::tuple py_quantise_sparsely(const Matrix<const double> &values, int axes, double step, double round_up_at,
                               double round_up_alone_at, int threads) {
    require(step > 0.0 && (axes == 1 || axes == 3), "a step is positive, and axes are 1 or 3");
    Quantised found;
    {
        nb::gil_scoped_release release;
        found = quantise_sparsely({values.data(), values.size()}, static_cast<i64>(values.shape(1)), axes, step,
                                  {round_up_at, round_up_alone_at}, threads);
    }
    const std::size_t rows = values.shape(0), channels = values.shape(1);
    auto *kept = new std::vector<i64>(std::move(found.coefficients));
    nb::capsule owner(kept, [](void *pointer) noexcept { delete static_cast<std::vector<i64> *>(pointer); });
    return nb::make_tuple(nb::cast(nb::ndarray<nb::numpy, i64, nb::ndim<2>>(kept->data(), {rows, channels}, owner)),
                          to_array(std::move(found.largest)));
}

// A group's model with the input that it is held against, and the arrays that both look at.
template <class T> class PyGroupModel {
public:
    PyGroupModel(Cube<const T> time, Cube<const T> fields, Rows<double, 3> reference, Cube<const float> points,
                 Flat<i32> order, double bound, double step)
        : time_(std::move(time)), fields_(std::move(fields)), reference_(std::move(reference)),
          points_(std::move(points)), order_(std::move(order)) {
        const std::size_t frames = points_.shape(0), vertices = reference_.shape(0);
        require(time_.shape(0) == frames && time_.shape(1) == 3 && fields_.shape(0) == time_.shape(2) &&
                    (fields_.shape(1) == 1 || fields_.shape(1) == 3) && fields_.shape(2) == vertices &&
                    points_.shape(1) == vertices && points_.shape(2) == 3 && order_.size() == vertices,
                "functions of time, fields, reference frame, points and order do not fit together");
        for (const i32 vertex : view(order_)) {
            require(vertex >= 0 && static_cast<std::size_t>(vertex) < vertices,
                    "an order must be of the vertices that there are");
        }
        model = {.time = all_of(time_),
                 .fields = {all_of(fields_), static_cast<i64>(fields_.shape(0)), static_cast<i64>(fields_.shape(1)),
                            static_cast<i64>(vertices)},
                 .reference = {reference_.data(), reference_.size()},
                 .frames = static_cast<i64>(frames)};
        wanted = {.points = {reinterpret_cast<const Position *>(points_.data()), points_.size() / 3},
                  .order = view(order_),
                  .bound = bound,
                  .step = step};
    }

    Residuals missing(const Flat<double> &margins, const std::optional<nb::tuple> &aim, Excess *excess, int threads) {
        require(static_cast<i64>(margins.size()) == model.frames, "one margin a frame");
        Aim beyond{};
        if (aim) beyond = {nb::cast<double>((*aim)[0]), nb::cast<double>((*aim)[1]), nb::cast<double>((*aim)[2])};
        nb::gil_scoped_release release;
        return pdeanim::missing(model, wanted, view(margins), beyond, excess, threads);
    }

    nb::tuple errors(const Residuals &residuals, int threads) const {
        require(residuals.frames() == model.frames, "residuals are of other frames");
        check_residuals(residuals, model.fields.vertices);
        Errors found;
        {
            nb::gil_scoped_release release;
            found = pdeanim::errors(model, wanted, residuals, threads);
        }
        return nb::make_tuple(found.largest_square, found.sum_of_squares);
    }

    GroupModel<T> model;
    Wanted wanted;

private:
    Cube<const T> time_, fields_;
    Rows<double, 3> reference_;
    Cube<const float> points_;
    Flat<i32> order_;
};

double py_farthest_apart(const PyGroupModel<float> &single, const PyGroupModel<double> &exact, int threads) {
    require(single.model.frames == exact.model.frames && single.model.fields.vertices == exact.model.fields.vertices,
            "two models of the same frames and vertices");
    nb::gil_scoped_release release;
    return farthest_apart(single.model, exact.model, threads);
}

void py_add_to(const Excess &excess, const Matrix<double> &values, const Matrix<const double> &functions, int axes,
               double push) {
    const std::size_t count = functions.shape(1);
    require(axes == 1 || axes == 3, "axes are 1 or 3");
    require(values.shape(1) == count * axes, "one value a function, on each axis");
    for (std::size_t k = 0; k < excess.frames.size(); ++k) {
        const std::size_t row = axes == 1 ? 3 * excess.frames[k] + 2 : excess.frames[k];
        require(row < functions.shape(0) && static_cast<std::size_t>(excess.vertices[k]) < values.shape(0),
                "an excess of other frames or vertices");
    }
    nb::gil_scoped_release release;
    excess.add_to({values.data(), values.size()}, {functions.data(), functions.size()}, static_cast<i64>(count), axes,
                  push);
}

template <class T> void bind_model(nb::module_ &module, const char *name) {
    using Model = PyGroupModel<T>;
    nb::class_<Model>(module, name, "Functions of time and fields of a group, held against its positions.")
        .def(nb::init<Cube<const T>, Cube<const T>, Rows<double, 3>, Cube<const float>, Flat<i32>, double, double>(),
             nb::arg("time").noconvert(), nb::arg("fields").noconvert(), nb::arg("reference").noconvert(),
             nb::arg("points").noconvert(), nb::arg("order").noconvert(), nb::arg("bound"), nb::arg("step"))
        .def("missing", &Model::missing, nb::arg("margins"), nb::arg("aim").none(), nb::arg("excess").none(),
             nb::arg("threads"))
        .def("errors", &Model::errors, nb::arg("residuals"), nb::arg("threads"));
}

template <class Real> void bind_take(nb::module_ &module) {
    module.def("take_displacements", &py_take_displacements<Real>, nb::arg("points").noconvert(), nb::arg("shape"),
               nb::arg("farthest"), nb::arg("rows").noconvert(), nb::arg("threads"),
               "Write rows (vertices, 3 frames) of points less a shape; returns the largest magnitude.");
}

}  // namespace

void bind_encode(nb::module_ &module) {
    bind_take<float>(module);
    bind_take<double>(module);
    module.def("quantise_sparsely", &py_quantise_sparsely, nb::arg("values"), nb::arg("axes"), nb::arg("step"),
               nb::arg("round_up_at"), nb::arg("round_up_alone_at"), nb::arg("threads"));
    nb::class_<Excess>(module, "Excess", "By how much vertices are off beyond what is aimed at.")
        .def(nb::init<>())
        .def("__len__", [](const Excess &self) { return self.frames.size(); })
        .def("add_to", &py_add_to, nb::arg("values").noconvert(), nb::arg("functions"), nb::arg("axes"),
             nb::arg("push"));
    bind_model<float>(module, "SingleModel");
    bind_model<double>(module, "DoubleModel");
    module.def("farthest_apart", &py_farthest_apart, nb::arg("single"), nb::arg("exact"), nb::arg("threads"));
}

}  // namespace pdeanim::bindings
