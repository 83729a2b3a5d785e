// Sources of bytes for a file that Python opens.
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

#ifndef _WIN32
// A file that is read by its descriptor. Reads do not move the file position, which threads and forked processes share.
// The descriptor is a duplicate: if another thread closes the original, running calls do not read an unrelated file.
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
        if (!S_ISREG(found.st_mode)) throw ReadError("is not a regular file; copy it to one");
        return static_cast<u64>(found.st_size);
    }

    int descriptor_;
};
#endif

}  // namespace

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

}  // namespace pdeanim::bindings
