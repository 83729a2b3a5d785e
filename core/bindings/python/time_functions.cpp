// Python's view of section TIME.
#include "sections/temporal/time_functions.hpp"

#include <array>
#include <stdexcept>

#include "bindings/python/bindings.hpp"

namespace pdeanim::bindings {

namespace {

// Functions of time one after another, in each frame after frame, axis after axis.
template <class T> using Functions = nb::ndarray<const T, nb::ndim<3>, nb::c_contig, nb::device::cpu>;

template <class T> std::span<const T> numbers_of(const Functions<T> &array) { return {array.data(), array.size()}; }

template <class T> TimeShape shape_of(const Functions<T> &array) {
    const TimeShape shape{static_cast<i64>(array.shape(0)), static_cast<i64>(array.shape(1)),
                          static_cast<i64>(array.shape(2))};
    shape.check();
    return shape;
}

TimeMethod method_of(u8 method) {
    if (method > static_cast<u8>(TimeMethod::straight)) throw std::invalid_argument("a method from 0 to 2");
    return TimeMethod{method};
}

// An array of three dimensions that owns its values.
template <class T> nb::object to_block(std::vector<T> &&values, i64 first, i64 second, i64 third) {
    auto *kept = new std::vector<T>(std::move(values));
    nb::capsule owner(kept, [](void *pointer) noexcept { delete static_cast<std::vector<T> *>(pointer); });
    const std::array<std::size_t, 3> shape = {static_cast<std::size_t>(first), static_cast<std::size_t>(second),
                                              static_cast<std::size_t>(third)};
    return nb::cast(nb::ndarray<nb::numpy, T, nb::ndim<3>>(kept->data(), 3, shape.data(), owner));
}

nb::object to_values(std::vector<double> &&values, const TimeShape &shape) {
    return to_block(std::move(values), shape.frames, shape.axes, shape.functions);
}

nb::tuple py_quantise_predicted(const Functions<double> &wanted, double rounding, double step) {
    const TimeShape shape = shape_of(wanted);
    QuantisedTimeFunctions found;
    {
        nb::gil_scoped_release release;
        found = quantise_predicted(shape, numbers_of(wanted), rounding, step);
    }
    return nb::make_tuple(to_block(std::move(found.quantised), shape.functions, shape.frames, shape.axes),
                          to_values(std::move(found.values), shape));
}

nb::object py_quantise_straight(const Functions<double> &wanted, double tolerance) {
    const TimeShape shape = shape_of(wanted);
    if (shape.frames == 0) throw std::invalid_argument("a frame or more");
    std::vector<i64> quantised;
    {
        nb::gil_scoped_release release;
        quantised = quantise_straight(shape, numbers_of(wanted), tolerance);
    }
    return to_block(std::move(quantised), shape.functions, shape.frames, shape.axes);
}

nb::object py_time_function_values(u8 method, const Functions<i64> &quantised, double step) {
    const TimeShape shape = shape_of(quantised);
    const TimeMethod known = method_of(method);
    std::vector<double> values;
    {
        nb::gil_scoped_release release;
        values = time_function_values(known, shape, numbers_of(quantised), step);
    }
    return to_values(std::move(values), shape);
}

nb::bytes py_encode_time_functions(u8 method, const Functions<i64> &quantised) {
    const TimeShape shape = shape_of(quantised);
    const TimeMethod known = method_of(method);
    std::vector<u8> data;
    {
        nb::gil_scoped_release release;
        data = encode_time_functions(known, shape, numbers_of(quantised));
    }
    return to_bytes(data);
}

double py_measure_time_functions(const Functions<i64> &quantised) {
    const TimeShape shape = shape_of(quantised);
    nb::gil_scoped_release release;
    return measure_time_functions(shape, numbers_of(quantised));
}

nb::object py_decode_time_functions(const nb::bytes &data, i64 frames, i64 functions, i64 axes, double step) {
    const TimeShape shape{functions, frames, axes};
    shape.check();
    std::vector<double> values;
    {
        nb::gil_scoped_release release;
        values = decode_time_functions(view(data), shape, step);
    }
    return to_values(std::move(values), shape);
}

nb::object py_cosine_wave(i64 frames) {
    if (frames < 1) throw std::invalid_argument("a frame or more");
    return to_array(cosine_wave(frames));
}

}  // namespace

void bind_time_functions(nb::module_ &module) {
    module.def("quantise_predicted", &py_quantise_predicted, nb::arg("wanted"), nb::arg("rounding"), nb::arg("step"),
               "Of values in steps, (functions, frames, axes): the quantised ones, and what these decode to.");
    module.def("quantise_straight", &py_quantise_straight, nb::arg("wanted"), nb::arg("tolerance"),
               "Of values in steps, (functions, frames, axes): changes of speed in sixteenths of a step a frame.");
    module.def("time_function_values", &py_time_function_values, nb::arg("method"), nb::arg("quantised"),
               nb::arg("step"), "Values, (frames, axes, functions), of quantised ones, (functions, frames, axes).");
    module.def("encode_time_functions", &py_encode_time_functions, nb::arg("method"), nb::arg("quantised"),
               "The method and quantised functions of time as bytes; none where all are zero.");
    module.def("measure_time_functions", &py_measure_time_functions, nb::arg("quantised"),
               "Bits that encode_time_functions would take.");
    module.def("decode_time_functions", &py_decode_time_functions, nb::arg("data"), nb::arg("frames"),
               nb::arg("functions"), nb::arg("axes"), nb::arg("step"), "Values, (frames, axes, functions) float64.");
    module.def("cosine_wave", &py_cosine_wave, nb::arg("frames"), "cos(2 pi j / (4 frames)), (4 frames,) float64.");
}

}  // namespace pdeanim::bindings
