// Python's view of an open file.
#include "decoder/animation.hpp"

#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include "bindings/bindings.hpp"

namespace pdeanim::bindings {

namespace {

// A file that Python has opened for reading; called with the interpreter lock released.
std::unique_ptr<Source> source_of(const nb::object &file) {
    if (nb::isinstance<nb::bytes>(file)) {
        return std::make_unique<MemorySource>(view(nb::borrow<nb::bytes>(file)));
    }
    const u64 size = nb::cast<u64>(file.attr("seek")(0, 2));
    return std::make_unique<CallbackSource>(size, [file = file.ptr()](u64 offset, std::span<u8> into) {
        const nb::gil_scoped_acquire acquire;
        const nb::handle reader(file);
        reader.attr("seek")(offset);
        const nb::bytes data = nb::cast<nb::bytes>(reader.attr("read")(into.size()));
        const std::size_t count = least(data.size(), into.size());
        std::copy_n(view(data).data(), count, into.data());
        return count;
    });
}

class PyAnimation {
public:
    PyAnimation(nb::object file, u64 max_memory, int threads, i64 kept_bytes) : file_(std::move(file)) {
        std::unique_ptr<Source> source = source_of(file_);
        const nb::gil_scoped_release release;
        animation_ =
            std::make_unique<Animation>(std::move(source), Animation::Options{max_memory, threads, kept_bytes});
    }

    // Run `work` on the animation with the interpreter lock released.
    template <class Work> auto with(const Work &work) const {
        const nb::gil_scoped_release release;
        return work(*animation_);
    }

    const Animation &animation() const { return *animation_; }

private:
    nb::object file_;  // outlives the animation
    std::unique_ptr<Animation> animation_;
};

nb::list vertex_counts(const PyAnimation &self) {
    nb::list found;
    for (i64 object = 0; object < self.animation().objects(); ++object) {
        found.append(self.animation().first_vertex(object + 1) - self.animation().first_vertex(object));
    }
    return found;
}

nb::list connectivity(const PyAnimation &self) {
    const auto parts = self.with([](Animation &animation) { return animation.shared_connectivity(); });
    const nb::capsule owner = owner_of(parts);
    nb::list found;
    for (const Connectivity &part : *parts) {
        found.append(nb::make_tuple(shared_array(part.face_sizes, owner), shared_array(part.face_indices, owner),
                                    shared_array(part.line_sizes, owner), shared_array(part.line_indices, owner)));
    }
    return found;
}

nb::list attributes(const PyAnimation &self) {
    return to_list(self.with([](Animation &animation) { return animation.shared_attributes(); }));
}

nb::tuple reference(const PyAnimation &self) {
    const Reference found = self.with([](Animation &animation) { return animation.reference(); });
    std::vector<i64> grid;
    for (const GridPoint &point : found.grid) grid.insert(grid.end(), point.begin(), point.end());
    return nb::make_tuple(to_rows(std::move(grid), 3),
                          nb::make_tuple(found.origin[0], found.origin[1], found.origin[2]), found.step);
}

nb::tuple model(const PyAnimation &self) {
    const Model &own = self.animation().model();
    const SpaceForm &form = own.form;
    return nb::make_tuple(static_cast<int>(form.kind), form.points, form.functions, form.threshold, form.rate,
                          form.is_affine, own.residual_step, to_bytes(own.masks));
}

nb::list groups(const PyAnimation &self) {
    nb::list found;
    for (const Group &group : self.animation().table().groups()) {
        found.append(nb::make_tuple(group.first, group.frames, group.functions, static_cast<int>(group.basis),
                                    group.step, group.alpha));
    }
    return found;
}

nb::list sections(const PyAnimation &self) {
    nb::list found;
    for (const SectionEntry &entry : self.animation().container().entries()) {
        found.append(nb::make_tuple(entry.type, entry.offset, entry.length));
    }
    return found;
}

nb::object coefficients(const PyAnimation &self, std::size_t index) {
    const std::vector<Group> &groups = self.animation().table().groups();
    if (index >= groups.size()) throw nb::index_error("there is no such group");
    std::vector<double> found = self.with([&](Animation &animation) { return animation.coefficients(index); });
    return to_rows(std::move(found), static_cast<std::size_t>(most<i64>(groups[index].channels(), 1)));
}

// Any library's array that can be written to, as numpy's.
nb::object writable_view(const nb::ndarray<float, nb::device::cpu> &array) {
    using Kept = nb::ndarray<float, nb::device::cpu>;
    std::vector<std::size_t> shape;
    std::vector<i64> strides;
    for (std::size_t axis = 0; axis < array.ndim(); ++axis) {
        shape.push_back(array.shape(axis));
        strides.push_back(array.stride(axis));
    }
    const nb::capsule owner(new Kept(array), [](void *pointer) noexcept { delete static_cast<Kept *>(pointer); });
    return nb::cast(nb::ndarray<nb::numpy, float>(array.data(), array.ndim(), shape.data(), owner, strides.data()));
}

using Positions3 = nb::ndarray<float, nb::shape<-1, -1, 3>, nb::c_contig, nb::device::cpu>;

void evaluate(const PyAnimation &self, int quantity, const Flat<double> &times, std::optional<i64> object,
              const Positions3 &out) {
    if (quantity < 0 || quantity > 2) throw nb::value_error("an unknown quantity");
    if (object && (*object < 0 || *object >= self.animation().objects()))
        throw nb::index_error("there is no such object");
    self.with([&](Animation &animation) {
        animation.evaluate(static_cast<Quantity>(quantity), view(times), object, {out.data(), out.size()});
        return 0;
    });
}

}  // namespace

void bind_animation(nb::module_ &module) {
    module.def("writable_view", &writable_view, nb::arg("array").noconvert());
    nb::class_<PyAnimation>(module, "Animation")
        .def(nb::init<nb::object, u64, int, i64>(), nb::arg("file"), nb::arg("max_memory"), nb::arg("threads"),
             nb::arg("kept_bytes"))
        .def_prop_ro("times",
                     [](const PyAnimation &self) { return to_array(std::vector<double>(self.animation().times())); })
        .def_prop_ro("fps", [](const PyAnimation &self) { return self.animation().fps(); })
        .def_prop_ro("vertex_counts", &vertex_counts)
        .def_prop_ro("sections", &sections)
        .def_prop_ro("file_bytes", [](const PyAnimation &self) { return self.animation().container().file_bytes(); })
        .def_prop_ro("groups", &groups)
        .def_prop_ro("model", &model)
        .def("names", [](const PyAnimation &self) { return self.with([](Animation &own) { return own.names(); }); })
        .def("connectivity", &connectivity)
        .def("attributes", &attributes)
        .def("reference", &reference)
        .def("remarks",
             [](const PyAnimation &self) { return to_bytes(self.with([](Animation &own) { return own.remarks(); })); })
        .def("coefficients", &coefficients, nb::arg("group"))
        .def("evaluate", &evaluate, nb::arg("quantity"), nb::arg("times"), nb::arg("object").none(),
             nb::arg("out").noconvert())
        .def("verify",
             [](const PyAnimation &self) {
                 self.with([](Animation &own) {
                     own.verify();
                     return 0;
                 });
             })
        .def("cancel", [](PyAnimation &self) {
            self.with([](Animation &own) {
                own.cancel();
                return 0;
            });
        });
}

}  // namespace pdeanim::bindings
