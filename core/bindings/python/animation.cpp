// Python's view of an open file.
#include "decode/animation.hpp"

#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#ifndef _WIN32
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#endif

#include "base/errors.hpp"
#include "bindings/python/bindings.hpp"

namespace pdeanim::bindings {

namespace {

#ifdef _WIN32
int process_number() { return 0; }  // no process is a copy of another
#else
int process_number() { return ::getpid(); }

// A file by its descriptor. No read moves the place that is read next, which threads and copies of the process share. The
// descriptor is a duplicate: whoever closes the other one meanwhile does not hand a stranger's file to calls under way.
class FileSource : public Source {
public:
    explicit FileSource(int descriptor)
        : Source(size_of(descriptor)), descriptor_(::fcntl(descriptor, F_DUPFD_CLOEXEC, 0)) {
        if (descriptor_ < 0) fail();
    }
    FileSource(const FileSource &) = delete;
    FileSource &operator=(const FileSource &) = delete;
    ~FileSource() override { ::close(descriptor_); }

    std::size_t read(u64 offset, std::span<u8> into) override {
        std::size_t done = 0;
        while (done < into.size()) {
            const ssize_t count =
                ::pread(descriptor_, into.data() + done, into.size() - done, static_cast<off_t>(offset + done));
            if (count < 0 && errno != EINTR) fail();
            if (count == 0) break;
            done += static_cast<std::size_t>(most<ssize_t>(count, 0));
        }
        return done;
    }

private:
    [[noreturn]] static void fail() { throw ReadError(std::string("cannot be read (") + std::strerror(errno) + ")"); }

    static u64 size_of(int descriptor) {
        struct stat found;
        if (::fstat(descriptor, &found) != 0) fail();
        if (!S_ISREG(found.st_mode)) throw ReadError("is no file that can be read from any place on; copy it to one");
        return static_cast<u64>(found.st_size);
    }

