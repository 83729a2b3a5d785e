// Loops of the encoder: displacements, quantisation, and the vertices that a model misses.
#if defined(__linux__)
#include <malloc.h>
#endif

#include <nanobind/stl/optional.h>

#include <optional>
#include <variant>

#include "bindings/python/bindings.hpp"
#include "encode/group_model.hpp"
#include "encode/quantise.hpp"

namespace pdeanim::bindings {

namespace {

template <class T> using Cube = nb::ndarray<T, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
template <class T> using Matrix = nb::ndarray<T, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

template <class T> std::span<T> all_of(const Cube<T> &array) { return {array.data(), array.size()}; }

template <class Real> double py_take_displacements(const Cube<const float> &points, const Rows<double, 3> &shape,
                                                   double farthest, const Matrix<Real> &rows, int threads) {
    require(points.shape(2) == 3 && points.shape(1) == shape.shape(0) && rows.shape(0) == shape.shape(0) &&
                rows.shape(1) == 3 * points.shape(0),
            "points, shape and rows must have the same frames and vertices");
    nb::gil_scoped_release release;
    return take_displacements(all_of(points), std::span<const double>(shape.data(), shape.size()), farthest,
                              std::span<Real>(rows.data(), rows.size()), threads);
}

template <class Real> nb::object py_quantise_sparsely(const Matrix<const Real> &values, int axes, double step,
                                                      double round_up_at, double round_up_alone_at, int threads) {
    require(step > 0.0 && (axes == 1 || axes == 3), "the step must be positive, and axes 1 or 3");
    Quantised found;
    {
        nb::gil_scoped_release release;
        found =
            quantise_sparsely(std::span<const Real>(values.data(), values.size()), static_cast<i64>(values.shape(1)),
                              axes, step, {round_up_at, round_up_alone_at}, threads);
    }
    const std::size_t rows = values.shape(0), channels = values.shape(1);
    return named("SparseCoefficients", to_matrix(std::move(found.coefficients), rows, channels),
                 to_array(std::move(found.largest)));
}

// A model of a group, with the input that it is compared with and the arrays that both refer to.
class PyGroupModel {
public:
    PyGroupModel(const PyMotion &motion, Cube<const double> time, const Rows<double, 3> &reference,
                 Cube<const float> points, Flat<i32> order, double bound, double step)
        : motion_(motion), time_(std::move(time)), points_(std::move(points)), order_(std::move(order)) {
        const std::size_t frames = points_.shape(0);
        nb::gil_scoped_release release;
        std::visit(
            [&]<class Real>(const Motion<Real> &own) {
                require(time_.shape(0) == frames && static_cast<i64>(time_.shape(1)) == own.time_axes() &&
                            static_cast<i64>(time_.shape(2)) == own.functions &&
                            static_cast<i64>(reference.shape(0)) == own.basis->vertices() &&
                            static_cast<i64>(points_.shape(1)) == own.vertices() && points_.shape(2) == 3 &&
                            static_cast<i64>(order_.size()) <= own.vertices(),
                        "motion, functions of time, reference frame, points and order do not fit together");
                for (const i32 vertex : view(order_)) {
                    require(vertex >= 0 && vertex < own.vertices(), "the order must hold existing vertices");
                }
                reference_.emplace<AnchoredReference<Real>>(*own.basis->elements().patches,
                                                            std::span<const double>(reference.data(), reference.size()),
                                                            own.selection ? &*own.selection : nullptr);
            },
            motion.motion);
        wanted_ = {.points = {reinterpret_cast<const Position *>(points_.data()), points_.size() / 3},
                   .order = view(order_),
                   .bound = bound,
                   .step = step};
    }

