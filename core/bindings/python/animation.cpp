// The Python class Animation: an open file.
#include "decode/animation.hpp"

#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#ifndef _WIN32
#include <unistd.h>
#endif

#include "base/errors.hpp"
#include "bindings/python/bindings.hpp"
#include "sections/reference/reference.hpp"

namespace pdeanim::bindings {

namespace {

#ifdef _WIN32
int process_number() { return 0; }  // Windows has no fork: a process is never a copy of another
#else
int process_number() { return ::getpid(); }
#endif

class PyAnimation {
public:
    PyAnimation(nb::object file, u64 max_memory, int threads, i64 kept_bytes)
        : file_(std::move(file)), max_memory_(max_memory), options_{threads, kept_bytes, {}}, opened_(open()) {}
    PyAnimation(PyAnimation &whole, std::size_t run)
        : file_(whole.file_), max_memory_(whole.max_memory_), options_(whole.options_), run_(run) {
        const Opened own = whole.opened();
        const nb::gil_scoped_release release;
        opened_ = {own.file, std::make_shared<Animation>(own.file, run, options_)};
    }
    PyAnimation(const PyAnimation &) = delete;
    PyAnimation &operator=(const PyAnimation &) = delete;
    ~PyAnimation() {
        if (process_ != process_number()) leave_alone();
    }

    // The file, and a run: the only one, or the chosen one. Both are kept alive while they are used.
    struct Opened {
        std::shared_ptr<const File> file;
        std::shared_ptr<Animation> animation;
    };

    // Return the open file; ReadError once it is closed.
    //
    // A fork copies a process, but only one of its threads. If another thread was changing the animation at that
    // moment, the copy's lock is never released. So a forked process never touches the original objects: it opens the
    // file again.
    Opened opened() {
        if (!opened_.file) throw ReadError("is closed; open it again");
        if (process_ != process_number()) {
            Opened anew = open();
            if (process_ != process_number()) {  // check again: another thread may have replaced it meanwhile
                leave_alone();
                opened_ = std::move(anew);
                process_ = process_number();
            }
        }
        return opened_;
    }

    // Return the run; ArgumentError if the file has several and none was chosen.
    std::shared_ptr<Animation> animation() {
        std::shared_ptr<Animation> found = opened().animation;
        if (!found) throw ArgumentError("the file has several runs of frames; choose one");
        return found;
    }

    // Return the sections of the file, or of the chosen run.
    const Container &container_of(const Opened &own) const {
        return run_ ? own.animation->sections().container() : own.file->container();
    }

    // Run `work` on the animation with the interpreter lock released.
    template <class Work> auto with(const Work &work) {
        const std::shared_ptr<Animation> own = animation();
        const nb::gil_scoped_release release;
        return work(*own);
    }

    // Close the animation. Calls that are running end normally, because they share ownership.
    void close() {
        if (process_ != process_number()) leave_alone();
        opened_ = {};
    }

private:
    Opened open() const {
        std::unique_ptr<Source> source = source_of(file_);
        const nb::gil_scoped_release release;
        const auto file = std::make_shared<const File>(std::move(source), max_memory_);
        if (!run_ && file->runs().size() > 1) return {file, nullptr};
        return {file, std::make_shared<Animation>(file, run_.value_or(0), options_)};
    }

    void leave_alone() { new Opened(std::move(opened_)); }

