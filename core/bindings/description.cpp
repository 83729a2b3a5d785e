// Python's view of the coded stream of section SEQN.
#include "description/description.hpp"

#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include "bindings/bindings.hpp"

namespace pdeanim::bindings {

namespace {

nb::bytes py_encode_description(const Flat<double> &times, const std::vector<std::string> &names) {
    std::vector<u8> data;
    {
        nb::gil_scoped_release release;
        data = encode_description(view(times), names);
    }
    return to_bytes(data);
}

nb::object py_decode_times(const nb::bytes &data, i64 times) {
    std::vector<double> found;
    {
        nb::gil_scoped_release release;
        found = decode_times(view(data), times);
    }
    return to_array(std::move(found));
}

// The lock is held: memory is counted by Python.
std::vector<std::string> py_decode_names(const nb::bytes &data, i64 times, i64 objects, const nb::callable &take) {
    return decode_names(view(data), times, objects, [&](i64 size) { take(size); });
}

}  // namespace

void bind_description(nb::module_ &module) {
    module.def("encode_description", &py_encode_description, nb::arg("times"), nb::arg("names"),
               "Coded stream of section SEQN: listed times, float64 [s], and names of objects.");
    module.def("decode_times", &py_decode_times, nb::arg("data"), nb::arg("times"),
               "So many listed times, float64 [s].");
    module.def("decode_names", &py_decode_names, nb::arg("data"), nb::arg("times"), nb::arg("objects"), nb::arg("take"),
               "Names of so many objects after so many times; `take` is called with bytes before memory is taken.");
}

}  // namespace pdeanim::bindings
