#include "bindings/c/handle.hpp"

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <new>
#include <stdexcept>

using namespace pdeanim;

namespace {

// Addresses of the open handles, sorted. Never destroyed: a program may close a handle while it exits.
struct OpenHandles {
    std::mutex lock;
    std::vector<const pdeanim_animation *> sorted;

    auto place_of(const pdeanim_animation *handle) { return std::lower_bound(sorted.begin(), sorted.end(), handle); }
};

OpenHandles &open_handles() {
    static OpenHandles &handles = *new OpenHandles;
    return handles;
}

// Register a new animation and hand it to the caller.
pdeanim_animation *registered(std::unique_ptr<pdeanim_animation> animation) {
    OpenHandles &handles = open_handles();
    const std::lock_guard guard(handles.lock);
    handles.sorted.insert(handles.place_of(animation.get()), animation.get());
    return animation.release();
}

pdeanim_status describe(pdeanim_error *error, pdeanim_status status, const char *text, i64 offset = -1,
                        i64 frame = -1) {
    if (error) {
        error->status = status;
        error->offset = offset;
        error->frame = frame;
        const std::size_t size = std::min(std::strlen(text), sizeof error->text - 1);
        std::memcpy(error->text, text, size);
        error->text[size] = '\0';
    }
    return status;
}

// Refuse files that declare more bytes of positions than the limit.
void check_output(const pdeanim_animation &animation, u64 limit) {
    constexpr u64 bytes_per_position = 12;
    const std::vector<Run> &runs = animation.file->runs();
    u64 found =
        0;  // cannot overflow: fewer than 2^31 vertices, and far fewer than 2^33 frames, whose times are in memory
    for (const Run &run : runs) {
        const i64 vertices = animation.animation ? animation.animation->sections().vertices() : run.vertices;
        found += static_cast<u64>(run.frames) * static_cast<u64>(vertices);
    }
    if (limit > 0 && found > limit / bytes_per_position) {
        throw LimitError("declares " + std::to_string(found) + " positions of " + std::to_string(bytes_per_position) +
                         " bytes each; the output limit is " + std::to_string(limit));
    }
}

pdeanim_animation *open_source(std::unique_ptr<Source> source, const pdeanim_options *chosen) {
    if (source->size() > INT64_MAX) throw ArgumentError("the size of the file is out of range");
    // Fields that the caller's version of the structure lacks stay 0.
    pdeanim_options known{};
    if (chosen) {
        if (chosen->size < offsetof(pdeanim_options, threads)) {
            throw ArgumentError("set the field size of the options to sizeof(pdeanim_options)");
        }
        std::memcpy(&known, chosen, std::min(chosen->size, sizeof known));
    }
    Animation::Options options;
    options.threads = static_cast<int>(std::min<uint32_t>(known.threads, 1024));
    if (known.max_kept > 0) options.kept_bytes = static_cast<i64>(std::min<uint64_t>(known.max_kept, INT64_MAX / 2));
    const u64 memory = known.max_memory > 0 ? known.max_memory : File::usual_memory;
    auto made = std::make_unique<pdeanim_animation>(std::make_shared<const File>(std::move(source), memory), options);
    check_output(*made, known.max_output);
    return registered(std::move(made));
}

}  // namespace

pdeanim_animation::pdeanim_animation(std::shared_ptr<const File> whole, const Animation::Options &chosen)
    : file(std::move(whole)), options(chosen) {
    options.cancels = std::make_shared<std::atomic<u64>>(0);
    if (file->runs().size() == 1) animation = std::make_unique<Animation>(file, run, options);
}

pdeanim_animation::pdeanim_animation(const pdeanim_animation &whole, std::size_t of_it)
    : file(whole.file), options(whole.options), run(whole.animation ? whole.run : of_it) {
    options.cancels = std::make_shared<std::atomic<u64>>(0);
    animation = std::make_unique<Animation>(file, run, options);
}

Animation &pdeanim_animation::only() {
    if (!animation) {
        throw ArgumentError("the file has " + std::to_string(file->runs().size()) +
                            " runs of frames; open one of them (pdeanim_open_run)");
    }
    return *animation;
}

