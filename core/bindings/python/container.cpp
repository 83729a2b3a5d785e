// Python's view of the container: its sections, each checked when it is read.
#include "decode/container.hpp"

#include <nanobind/stl/string.h>

#include <memory>

#include "bindings/python/bindings.hpp"

namespace pdeanim::bindings {

namespace {

class PyContainer {
public:
    explicit PyContainer(nb::bytes data) : data_(std::move(data)), source_(view(data_)), container_(source_) {}

    const Container &container() const { return container_; }

private:
    nb::bytes data_;
    MemorySource source_;
    Container container_;
};

nb::list sections(const PyContainer &self) {
    nb::list found;
    for (const SectionEntry &entry : self.container().entries()) {
        found.append(nb::make_tuple(entry.type, entry.is_required, entry.offset, entry.length));
    }
    return found;
}

}  // namespace

void bind_container(nb::module_ &module) {
    nb::class_<PyContainer>(module, "Container")
        .def(nb::init<nb::bytes>(), nb::arg("data"))
        .def_prop_ro("sections", &sections)
        .def("check_known", [](const PyContainer &self) { self.container().check_known(); })
        .def(
            "read",
            [](const PyContainer &self, const std::string &type) { return to_bytes(self.container().read(type)); },
            nb::arg("type"))
        .def("verify", [](const PyContainer &self) { self.container().verify(); });
}

}  // namespace pdeanim::bindings
