// Python's view of the coded stream of section SEQN.
#include "sections/description/description.hpp"

#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include "bindings/python/bindings.hpp"

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

}  // namespace

void bind_description(nb::module_ &module) {
    module.def("encode_description", &py_encode_description, nb::arg("times"), nb::arg("names"),
               "Coded stream of section SEQN: listed times, float64 [s], and names of objects.");
}

}  // namespace pdeanim::bindings
