// Python's view of the spline between frames.
#include "bindings/python/bindings.hpp"
#include "decode/evaluate/spline.hpp"

namespace pdeanim::bindings {

namespace {

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
    nb::class_<FrameSpline>(module, "FrameSpline",
                            "The C2 cubic spline through all frames of a clip, not-a-knot, as weights of frames.")
        .def(nb::new_(&spline_of), nb::arg("times"))
        .def_prop_ro("width", &FrameSpline::width, "Frames in a window.")
        .def("weights", &py_weights, nb::arg("times"), nb::arg("derivative") = 0,
             "First frame of each time's window, int64, and weights of the frames in it, (times, width) float64.");
}

}  // namespace pdeanim::bindings