    nb::object missing(const Flat<double> &margins, const std::optional<nb::tuple> &aim, Excess *excess,
                       bool has_errors, int threads) const {
        require(margins.size() == points_.shape(0), "there must be one margin per frame");
        Aim beyond{};
        if (aim) beyond = {nb::cast<double>((*aim)[0]), nb::cast<double>((*aim)[1])};
        Residuals found;
        Errors errors;
        {
            nb::gil_scoped_release release;
            found = std::visit(
                [&]<class Real>(const Motion<Real> &own) {
                    const GroupModel<Real> model{.motion = own,
                                                 .time = all_of(time_),
                                                 .reference = std::get<AnchoredReference<Real>>(reference_),
                                                 .frames = static_cast<i64>(points_.shape(0))};
                    return pdeanim::missing(model, wanted_, view(margins), beyond, excess,
                                            has_errors ? &errors : nullptr, threads);
                },
                motion_.motion);
        }
        return named("MissedVertices", std::move(found), errors.largest_square, errors.sum_of_squares);
    }

private:
    const PyMotion &motion_;
    Cube<const double> time_;
    Cube<const float> points_;
    Flat<i32> order_;
    std::variant<std::monostate, AnchoredReference<float>, AnchoredReference<double>> reference_;
    Wanted wanted_;
};

// Return the largest difference between two motions of the same vertices, over all coordinates and frames, before
// residuals.
double py_farthest_apart(const PyMotion &one, const PyMotion &other, const Cube<const double> &time,
                         const Rows<double, 3> &reference, int threads) {
    return std::visit(
        [&]<class One, class Other>(const Motion<One> &first, const Motion<Other> &second) {
            require(first.basis == second.basis && first.vertices() == second.vertices() &&
                        first.functions == second.functions && first.axes == second.axes,
                    "the two motions must have the same functions and vertices");
            require(static_cast<i64>(time.shape(1)) == first.time_axes() &&
                        static_cast<i64>(time.shape(2)) == first.functions &&
                        static_cast<i64>(reference.shape(0)) == first.basis->vertices(),
                    "motions, functions of time and reference frame do not fit together");
            nb::gil_scoped_release release;
            const auto model = [&]<class Real>(const Motion<Real> &own, const AnchoredReference<Real> &anchored) {
                return GroupModel<Real>{own, all_of(time), anchored, static_cast<i64>(time.shape(0))};
            };
            const auto anchored = [&]<class Real>(const Motion<Real> &own) {
                return AnchoredReference<Real>(*own.basis->elements().patches, {reference.data(), reference.size()},
                                               own.selection ? &*own.selection : nullptr);
            };
            const AnchoredReference<One> of_first = anchored(first);
            const AnchoredReference<Other> of_second = anchored(second);
            return farthest_apart(model(first, of_first), model(second, of_second), threads);
        },
        one.motion, other.motion);
}

template <class Real> void py_add_to(const Excess &excess, const Matrix<Real> &values,
                                     const Matrix<const double> &functions, int axes, double push) {
    const std::size_t count = functions.shape(1);
    require(axes == 1 || axes == 3, "axes must be 1 or 3");
    require(values.shape(1) == count * axes, "there must be one value per function and axis");
    for (std::size_t k = 0; k < excess.frames.size(); ++k) {
        const std::size_t row = axes == 1 ? 3 * excess.frames[k] + 2 : excess.frames[k];
        require(row < functions.shape(0) && static_cast<std::size_t>(excess.vertices[k]) < values.shape(0),
                "the excess has other frames or vertices");
    }
    nb::gil_scoped_release release;
    excess.add_to(std::span<Real>(values.data(), values.size()), {functions.data(), functions.size()},
                  static_cast<i64>(count), axes, push);
}

// Return freed memory to the system: the C library would keep much of it for later allocations.
void give_back_memory() {
#if defined(__GLIBC__)
    malloc_trim(0);
#endif
}

template <class Real> void bind_take(nb::module_ &module) {
    module.def("take_displacements", &py_take_displacements<Real>, nb::arg("points").noconvert(), nb::arg("shape"),
               nb::arg("farthest"), nb::arg("rows").noconvert(), nb::arg("threads"),
               "Write rows (vertices, 3 frames) of points minus a shape; return the largest magnitude.");
}

template <class Real> void bind_quantise(nb::module_ &module) {
    module.def("quantise_sparsely", &py_quantise_sparsely<Real>, nb::arg("values").noconvert(), nb::arg("axes"),
               nb::arg("step"), nb::arg("round_up_at"), nb::arg("round_up_alone_at"), nb::arg("threads"));
}

}  // namespace

void bind_encode(nb::module_ &module) {
    add_tuple(module, "SparseCoefficients", "coefficients largest");
    add_tuple(module, "MissedVertices", "residuals largest_square sum_of_squares");
    bind_take<float>(module);
    bind_take<double>(module);
    module.def("give_back_memory", &give_back_memory, nb::call_guard<nb::gil_scoped_release>());
    bind_quantise<float>(module);
    bind_quantise<double>(module);
    nb::class_<Excess>(module, "Excess", "By how much errors of vertices exceed their target.")
        .def(nb::init<>())
        .def("__len__", [](const Excess &self) { return self.frames.size(); })
        .def("add_to", &py_add_to<float>, nb::arg("values").noconvert(), nb::arg("functions"), nb::arg("axes"),
             nb::arg("push"))
        .def("add_to", &py_add_to<double>, nb::arg("values").noconvert(), nb::arg("functions"), nb::arg("axes"),
             nb::arg("push"));
    module.def("farthest_apart", &py_farthest_apart, nb::arg("one"), nb::arg("other"), nb::arg("time"),
               nb::arg("reference"), nb::arg("threads"));
    nb::class_<PyGroupModel>(module, "GroupModel", "A motion, compared with the input positions.")
        .def(nb::init<const PyMotion &, Cube<const double>, const Rows<double, 3> &, Cube<const float>, Flat<i32>,
                      double, double>(),
             nb::arg("motion"), nb::arg("time"), nb::arg("reference"), nb::arg("points").noconvert(),
             nb::arg("order").noconvert(), nb::arg("bound"), nb::arg("step"), nb::keep_alive<1, 2>())
        .def("missing", &PyGroupModel::missing, nb::arg("margins"), nb::arg("aim").none(), nb::arg("excess").none(),
             nb::arg("has_errors"), nb::arg("threads"));
}

}  // namespace pdeanim::bindings
