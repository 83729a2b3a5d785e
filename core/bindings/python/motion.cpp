// Sections of motion, as an encoder writes them: functions of time (TIME), coefficients (COEF), residuals (CORR).
#include <nanobind/stl/optional.h>

#include <algorithm>
#include <array>
#include <stdexcept>

#include "base/errors.hpp"
#include "bindings/python/bindings.hpp"
#include "sections/coefficients/coefficients.hpp"
#include "sections/residuals/residuals.hpp"
#include "sections/temporal/time_functions.hpp"

namespace pdeanim::bindings {

namespace {

// Functions of time: an array of shape (functions, frames, axes).
template <class T> using Functions = nb::ndarray<const T, nb::ndim<3>, nb::c_contig, nb::device::cpu>;

template <class T> std::span<const T> numbers_of(const Functions<T> &array) { return {array.data(), array.size()}; }

template <class T> TimeShape shape_of(const Functions<T> &array) {
    const TimeShape shape{static_cast<i64>(array.shape(0)), static_cast<i64>(array.shape(1)),
                          static_cast<i64>(array.shape(2))};
    shape.check();
    return shape;
}

TimeMethod method_of(u8 method) {
    if (method > static_cast<u8>(TimeMethod::straight)) throw std::invalid_argument("the method must be 0 to 2");
    return TimeMethod{method};
}

// Turn values into an array of three dimensions that owns them.
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

nb::object py_quantise_predicted(const Functions<double> &wanted, double rounding, double step) {
    const TimeShape shape = shape_of(wanted);
    QuantisedTimeFunctions found;
    {
        nb::gil_scoped_release release;
        found = quantise_predicted(shape, numbers_of(wanted), rounding, step);
    }
    return named("PredictedFunctions", to_block(std::move(found.quantised), shape.functions, shape.frames, shape.axes),
                 to_values(std::move(found.values), shape));
}

nb::object py_quantise_straight(const Functions<double> &wanted, double tolerance) {
    const TimeShape shape = shape_of(wanted);
    if (shape.frames == 0) throw std::invalid_argument("there must be at least one frame");
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

nb::object py_cosine_wave(i64 frames) {
    if (frames < 1) throw std::invalid_argument("there must be at least one frame");
    return to_array(cosine_wave(frames));
}

template <class T> using Grid = nb::ndarray<T, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

template <class T> CoefficientLayout layout_of(const Grid<T> &coefficients, const Flat<i64> &starts,
                                               const Flat<i64> &kinds, const Flat<i64> &parents, int axes) {
    return {.subbands = {view(starts), view(kinds), view(parents)},
            .rows = static_cast<i64>(coefficients.shape(0)),
            .channels = static_cast<i64>(coefficients.shape(1)),
            .axes = axes};
}

nb::bytes py_encode_coefficients(const Grid<const i64> &coefficients, const Flat<i64> &starts, const Flat<i64> &kinds,
                                 const Flat<i64> &parents, int axes) {
    std::vector<u8> data;
    {
        nb::gil_scoped_release release;
        data = encode_coefficients(layout_of(coefficients, starts, kinds, parents, axes),
                                   {coefficients.data(), coefficients.size()});
    }
    return to_bytes(data);
}

double py_measure_coefficients(const Grid<const i64> &coefficients, const Flat<i64> &starts, const Flat<i64> &kinds,
                               const Flat<i64> &parents, int axes, const std::optional<Flat<double>> &copies) {
    nb::gil_scoped_release release;
    return measure_coefficients(layout_of(coefficients, starts, kinds, parents, axes),
                                {coefficients.data(), coefficients.size()},
                                copies ? view(*copies) : std::span<const double>());
}

template <class T, class Array> std::span<const std::array<T, 3>> rows_of(const Array &array) {
    return {reinterpret_cast<const std::array<T, 3> *>(array.data()), array.size() / 3};
}

// Return a read-only array that views a vector within `owner`, and keeps `owner` alive.
template <class T> nb::object look_into(const std::vector<T> &values, nb::handle owner) {
    return nb::cast(nb::ndarray<nb::numpy, const T, nb::ndim<1>>(values.data(), {values.size()}, owner));
}

template <class T> nb::object look_into(const std::vector<std::array<T, 3>> &values, nb::handle owner) {
    const T *first = reinterpret_cast<const T *>(values.data());
    return nb::cast(nb::ndarray<nb::numpy, const T, nb::ndim<2>>(first, {values.size(), 3}, owner));
}

template <class T> std::vector<T> copy_of(std::span<const T> values) { return {values.begin(), values.end()}; }

constexpr i64 most_vertices = i64{1} << 31;

void make(Residuals *residuals, const Flat<i64> &frame_starts, const Flat<i32> &places, const Rows<i64, 3> &quantised,
          const Flat<i64> &raw_frame_starts, const Flat<i32> &raw_places, const Rows<float, 3> &raw_positions) {
    Residuals found{copy_of(view(frame_starts)),     copy_of(view(places)),     copy_of(rows_of<i64>(quantised)),
                    copy_of(view(raw_frame_starts)), copy_of(view(raw_places)), copy_of(rows_of<float>(raw_positions))};
    check_residuals(found, most_vertices);
    new (residuals) Residuals(std::move(found));
}

std::span<const i64> patches_of(const Flat<i64> &starts) {
    const std::span<const i64> patches = view(starts);
    if (patches.empty() || patches.front() != 0 || !std::is_sorted(patches.begin(), patches.end()) ||
        patches.back() > most_vertices) {
        throw ArgumentError("patches must start at 0 and ascend to the number of vertices");
    }
    return patches;
}

ResidualCoding coding_of(const Residuals &residuals, bool is_predicted, const Flat<i64> &distances) {
    const std::span<const i64> found = view(distances);
    bool is_sound = static_cast<i64>(found.size()) == residuals.frames();
    for (std::size_t frame = 0; is_sound && frame < found.size(); ++frame) {
        is_sound = found[frame] >= 1 && found[frame] <= most<i64>(static_cast<i64>(frame), 1);
    }
    if (!is_sound) throw ArgumentError("the reference of each frame must be an earlier frame");
    return {is_predicted, found};
}

double py_measure(const Residuals &residuals, const Flat<i64> &starts, bool is_predicted, const Flat<i64> &distances,
                  double copies) {
    nb::gil_scoped_release release;
    const std::span<const i64> patches = patches_of(starts);
    check_residuals(residuals, patches.back());
    return measure_residuals(residuals, patches, coding_of(residuals, is_predicted, distances), copies);
}

nb::bytes py_encode(const Residuals &residuals, const Flat<i64> &starts, bool is_predicted,
                    const Flat<i64> &distances) {
    std::vector<u8> data;
    {
        nb::gil_scoped_release release;
        const std::span<const i64> patches = patches_of(starts);
        check_residuals(residuals, patches.back());
        data = encode_residuals(residuals, patches, coding_of(residuals, is_predicted, distances));
    }
    return to_bytes(data);
}

nb::object py_reference_distances(const Residuals &residuals) {
    std::vector<i64> distances;
    {
        nb::gil_scoped_release release;
        distances = reference_distances(residuals);
    }
    return to_array(std::move(distances));
}

// Return a vector of the residuals as a read-only array: the getter of a property.
template <auto values> nb::object look(nb::handle self) {
    return look_into(nb::cast<const Residuals &>(self).*values, self);
}

}  // namespace

void bind_motion(nb::module_ &module) {
    add_tuple(module, "PredictedFunctions", "quantised decoded");
    module.def("quantise_predicted", &py_quantise_predicted, nb::arg("wanted"), nb::arg("rounding"), nb::arg("step"));
    module.def("quantise_straight", &py_quantise_straight, nb::arg("wanted"), nb::arg("tolerance"));
    module.def("time_function_values", &py_time_function_values, nb::arg("method"), nb::arg("quantised"),
               nb::arg("step"));
    module.def("encode_time_functions", &py_encode_time_functions, nb::arg("method"), nb::arg("quantised"));
    module.def("measure_time_functions", &py_measure_time_functions, nb::arg("quantised"));
    module.def("cosine_wave", &py_cosine_wave, nb::arg("frames"));
    module.def("encode_coefficients", &py_encode_coefficients, nb::arg("coefficients"), nb::arg("starts"),
               nb::arg("kinds"), nb::arg("parents"), nb::arg("axes"));
    module.def("measure_coefficients", &py_measure_coefficients, nb::arg("coefficients"), nb::arg("starts"),
               nb::arg("kinds"), nb::arg("parents"), nb::arg("axes"), nb::arg("copies") = nb::none());
    nb::class_<Residuals>(module, "Residuals")
        .def("__init__", &make, nb::arg("frame_starts"), nb::arg("places"), nb::arg("quantised"),
             nb::arg("raw_frame_starts"), nb::arg("raw_places"), nb::arg("raw_positions"))
        .def_prop_ro("frame_starts", &look<&Residuals::frame_starts>)
        .def_prop_ro("places", &look<&Residuals::places>)
        .def_prop_ro("quantised", &look<&Residuals::quantised>)
        .def_prop_ro("raw_frame_starts", &look<&Residuals::raw_frame_starts>)
        .def_prop_ro("raw_places", &look<&Residuals::raw_places>)
        .def_prop_ro("raw_positions", &look<&Residuals::raw_positions>)
        .def_prop_ro("frames", &Residuals::frames)
        .def_prop_ro("count", &Residuals::count)
        .def_prop_ro("nbytes", &Residuals::bytes);
    module.def("reference_distances", &py_reference_distances, nb::arg("residuals"));
    module.def("measure_residuals", &py_measure, nb::arg("residuals"), nb::arg("patches"), nb::arg("is_predicted"),
               nb::arg("distances"), nb::arg("copies") = 1.0);
    module.def("encode_residuals", &py_encode, nb::arg("residuals"), nb::arg("patches"), nb::arg("is_predicted"),
               nb::arg("distances"));
}

}  // namespace pdeanim::bindings