    int descriptor_;
};
#endif

// Bytes, a file's descriptor, or a file that Python reads, which is called with the interpreter lock.
std::unique_ptr<Source> source_of(const nb::object &file) {
    if (nb::isinstance<nb::bytes>(file)) {
        return std::make_unique<MemorySource>(view(nb::borrow<nb::bytes>(file)));
    }
#ifndef _WIN32
    if (nb::isinstance<nb::int_>(file)) return std::make_unique<FileSource>(nb::cast<int>(file));
#endif
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

    // The file, and of it one run, where there is one or one was chosen. Both stay while somebody uses them.
    struct Opened {
        std::shared_ptr<const File> file;
        std::shared_ptr<Animation> animation;
    };

    // What is open; ReadError once it is closed.
    //
    // A process may be copied while a thread that the copy lacks holds the animation's lock, half way through a change:
    // the copy leaves all of it alone, and opens the file anew.
    Opened opened() {
        if (!opened_.file) throw ReadError("is closed; open it again");
        if (process_ != process_number()) {
            Opened anew = open();
            if (process_ != process_number()) {  // no other thread was first
                leave_alone();
                opened_ = std::move(anew);
                process_ = process_number();
            }
        }
        return opened_;
    }

    // The run; ArgumentError where there are several, of which none was chosen.
    std::shared_ptr<Animation> animation() {
        std::shared_ptr<Animation> found = opened().animation;
        if (!found) throw ArgumentError("there are several runs of frames; choose one");
        return found;
    }

    // Run `work` on the animation with the interpreter lock released.
    template <class Work> auto with(const Work &work) {
        const std::shared_ptr<Animation> own = animation();
        const nb::gil_scoped_release release;
        return work(*own);
    }

    // Calls that are under way end as they would have.
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

    nb::object file_;  // outlives what is open
    u64 max_memory_;
    Animation::Options options_;
    std::optional<std::size_t> run_;
    int process_ = process_number();
    Opened opened_;
};

nb::list runs(PyAnimation &self) {
    nb::list found;
    for (const Run &run : self.opened().file->runs()) {
        found.append(nb::make_tuple(run.first, run.frames, run.vertices));
    }
    return found;
}

PyAnimation *open_run(PyAnimation &self, std::size_t run) {
    if (run >= self.opened().file->runs().size()) throw nb::index_error("there is no such run");
    return new PyAnimation(self, run);
}

nb::list vertex_counts(PyAnimation &self) {
    const auto own = self.animation();
    nb::list found;
    for (i64 object = 0; object < own->objects(); ++object) {
        found.append(own->first_vertex(object + 1) - own->first_vertex(object));
    }
    return found;
}

nb::list connectivity(PyAnimation &self) {
    const auto parts = self.with([](Animation &animation) { return animation.shared_connectivity(); });
    const nb::capsule owner = owner_of(parts);
    nb::list found;
    for (const Connectivity &part : *parts) {
        found.append(nb::make_tuple(shared_array(part.face_sizes, owner), shared_array(part.face_indices, owner),
                                    shared_array(part.line_sizes, owner), shared_array(part.line_indices, owner)));
    }
    return found;
}

nb::list attributes(PyAnimation &self) {
    return to_list(self.with([](Animation &animation) { return animation.shared_attributes(); }));
}

nb::tuple reference(PyAnimation &self) {
    const Reference found = self.with([](Animation &animation) { return animation.reference(); });
    std::vector<i64> grid;
    for (const GridPoint &point : found.grid) grid.insert(grid.end(), point.begin(), point.end());
    return nb::make_tuple(to_rows(std::move(grid), 3),
                          nb::make_tuple(found.origin[0], found.origin[1], found.origin[2]), found.step);
}

nb::tuple model(PyAnimation &self) {
    const auto animation = self.animation();
    const Model &own = animation->model();
    const SpaceForm &form = own.form;
    return nb::make_tuple(static_cast<int>(form.kind), form.points, form.functions, form.threshold, form.rate,
                          form.is_affine, own.residual_step, to_bytes(own.layout));
}

nb::list groups(PyAnimation &self) {
    const auto own = self.animation();
    nb::list found;
    for (const Group &group : own->table().groups()) {
        found.append(nb::make_tuple(group.first, group.frames, group.functions, static_cast<int>(group.basis),
                                    group.step, group.alpha));
    }
    return found;
}

nb::list sections(PyAnimation &self) {
    const auto own = self.opened();
    nb::list found;
    for (const SectionEntry &entry : (own.animation ? own.animation->container() : own.file->container()).entries()) {
        found.append(nb::make_tuple(entry.type, entry.offset, entry.length));
    }
    return found;
}

nb::list run_sections(PyAnimation &self, std::size_t run) {
    const auto own = self.opened();
    if (run >= own.file->runs().size()) throw nb::index_error("there is no such run");
    const Container container = own.file->container_of(run);
    nb::list found;
    for (const SectionEntry &entry : container.entries()) {
        found.append(nb::make_tuple(entry.type, entry.offset, entry.length));
    }
    return found;
}

nb::object coefficients(PyAnimation &self, std::size_t index) {
    const auto own = self.animation();
    const std::vector<Group> &groups = own->table().groups();
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

nb::bytes remarks(PyAnimation &self) {
    const auto own = self.opened();
    std::vector<u8> found;
    {
        const nb::gil_scoped_release release;
        found = own.file->container().read_optional("META");
    }
    return to_bytes(found);
}

// Check every byte of a run, or of a file of several every section.
void verify(PyAnimation &self) {
    const auto own = self.opened();
    const nb::gil_scoped_release release;
    if (own.animation) {
        own.animation->verify();
    } else {
        own.file->container().verify();
    }
}

// Check the bytes of a section, of a run or of a file of several.
void check_section(PyAnimation &self, const std::string &type) {
    const auto own = self.opened();
    const nb::gil_scoped_release release;
    const Container &container = own.animation ? own.animation->container() : own.file->container();
    container.check(container.entry(type));
}

// Check the bytes of a group of frames.
void check_group(PyAnimation &self, std::size_t index) {
    const auto own = self.animation();
    if (index >= own->table().groups().size()) throw nb::index_error("there is no such group");
    const nb::gil_scoped_release release;
    own->table().chunks(own->container(), index);
}

using Positions3 = nb::ndarray<float, nb::shape<-1, -1, 3>, nb::c_contig, nb::device::cpu>;

Quantity quantity_of(int number) {
    if (number < 0 || number > 2) throw nb::value_error("an unknown quantity");
    return static_cast<Quantity>(number);
}

void evaluate(PyAnimation &self, int quantity, const Flat<double> &times, std::optional<i64> object,
              const Positions3 &out) {
    const Quantity wanted = quantity_of(quantity);
    if (object && (*object < 0 || *object >= self.animation()->objects()))
        throw nb::index_error("there is no such object");
    self.with([&](Animation &animation) {
        animation.evaluate(wanted, view(times), object, {out.data(), out.size()});
        return 0;
    });
}

Group group_of(PyAnimation &self, std::size_t index) {
    const auto own = self.animation();
    const std::vector<Group> &groups = own->table().groups();
    if (index >= groups.size()) throw nb::index_error("there is no such group");
    return groups[index];
}

nb::object weights(PyAnimation &self, int quantity, double time, std::size_t index) {
    const Group own = group_of(self, index);
    const Quantity wanted = quantity_of(quantity);
    return to_rows(self.with([&](Animation &animation) { return animation.weights(wanted, time, index); }),
                   static_cast<std::size_t>(own.functions));
}

nb::object fields(PyAnimation &self, std::size_t index) {
    const Group own = group_of(self, index);
    const i64 vertices = self.animation()->vertices();
    auto *kept = new std::vector<float>(static_cast<std::size_t>(own.channels() * vertices));
    const nb::capsule owner(kept, [](void *pointer) noexcept { delete static_cast<std::vector<float> *>(pointer); });
    self.with([&](Animation &animation) {
        animation.fields(index, *kept);
        return 0;
    });
    const std::size_t shape[] = {static_cast<std::size_t>(own.functions), static_cast<std::size_t>(vertices),
                                 static_cast<std::size_t>(own.axes())};
    return nb::cast(nb::ndarray<nb::numpy, float>(kept->data(), 3, shape, owner));
}

nb::tuple corrections(PyAnimation &self, std::size_t group) {
    group_of(self, group);
    const std::vector<Correction> found = self.with([&](Animation &own) {
        TakenMemory taken;
        return own.corrections(group, taken);
    });
    std::vector<i64> frames;
    std::vector<i32> vertices;
    std::vector<float> offsets;
    for (const Correction &one : found) {
        frames.push_back(one.frame);
        vertices.push_back(one.vertex);
        offsets.insert(offsets.end(), one.offset.begin(), one.offset.end());
    }
    return nb::make_tuple(to_array(std::move(frames)), to_array(std::move(vertices)), to_rows(std::move(offsets), 3));
}

}  // namespace

void bind_animation(nb::module_ &module) {
    module.def("writable_view", &writable_view, nb::arg("array").noconvert());
    nb::class_<PyAnimation>(module, "Animation")
        .def(nb::init<nb::object, u64, int, i64>(), nb::arg("file"), nb::arg("max_memory"), nb::arg("threads"),
             nb::arg("kept_bytes"))
        .def_prop_ro("times",
                     [](PyAnimation &self) {
                         const auto own = self.opened();
                         const auto &times = own.animation ? own.animation->times() : own.file->sequence().times;
                         return to_array(std::vector<double>(times));
                     })
        .def_prop_ro("jumps",
                     [](PyAnimation &self) {
                         const auto own = self.opened();
                         return own.animation ? own.animation->jumps() : own.file->sequence().jumps;
                     })
        .def_prop_ro("fps", [](PyAnimation &self) { return self.opened().file->sequence().fps; })
        .def_prop_ro("runs", &runs)
        .def("run_sections", &run_sections, nb::arg("run"))
        .def("open_run", &open_run, nb::arg("run"))
        .def_prop_ro("vertex_counts", &vertex_counts)
        .def_prop_ro("sections", &sections)
        .def_prop_ro("file_bytes", [](PyAnimation &self) { return self.opened().file->container().file_bytes(); })
        .def_prop_ro("groups", &groups)
        .def_prop_ro("model", &model)
        .def("names", [](PyAnimation &self) { return self.with([](Animation &own) { return own.names(); }); })
        .def("connectivity", &connectivity)
        .def("attributes", &attributes)
        .def("reference", &reference)
        .def("remarks", &remarks)
        .def("coefficients", &coefficients, nb::arg("group"))
        .def("evaluate", &evaluate, nb::arg("quantity"), nb::arg("times"), nb::arg("object").none(),
             nb::arg("out").noconvert())
        .def(
            "groups_at",
            [](PyAnimation &self, int quantity, double time) {
                const Quantity wanted = quantity_of(quantity);
                return self.with([&](Animation &own) { return own.groups_at(wanted, time); });
            },
            nb::arg("quantity"), nb::arg("time"))
        .def("weights", &weights, nb::arg("quantity"), nb::arg("time"), nb::arg("group"))
        .def("fields", &fields, nb::arg("group"))
        .def("corrections", &corrections, nb::arg("group"))
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