    nb::object file_;  // must outlive the sources in `opened_`
    u64 max_memory_;
    Animation::Options options_;
    std::optional<std::size_t> run_;
    int process_ = process_number();
    Opened opened_;
};

// Return a Python list of make(item) for each item.
template <class Items, class Make> nb::list list_of(const Items &items, const Make &make) {
    nb::list found;
    for (const auto &item : items) found.append(make(item));
    return found;
}

nb::list runs(PyAnimation &self) {
    return list_of(self.opened().file->runs(),
                   [](const Run &run) { return named("Run", run.first, run.frames, run.vertices); });
}

std::size_t check_run(PyAnimation &self, std::size_t run) {
    if (run >= self.opened().file->runs().size()) throw nb::index_error("no run of this number");
    return run;
}

nb::list vertex_counts(PyAnimation &self) {
    const auto own = self.animation();
    nb::list found;
    for (i64 object = 0; object < own->sections().objects(); ++object) {
        found.append(own->sections().first_vertex(object + 1) - own->sections().first_vertex(object));
    }
    return found;
}

nb::list connectivity(PyAnimation &self) {
    const auto parts = self.with([](Animation &animation) { return animation.sections().shared_connectivity(); });
    const nb::capsule owner = owner_of(parts);
    return list_of(*parts, [&](const Connectivity &part) {
        return named("MeshCells", shared_array(part.face_sizes, owner), shared_array(part.face_indices, owner),
                     shared_array(part.line_sizes, owner), shared_array(part.line_indices, owner),
                     shared_array(part.cell_shapes, owner), shared_array(part.cell_sizes, owner),
                     shared_array(part.cell_indices, owner));
    });
}

nb::dlpack::dtype dtype_of(ValueType type) {
    switch (type) {
        case ValueType::float32: return nb::dtype<float>();
        case ValueType::float64: return nb::dtype<double>();
        case ValueType::int32: return nb::dtype<i32>();
        case ValueType::uint8: return nb::dtype<u8>();
        default: return nb::dtype<i64>();
    }
}

nb::object to_values(const Attribute &attribute, const nb::capsule &owner) {
    const std::size_t shape[] = {static_cast<std::size_t>(attribute.rows),
                                 static_cast<std::size_t>(attribute.numbers())};
    return nb::cast(nb::ndarray<nb::numpy, nb::ro>(attribute.values.data(), attribute.columns ? 2 : 1, shape, owner,
                                                   nullptr, dtype_of(attribute.type)));
}

nb::list attributes(PyAnimation &self) {
    const auto decoded = self.with([](Animation &animation) { return animation.sections().shared_attributes(); });
    const nb::capsule owner = owner_of(decoded);
    return list_of(*decoded, [&](const std::vector<Attribute> &of_object) {
        return list_of(of_object, [&](const Attribute &attribute) {
            nb::object indices = nb::none();
            if (attribute.indices) indices = shared_array(*attribute.indices, owner);
            return named("DecodedAttribute", attribute.name, static_cast<i64>(attribute.domain),
                         to_values(attribute, owner), indices, nb::tuple(nb::cast(attribute.labels)));
        });
    });
}

nb::object reference(PyAnimation &self) {
    Reference found = self.with([](Animation &animation) { return animation.sections().reference(); });
    std::vector<i64> grid;
    for (const GridPoint &point : found.grid) grid.insert(grid.end(), point.begin(), point.end());
    return named("Reference", to_rows(std::move(grid), 3),
                 nb::make_tuple(found.origin[0], found.origin[1], found.origin[2]), found.step, found.is_smoothed,
                 to_array(std::move(found.ties)));
}

nb::object model(PyAnimation &self) {
    const auto animation = self.animation();
    const Model &own = animation->sections().model();
    const SpaceForm &form = own.form;
    return named("Model", static_cast<int>(form.kind), form.points, form.functions, form.threshold, form.rate,
                 form.is_affine, own.residual_step, to_bytes(own.layout));
}

nb::object still_vertices(PyAnimation &self) { return to_array(self.animation()->sections().still_vertices()); }

nb::list groups(PyAnimation &self) {
    return list_of(self.animation()->sections().table().groups(), [](const Group &group) {
        return named("Group", group.first, group.frames, group.functions, static_cast<int>(group.basis), group.step,
                     group.alpha);
    });
}

nb::list listed(const Container &container) {
    return list_of(container.entries(),
                   [](const SectionEntry &entry) { return named("Section", entry.type, entry.offset, entry.length); });
}

Group group_of(PyAnimation &self, std::size_t index) {
    const auto own = self.animation();
    const std::vector<Group> &groups = own->sections().table().groups();
    if (index >= groups.size()) throw nb::index_error("no group of this number");
    return groups[index];
}

nb::object coefficients(PyAnimation &self, std::size_t index) {
    const i64 channels = group_of(self, index).channels();
    std::vector<double> found = self.with([&](Animation &animation) { return animation.fields().coefficients(index); });
    return to_rows(std::move(found), static_cast<std::size_t>(most<i64>(channels, 1)));
}

// View a writable array of any array library as a numpy array.
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

nb::bytes remarks(PyAnimation &self) {
    const auto own = self.opened();
    std::vector<u8> found;
    {
        const nb::gil_scoped_release release;
        found = own.file->container().read_optional("META");
    }
    return to_bytes(found);
}

// Check every byte of a run, or of every section of a file with several runs.
void verify(PyAnimation &self) {
    const auto own = self.opened();
    const nb::gil_scoped_release release;
    if (own.animation) {
        own.animation->verify();
    } else {
        own.file->container().verify();
    }
}

// Check the bytes of a section of the run if it has that section, else of the file.
void check_section(PyAnimation &self, const std::string &type) {
    const auto own = self.opened();
    const nb::gil_scoped_release release;
    const bool has_run_it = own.animation && own.animation->sections().container().find(type);
    const Container &container = has_run_it ? own.animation->sections().container() : own.file->container();
    container.check(container.entry(type));
}

// Check the bytes of a group of frames.
void check_group(PyAnimation &self, std::size_t index) {
    group_of(self, index);
    self.with([&](const Animation &own) { return own.sections().table().chunks(own.sections().container(), index); });
}

using Positions3 = nb::ndarray<float, nb::shape<-1, -1, 3>, nb::c_contig, nb::device::cpu>;

Quantity quantity_of(int number) {
    if (number < 0 || number > 2) throw nb::value_error("an unknown quantity");
    return static_cast<Quantity>(number);
}

void evaluate(PyAnimation &self, int quantity, const Flat<double> &times, std::optional<i64> object,
              const Positions3 &out) {
    const Quantity wanted = quantity_of(quantity);
    if (object && (*object < 0 || *object >= self.animation()->sections().objects()))
        throw nb::index_error("no object of this number");
    self.with([&](Animation &animation) {
        animation.evaluator().evaluate(wanted, view(times), object, {out.data(), out.size()});
        return 0;
    });
}

// Return the description of every field, with its groups.
nb::list stored_fields(PyAnimation &self) {
    const auto own = self.animation();
    const auto &headers = self.with(
        [](Animation &animation) -> const std::vector<FieldHeader> & { return animation.stored_fields().headers(); });
    return list_of(headers, [](const FieldHeader &one) {
        const nb::list groups = list_of(one.groups, [](const FieldGroup &group) {
            return named("FieldGroup", group.first, group.frames, group.skipped, group.in_chunk,
                         static_cast<int>(group.code), group.unit, group.offset, group.size, group.checksum,
                         group.source, group.component);
        });
        return named("StoredField", one.name, static_cast<int>(one.domain), static_cast<int>(one.type), one.components,
                     one.unit, one.objects, one.smallest, one.largest, one.bound, groups);
    });
}

std::size_t check_field(PyAnimation &self, std::size_t field) {
    const std::size_t count = self.with([](Animation &own) { return own.stored_fields().headers().size(); });
    if (field >= count) throw nb::index_error("there is no such field");
    return field;
}

using Bytes = nb::ndarray<u8, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

// Write a field's values at consecutive frames as bytes.
void read_field(PyAnimation &self, std::size_t field, i64 first, i64 frames, const Bytes &out) {
    check_field(self, field);
    self.with([&](Animation &own) {
        const FieldHeader &header = own.stored_fields().headers()[field];
        const i64 row = own.stored_fields().rows(field) * header.components * size_of_type(header.type);
        require(first >= 0 && frames >= 0 && first + frames <= own.sections().frames() &&
                    static_cast<i64>(out.size()) == frames * row,
                "frames or the output do not fit the field");
        own.stored_fields().read(field, first, frames, {out.data(), out.size()});
        return 0;
    });
}

// Write a field's values at times as bytes.
void evaluate_field(PyAnimation &self, std::size_t field, const Flat<double> &times, int derivative,
                    std::optional<i64> object, const Bytes &out) {
    check_field(self, field);
    self.with([&](Animation &own) {
        const FieldHeader &header = own.stored_fields().headers()[field];
        const i64 row = own.stored_fields().rows(field, object) * header.components * size_of_type(header.type);
        require(derivative >= 0 && derivative <= 2 && (derivative == 0 || is_float(header.type)) &&
                    static_cast<i64>(out.size()) == static_cast<i64>(times.size()) * row,
                "the derivative or the output do not fit the field");
        own.stored_fields().evaluate(field, view(times), derivative, object, {out.data(), out.size()});
        return 0;
    });
}

nb::object weights(PyAnimation &self, int quantity, double time, std::size_t index) {
    const Group own = group_of(self, index);
    const Quantity wanted = quantity_of(quantity);
    return to_rows(self.with([&](Animation &animation) { return animation.evaluator().weights(wanted, time, index); }),
                   static_cast<std::size_t>(own.functions));
}

nb::object fields(PyAnimation &self, std::size_t index) {
    const Group own = group_of(self, index);
    const i64 vertices = self.animation()->sections().vertices();
    auto *kept = new std::vector<float>(static_cast<std::size_t>(own.channels() * vertices));
    const nb::capsule owner(kept, [](void *pointer) noexcept { delete static_cast<std::vector<float> *>(pointer); });
    self.with([&](Animation &animation) {
        animation.fields().fields(index, *kept);
        return 0;
    });
    const std::size_t shape[] = {static_cast<std::size_t>(own.functions), static_cast<std::size_t>(vertices),
                                 static_cast<std::size_t>(own.axes())};
    return nb::cast(nb::ndarray<nb::numpy, float>(kept->data(), 3, shape, owner));
}

nb::object corrections(PyAnimation &self, std::size_t group) {
    group_of(self, group);
    const std::vector<Correction> found = self.with([&](Animation &own) {
        TakenMemory taken;
        return own.fields().corrections(group, taken);
    });
    std::vector<i64> frames;
    std::vector<i32> vertices;
    std::vector<float> offsets;
    for (const Correction &one : found) {
        frames.push_back(one.frame);
        vertices.push_back(one.vertex);
        offsets.insert(offsets.end(), one.offset.begin(), one.offset.end());
    }
    return named("Corrections", to_array(std::move(frames)), to_array(std::move(vertices)),
                 to_rows(std::move(offsets), 3));
}

}  // namespace

void bind_animation(nb::module_ &module) {
    add_tuple(module, "Run", "first frames vertices");
    add_tuple(module, "Section", "type offset length");
    add_tuple(module, "Group", "first frames functions basis step alpha");
    add_tuple(module, "GroupRange", "first end");
    add_tuple(module, "Model", "kind points functions threshold rate is_affine residual_step layout");
    add_tuple(module, "MeshCells",
              "face_counts face_indices line_counts line_indices cell_shapes cell_counts cell_indices");
    add_tuple(module, "DecodedAttribute", "name domain values indices labels");
    add_tuple(module, "Reference", "grid origin step is_smoothed ties");
    add_tuple(module, "Corrections", "frames vertices offsets");
    add_tuple(module, "FieldGroup", "first frames skipped in_chunk code unit offset size checksum source component");
    add_tuple(module, "StoredField", "name domain type components unit objects smallest largest bound groups");
    module.def("writable_view", &writable_view, nb::arg("array").noconvert());
    nb::class_<PyAnimation>(module, "Animation")
        .def(nb::init<nb::object, u64, int, i64>(), nb::arg("file"), nb::arg("max_memory"), nb::arg("threads"),
             nb::arg("kept_bytes"))
        .def_prop_ro("times",
                     [](PyAnimation &self) {
                         const auto own = self.opened();
                         const auto &times =
                             own.animation ? own.animation->sections().times() : own.file->sequence().times;
                         return to_array(std::vector<double>(times));
                     })
        .def_prop_ro("jumps",
                     [](PyAnimation &self) {
                         const auto own = self.opened();
                         return own.animation ? own.animation->sections().jumps() : own.file->sequence().jumps;
                     })
        .def_prop_ro("fps", [](PyAnimation &self) { return self.opened().file->sequence().fps; })
        .def_prop_ro("runs", &runs)
        .def(
            "run_sections",
            [](PyAnimation &self, std::size_t run) {
                return listed(self.opened().file->container_of(check_run(self, run)));
            },
            nb::arg("run"))
        .def(
            "open_run", [](PyAnimation &self, std::size_t run) { return new PyAnimation(self, check_run(self, run)); },
            nb::arg("run"))
        .def_prop_ro("vertex_counts", &vertex_counts)
        .def_prop_ro("sections",
                     [](PyAnimation &self) {
                         const auto own = self.opened();
                         return listed(self.container_of(own));
                     })
        .def_prop_ro("file_bytes", [](PyAnimation &self) { return self.opened().file->container().file_bytes(); })
        .def_prop_ro("groups", &groups)
        .def_prop_ro("model", &model)
        .def_prop_ro("still_vertices", &still_vertices)
        .def("names",
             [](PyAnimation &self) { return self.with([](Animation &own) { return own.sections().names(); }); })
        .def("connectivity", &connectivity)
        .def("attributes", &attributes)
        .def("reference", &reference)
        .def_prop_ro(
            "ties_vertices",
            [](PyAnimation &self) { return (self.animation()->sections().reference_kind() & ties_vertices) != 0; })
        .def("remarks", &remarks)
        .def("coefficients", &coefficients, nb::arg("group"))
        .def("evaluate", &evaluate, nb::arg("quantity"), nb::arg("times"), nb::arg("object").none(),
             nb::arg("out").noconvert())
        .def(
            "groups_at",
            [](PyAnimation &self, int quantity, double time) {
                const Quantity wanted = quantity_of(quantity);
                const auto [first, end] =
                    self.with([&](Animation &own) { return own.evaluator().groups_at(wanted, time); });
                return named("GroupRange", first, end);
            },
            nb::arg("quantity"), nb::arg("time"))
        .def("weights", &weights, nb::arg("quantity"), nb::arg("time"), nb::arg("group"))
        .def("fields", &fields, nb::arg("group"))
        .def("corrections", &corrections, nb::arg("group"))
        .def("stored_fields", &stored_fields)
        .def("read_field", &read_field, nb::arg("field"), nb::arg("first"), nb::arg("frames"),
             nb::arg("out").noconvert())
        .def("evaluate_field", &evaluate_field, nb::arg("field"), nb::arg("times"), nb::arg("derivative"),
             nb::arg("object").none(), nb::arg("out").noconvert())
        .def(
            "check_field_group",
            [](PyAnimation &self, std::size_t field, std::size_t group, bool deep) {
                check_field(self, field);
                self.with([&](Animation &own) {
                    require(group < own.stored_fields().headers()[field].groups.size(), "there is no such group");
                    own.stored_fields().check(field, group, deep);
                    return 0;
                });
            },
            nb::arg("field"), nb::arg("group"), nb::arg("deep"))
        .def("close", &PyAnimation::close)
        .def("verify", &verify)
        .def("check_section", &check_section, nb::arg("type"))
        .def("check_group", &check_group, nb::arg("group"))
        .def("cancel", [](PyAnimation &self) {
            self.with([](Animation &own) {
                own.cancel();
                return 0;
            });
        });
}

}  // namespace pdeanim::bindings
