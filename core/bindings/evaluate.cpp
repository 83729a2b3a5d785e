// Python's view of evaluation: positions at frames, displacements between them, and the spline.
#include "bindings/bindings.hpp"
#include "evaluate/fields.hpp"
#include "evaluate/spline.hpp"

namespace pdeanim::bindings {

namespace {

template <class T> using Cube = nb::ndarray<T, nb::ndim<3>, nb::c_contig, nb::device::cpu>;

template <class T> std::span<T> all_of(const Cube<T> &array) { return {array.data(), array.size()}; }

// (functions, 1 or 3, vertices) as fields; ValueError unless they fit (times, 3, functions) and the vertices.
template <class T>
Fields<T> fields_of(const Cube<const T> &fields, std::size_t functions, std::size_t axes, std::size_t vertices) {
    if (fields.shape(0) != functions || axes != 3 || (fields.shape(1) != 1 && fields.shape(1) != 3) ||
        fields.shape(2) != vertices) {
        throw nb::value_error("functions of time, fields and vertices do not fit together");
    }
    return {all_of(fields), static_cast<i64>(functions), static_cast<i64>(fields.shape(1)), static_cast<i64>(vertices)};
}

template <class T, class Out> void py_evaluate_frames(const Cube<const T> &time, const Cube<const T> &fields,
                                                      const Rows<double, 3> &reference, const Cube<Out> &out) {
    const Fields<T> checked = fields_of(fields, time.shape(2), time.shape(1), reference.shape(0));
    if (out.shape(0) != time.shape(0) || out.shape(1) != reference.shape(0) || out.shape(2) != 3) {
        throw nb::value_error("positions have another shape than the frames and the reference frame give");
    }
    nb::gil_scoped_release release;
    evaluate_frames(all_of(time), checked, std::span<const double>(reference.data(), reference.size()), all_of(out));
}

template <class T>
void py_add_displacement(const nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu> &weights,
                         const Cube<const T> &fields,
                         const nb::ndarray<double, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu> &moved) {
    const Fields<T> checked = fields_of(fields, weights.shape(1), weights.shape(0), moved.shape(0));
    nb::gil_scoped_release release;
    add_displacement(std::span<const double>(weights.data(), weights.size()), checked,
                     std::span<double>(moved.data(), moved.size()));
}

template <class T, class Out> void bind_evaluate_frames(nb::module_ &module) {
    module.def("evaluate_frames", &py_evaluate_frames<T, Out>, nb::arg("time").noconvert(),
               nb::arg("fields").noconvert(), nb::arg("reference").noconvert(), nb::arg("out").noconvert(),
               "Write positions, (frames, vertices, 3): reference (vertices, 3) + time (frames, 3, functions) times "
               "fields (functions, 1 or 3, vertices).");
}

template <class T> void bind_add_displacement(nb::module_ &module) {
    module.def("add_displacement", &py_add_displacement<T>, nb::arg("weights"), nb::arg("fields").noconvert(),
               nb::arg("moved").noconvert(),
               "Add weights (3, functions) times fields (functions, 1 or 3, vertices) to moved (vertices, 3).");
}

FrameSpline spline_of(const Flat<double> &times) {
    if (times.size() == 0) throw nb::value_error("a spline needs a frame");
    return FrameSpline({times.data(), times.data() + times.size()});
}

nb::tuple py_weights(const FrameSpline &spline, const Flat<double> &times, int derivative) {
    if (derivative < 0 || derivative > 2) throw nb::value_error("derivatives are 0, 1 and 2");
    const std::size_t count = times.size(), width = static_cast<std::size_t>(spline.width());
    std::vector<i64> firsts(count);
    std::vector<double> weights(count * width);
    {
        nb::gil_scoped_release release;
        for (std::size_t k = 0; k < count; ++k) {
            firsts[k] = spline.weights(times.data()[k], derivative, std::span(weights).subspan(k * width, width));
        }
    }
    return nb::make_tuple(to_array(std::move(firsts)), to_rows(std::move(weights), width));
}

}  // namespace

void bind_evaluate(nb::module_ &module) {
    module.attr("FRAMES_AT_ONCE") = frames_at_once;
    bind_evaluate_frames<float, float>(module);
    bind_evaluate_frames<float, double>(module);
    bind_evaluate_frames<double, float>(module);
    bind_evaluate_frames<double, double>(module);
    bind_add_displacement<float>(module);
    bind_add_displacement<double>(module);
    nb::class_<FrameSpline>(module, "FrameSpline",
                            "The C2 cubic spline through all frames of a clip, not-a-knot, as weights of frames.")
        .def(nb::new_(&spline_of), nb::arg("times"))
        .def_prop_ro("width", &FrameSpline::width, "Frames in a window.")
        .def("weights", &py_weights, nb::arg("times"), nb::arg("derivative") = 0,
             "First frame of each time's window, int64, and weights of the frames in it, (times, width) float64.");
}

}  // namespace pdeanim::bindings