namespace pdeanim {

bool is_open(const pdeanim_animation *handle) {
    OpenHandles &handles = open_handles();
    const std::lock_guard guard(handles.lock);
    const auto place = handles.place_of(handle);
    return place != handles.sorted.end() && *place == handle;
}

void check_given(const void *pointer, const char *name) {
    if (!pointer) throw ArgumentError(std::string(name) + " must not be NULL");
}

void check_index(i64 index, i64 count, const char *what) {
    if (index < 0 || index >= count) {
        throw ArgumentError(std::string("there is no ") + what + " " + std::to_string(index) + ", there are " +
                            std::to_string(count));
    }
}

Quantity quantity_of(const pdeanim_quantity &quantity) {
    // A caller in C may pass any number, which C++ must not read as a member of the enumeration.
    std::underlying_type_t<pdeanim_quantity> number;
    std::memcpy(&number, &quantity, sizeof number);
    if (number > PDEANIM_ACCELERATIONS) throw ArgumentError("an unknown quantity");
    return static_cast<Quantity>(number);
}

pdeanim_status describe_success(pdeanim_error *error) { return describe(error, PDEANIM_OK, ""); }

pdeanim_status describe_thrown(pdeanim_error *error) {
    try {
        throw;
    } catch (const CorruptError &thrown) {
        return describe(error, PDEANIM_CORRUPT, thrown.what(), thrown.offset, thrown.frame);
    } catch (const LimitError &thrown) {
        return describe(error, PDEANIM_LIMIT,
                        (std::string(thrown.what()) + "; raise it if you trust the file").c_str());
    } catch (const ArgumentError &thrown) {
        return describe(error, PDEANIM_ARGUMENT, thrown.what());
    } catch (const ReadError &thrown) {
        return describe(error, PDEANIM_READ_FAILED, thrown.what());
    } catch (const CancelledError &thrown) {
        return describe(error, PDEANIM_CANCELLED, thrown.what());
    } catch (const std::bad_alloc &) {
        return describe(error, PDEANIM_NO_MEMORY, "there is not enough memory; set a lower memory limit");
    } catch (const std::exception &thrown) {
        return describe(error, PDEANIM_INTERNAL, thrown.what());
    } catch (...) {
        return describe(error, PDEANIM_INTERNAL, "an unknown fault");
    }
}

}  // namespace pdeanim

pdeanim_status pdeanim_open_memory(const void *data, size_t size, const pdeanim_options *options,
                                   pdeanim_animation **animation, pdeanim_error *error) {
    return guarded(error, [&] {
        check_given(animation, "animation");
        *animation = nullptr;
        check_given(data, "data");
        auto source = std::make_unique<MemorySource>(std::span<const u8>(static_cast<const u8 *>(data), size));
        *animation = open_source(std::move(source), options);
    });
}

pdeanim_status pdeanim_open_read(pdeanim_read read, void *user, uint64_t size, const pdeanim_options *options,
                                 pdeanim_animation **animation, pdeanim_error *error) {
    return guarded(error, [&] {
        check_given(animation, "animation");
        *animation = nullptr;
        if (!read) throw ArgumentError("read must not be NULL");
        const auto from = [read, user](u64 offset, std::span<u8> into) -> std::size_t {
            if (into.empty()) return 0;  // never ask the caller to copy to a null pointer
            const int64_t count = read(user, offset, into.data(), into.size());
            if (count < 0) throw ReadError("the file cannot be read");
            if (static_cast<u64>(count) > into.size()) throw ReadError("the read function returned too large a count");
            return static_cast<std::size_t>(count);
        };
        *animation = open_source(std::make_unique<CallbackSource>(size, from), options);
    });
}

pdeanim_status pdeanim_open_run(const pdeanim_animation *animation, int64_t run, pdeanim_animation **opened_run,
                                pdeanim_error *error) {
    return guarded(error, [&] {
        check_given(opened_run, "opened");
        *opened_run = nullptr;
        const pdeanim_animation &whole = opened(animation);
        check_index(run, pdeanim_run_count(animation), "run");
        *opened_run = registered(std::make_unique<pdeanim_animation>(whole, static_cast<std::size_t>(run)));
    });
}

void pdeanim_close(pdeanim_animation *animation) {
    {
        OpenHandles &handles = open_handles();
        const std::lock_guard guard(handles.lock);
        const auto place = handles.place_of(animation);
        if (place == handles.sorted.end() || *place != animation) return;
        handles.sorted.erase(place);
    }
    delete animation;
}

void pdeanim_cancel(pdeanim_animation *animation) {
    if (is_open(animation)) ++*animation->options.cancels;
}
