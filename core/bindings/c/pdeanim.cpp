// The C interface: hands over to `Animation`, and turns what it throws into codes.
#include "pdeanim.h"

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <cstring>
#include <mutex>
#include <new>
#include <optional>
#include <stdexcept>

#include "decode/animation.hpp"

using namespace pdeanim;

// What a caller's handle points to: a file of several runs, or one run, and what results point to that neither owns.
struct pdeanim_animation {
    pdeanim_animation(std::shared_ptr<const File> whole, const Animation::Options &chosen)
        : file(std::move(whole)), options(chosen) {
        options.cancels = std::make_shared<std::atomic<u64>>(0);
        if (file->runs().size() == 1) animation = std::make_unique<Animation>(file, run, options);
    }

    pdeanim_animation(const pdeanim_animation &whole, std::size_t of_it)
        : file(whole.file), options(whole.options), run(whole.animation ? whole.run : of_it) {
        options.cancels = std::make_shared<std::atomic<u64>>(0);
        animation = std::make_unique<Animation>(file, run, options);
    }

    // The run; ArgumentError where there are several.
    Animation &only() {
        if (!animation) {
            throw ArgumentError("the file has " + std::to_string(file->runs().size()) +
                                " runs of frames; open one of them (pdeanim_open_run)");
        }
        return *animation;
    }

    std::shared_ptr<const File> file;
    Animation::Options options;
    std::size_t run = 0;
    std::unique_ptr<Animation> animation;
    std::vector<std::vector<std::vector<const char *>>> labels;  // of each object's attributes
    i64 corrected_group = -1;                                    // the one that was asked for last
    std::vector<pdeanim_correction> corrections;                 // of it
    TakenMemory of_corrections;

    // Of several runs:
    std::mutex lock;
    std::optional<std::vector<u8>> remarks;
};

namespace {

pdeanim_status fail(pdeanim_error *error, pdeanim_status status, const char *text, i64 offset = -1, i64 frame = -1) {
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

// Run `work`; nothing that it throws leaves the library.
template <class Work> pdeanim_status guarded(pdeanim_error *error, const Work &work) {
    try {
        work();
        return error ? fail(error, PDEANIM_OK, "") : PDEANIM_OK;
    } catch (const CorruptError &thrown) {
        return fail(error, PDEANIM_CORRUPT, thrown.what(), thrown.offset, thrown.frame);
    } catch (const LimitError &thrown) {
        return fail(error, PDEANIM_LIMIT, (std::string(thrown.what()) + "; raise it if you trust the file").c_str());
    } catch (const ArgumentError &thrown) {
        return fail(error, PDEANIM_ARGUMENT, thrown.what());
    } catch (const ReadError &thrown) {
        return fail(error, PDEANIM_READ_FAILED, thrown.what());
    } catch (const CancelledError &thrown) {
        return fail(error, PDEANIM_CANCELLED, thrown.what());
    } catch (const std::bad_alloc &) {
        return fail(error, PDEANIM_NO_MEMORY, "there is not enough memory; set a lower memory limit");
    } catch (const std::exception &thrown) {
        return fail(error, PDEANIM_INTERNAL, thrown.what());
    } catch (...) {
        return fail(error, PDEANIM_INTERNAL, "an unknown fault");
    }
}

// Refuse files that declare more positions than are wanted.
void check_output(const pdeanim_animation &animation, u64 limit) {
    constexpr u64 bytes_per_position = 12;
    const std::vector<Run> &runs = animation.file->runs();
    u64 found = 0;  // fewer than 2^31 vertices, at frames whose times are in memory, far fewer than 2^33: no overflow
    for (const Run &run : runs) {
        const i64 vertices = animation.animation ? animation.animation->sections().vertices() : run.vertices;
        found += static_cast<u64>(run.frames) * static_cast<u64>(vertices);
    }
    if (limit > 0 && found > limit / bytes_per_position) {
        throw LimitError("declares " + std::to_string(found) + " positions of " + std::to_string(bytes_per_position) +
                         " bytes each; the output limit is " + std::to_string(limit));
    }
}

pdeanim_animation *open_source(std::unique_ptr<Source> source, const pdeanim_options *given) {
    // Fields that the caller's version of the structure does not have are as if they were 0.
    pdeanim_options known{};
    if (given) std::memcpy(&known, given, std::min(given->size, sizeof known));
    Animation::Options options;
    options.threads = static_cast<int>(std::min<uint32_t>(known.threads, 1024));
    if (known.max_kept > 0) options.kept_bytes = static_cast<i64>(std::min<uint64_t>(known.max_kept, INT64_MAX / 2));
    const u64 memory = known.max_memory > 0 ? known.max_memory : File::usual_memory;
    auto opened = std::make_unique<pdeanim_animation>(std::make_shared<const File>(std::move(source), memory), options);
    check_output(*opened, known.max_output);
    return opened.release();
}

void check_index(i64 index, i64 count, const char *what) {
    if (index < 0 || index >= count) {
        throw ArgumentError(std::string("there is no ") + what + " " + std::to_string(index) + ", there are " +
                            std::to_string(count));
    }
}

pdeanim_type type_of(ValueType type) {
    switch (type) {
        case ValueType::float32: return PDEANIM_FLOAT32;
        case ValueType::float64: return PDEANIM_FLOAT64;
        case ValueType::int32: return PDEANIM_INT32;
        case ValueType::int64: return PDEANIM_INT64;
        default: return PDEANIM_UINT8;
    }
}

Quantity quantity_of(pdeanim_quantity quantity) {
    if (quantity < PDEANIM_POSITIONS || quantity > PDEANIM_ACCELERATIONS) throw ArgumentError("an unknown quantity");
    return static_cast<Quantity>(quantity);
}

const std::vector<SectionEntry> &sections_of(const pdeanim_animation &handle) {
    return handle.animation ? handle.animation->sections().container().entries() : handle.file->container().entries();
}

}  // namespace

const char *pdeanim_version(void) { return "1.0.0"; }

int pdeanim_format_version(void) { return Container::major_version; }

pdeanim_status pdeanim_open_memory(const void *data, size_t size, const pdeanim_options *options,
                                   pdeanim_animation **animation, pdeanim_error *error) {
    if (animation) *animation = nullptr;
    if (!data || !animation) return fail(error, PDEANIM_ARGUMENT, "data and animation must not be NULL");
    return guarded(error, [&] {
        auto source = std::make_unique<MemorySource>(std::span<const u8>(static_cast<const u8 *>(data), size));
        *animation = open_source(std::move(source), options);
    });
}

pdeanim_status pdeanim_open_read(pdeanim_read read, void *user, uint64_t size, const pdeanim_options *options,
                                 pdeanim_animation **animation, pdeanim_error *error) {
    if (animation) *animation = nullptr;
    if (!read || !animation) return fail(error, PDEANIM_ARGUMENT, "read and animation must not be NULL");
    return guarded(error, [&] {
        const auto from = [read, user](u64 offset, std::span<u8> into) -> std::size_t {
            if (into.empty()) return 0;  // no caller is to copy to nowhere
            const int64_t count = read(user, offset, into.data(), into.size());
            if (count < 0) throw ReadError("the file cannot be read");
            return std::min(static_cast<std::size_t>(count), into.size());
        };
        *animation = open_source(std::make_unique<CallbackSource>(size, from), options);
    });
}

pdeanim_status pdeanim_open_run(const pdeanim_animation *animation, int64_t run, pdeanim_animation **opened,
                                pdeanim_error *error) {
    if (opened) *opened = nullptr;
    if (!opened) return fail(error, PDEANIM_ARGUMENT, "opened must not be NULL");
    return guarded(error, [&] {
        check_index(run, pdeanim_run_count(animation), "run");
        *opened = new pdeanim_animation(*animation, static_cast<std::size_t>(run));
    });
}

void pdeanim_close(pdeanim_animation *animation) { delete animation; }

void pdeanim_cancel(pdeanim_animation *animation) { ++*animation->options.cancels; }

int64_t pdeanim_frame_count(const pdeanim_animation *animation) {
    return animation->animation ? animation->animation->sections().frames() : animation->file->frames();
}

int64_t pdeanim_vertex_count(const pdeanim_animation *animation) {
    if (animation->animation) return animation->animation->sections().vertices();
    i64 found = 0;
    for (const Run &run : animation->file->runs()) found = std::max(found, run.vertices);
    return found;
}

int64_t pdeanim_object_count(const pdeanim_animation *animation) {
    return animation->animation ? animation->animation->sections().objects() : 0;
}

double pdeanim_frame_rate(const pdeanim_animation *animation) { return animation->file->sequence().fps; }

const double *pdeanim_times(const pdeanim_animation *animation) {
    return (animation->animation ? animation->animation->sections().times() : animation->file->sequence().times).data();
}

int64_t pdeanim_run_count(const pdeanim_animation *animation) {
    return animation->animation ? 1 : static_cast<int64_t>(animation->file->runs().size());
}

int64_t pdeanim_run_at(const pdeanim_animation *animation, double time) {
    return animation->animation ? 0 : static_cast<int64_t>(animation->file->run_at(time));
}

int64_t pdeanim_first_frame_of_run(const pdeanim_animation *animation, int64_t run) {
    const int64_t count = pdeanim_run_count(animation);
    if (run < 0 || run > count) return -1;
    if (run == count) return pdeanim_frame_count(animation);
    return animation->animation ? 0 : animation->file->runs()[static_cast<std::size_t>(run)].first;
}

pdeanim_status pdeanim_remarks(pdeanim_animation *animation, const void **data, size_t *size, pdeanim_error *error) {
    return guarded(error, [&] {
        if (animation->animation) {
            const std::vector<u8> &remarks = animation->animation->sections().remarks();
            *data = remarks.data();
            *size = remarks.size();
            return;
        }
        const std::lock_guard guard(animation->lock);
        if (!animation->remarks) animation->remarks = animation->file->container().read_optional("META");
        *data = animation->remarks->data();
        *size = animation->remarks->size();
    });
}

pdeanim_status pdeanim_get_object(pdeanim_animation *handle, int64_t index, pdeanim_object *object,
                                  pdeanim_error *error) {
    return guarded(error, [&] {
        Animation &animation = handle->only();
        check_index(index, animation.sections().objects(), "object");
        const Connectivity &part = animation.sections().connectivity()[index];
        object->name = animation.sections().names()[index].c_str();
        object->first_vertex = animation.sections().first_vertex(index);
        object->vertex_count = part.vertices;
        object->face_count = static_cast<int64_t>(part.face_sizes.size());
        object->corner_count = static_cast<int64_t>(part.face_indices.size());
        object->line_count = static_cast<int64_t>(part.line_sizes.size());
        object->line_point_count = static_cast<int64_t>(part.line_indices.size());
        object->face_sizes = part.face_sizes.data();
        object->face_indices = part.face_indices.data();
        object->line_sizes = part.line_sizes.data();
        object->line_indices = part.line_indices.data();
    });
}

pdeanim_status pdeanim_attribute_count(pdeanim_animation *handle, int64_t object, int64_t *count,
                                       pdeanim_error *error) {
    return guarded(error, [&] {
        check_index(object, handle->only().sections().objects(), "object");
        *count = static_cast<int64_t>(handle->only().sections().attributes()[object].size());
    });
}

pdeanim_status pdeanim_get_attribute(pdeanim_animation *handle, int64_t object, int64_t index,
                                     pdeanim_attribute *attribute, pdeanim_error *error) {
    return guarded(error, [&] {
        Animation &animation = handle->only();
        check_index(object, animation.sections().objects(), "object");
        const std::vector<std::vector<Attribute>> &all = animation.sections().attributes();
        check_index(index, static_cast<i64>(all[object].size()), "attribute");
        const auto lock = animation.locked();
        if (handle->labels.empty()) {
            for (const std::vector<Attribute> &own : all) {
                handle->labels.emplace_back();
                for (const Attribute &each : own) {
                    std::vector<const char *> &labels = handle->labels.back().emplace_back();
                    for (const std::string &label : each.labels) labels.push_back(label.c_str());
                }
            }
        }
        const Attribute &found = all[object][index];
        const std::vector<const char *> &labels = handle->labels[object][index];
        attribute->name = found.name.c_str();
        attribute->domain = static_cast<pdeanim_domain>(found.domain);
        attribute->type = type_of(found.type);
        attribute->row_count = found.rows;
        attribute->column_count = found.numbers();
        attribute->values = found.values.data();
        attribute->index_count = found.indices ? static_cast<int64_t>(found.indices->size()) : 0;
        attribute->indices = found.indices ? found.indices->data() : nullptr;
        attribute->label_count = static_cast<int64_t>(labels.size());
        attribute->labels = labels.data();
    });
}

pdeanim_status pdeanim_evaluate(pdeanim_animation *handle, pdeanim_quantity quantity, const double *times, size_t count,
                                int64_t object, float *out, pdeanim_error *error) {
    return guarded(error, [&] {
        Animation &animation = handle->only();
        const Quantity wanted = quantity_of(quantity);
        if (object != PDEANIM_ALL_OBJECTS) check_index(object, animation.sections().objects(), "object");
        const std::optional<i64> which = object == PDEANIM_ALL_OBJECTS ? std::nullopt : std::optional<i64>(object);
        const i64 vertices =
            which ? animation.sections().first_vertex(object + 1) - animation.sections().first_vertex(object)
                  : animation.sections().vertices();
        if (count > 0 && (!times || (!out && vertices > 0))) throw ArgumentError("times and out must not be NULL");
        // A negative count, turned into one without a sign, is more than there is memory for.
        if (count > PTRDIFF_MAX / (3 * sizeof(float)) / static_cast<std::size_t>(std::max<i64>(vertices, 1)))
            throw ArgumentError("there cannot be so many times");
        animation.evaluator().evaluate(wanted, {times, count}, which,
                                       {out, count * 3 * static_cast<std::size_t>(vertices)});
    });
}

int64_t pdeanim_group_count(const pdeanim_animation *animation) {
    return animation->animation ? static_cast<int64_t>(animation->animation->sections().table().groups().size()) : 0;
}

pdeanim_status pdeanim_get_group(pdeanim_animation *handle, int64_t index, pdeanim_group *group, pdeanim_error *error) {
    return guarded(error, [&] {
        handle->only();
        check_index(index, pdeanim_group_count(handle), "group");
        const Group &found = handle->only().sections().table().groups()[static_cast<std::size_t>(index)];
        group->first_frame = found.first;
        group->frame_count = found.frames;
        group->function_count = found.functions;
        group->axis_count = found.axes();
    });
}

pdeanim_status pdeanim_reference(pdeanim_animation *handle, float *out, pdeanim_error *error) {
    return guarded(error, [&] {
        const std::vector<double> &points = handle->only().sections().reference().points;
        std::transform(points.begin(), points.end(), out, [](double number) { return static_cast<float>(number); });
    });
}

pdeanim_status pdeanim_groups_at(pdeanim_animation *handle, pdeanim_quantity quantity, double time, int64_t *first,
                                 int64_t *count, pdeanim_error *error) {
    return guarded(error, [&] {
        const auto [begin, end] = handle->only().evaluator().groups_at(quantity_of(quantity), time);
        *first = static_cast<int64_t>(begin);
        *count = static_cast<int64_t>(end - begin);
    });
}

pdeanim_status pdeanim_weights(pdeanim_animation *handle, pdeanim_quantity quantity, double time, int64_t group,
                               double *out, pdeanim_error *error) {
    return guarded(error, [&] {
        handle->only();
        check_index(group, pdeanim_group_count(handle), "group");
        const std::vector<double> found =
            handle->only().evaluator().weights(quantity_of(quantity), time, static_cast<std::size_t>(group));
        std::copy(found.begin(), found.end(), out);
    });
}

pdeanim_status pdeanim_fields(pdeanim_animation *handle, int64_t group, float *out, pdeanim_error *error) {
    return guarded(error, [&] {
        Animation &animation = handle->only();
        check_index(group, pdeanim_group_count(handle), "group");
        const auto index = static_cast<std::size_t>(group);
        const i64 channels = animation.sections().table().groups()[index].channels();
        animation.fields().fields(index, {out, static_cast<std::size_t>(channels * animation.sections().vertices())});
    });
}

pdeanim_status pdeanim_corrections(pdeanim_animation *handle, int64_t group, const pdeanim_correction **corrections,
                                   int64_t *count, pdeanim_error *error) {
    return guarded(error, [&] {
        Animation &animation = handle->only();
        check_index(group, pdeanim_group_count(handle), "group");
        const auto lock = animation.locked();
        if (handle->corrected_group != group) {
            handle->corrected_group = -1;
            handle->corrections = {};
            handle->of_corrections = TakenMemory();
            TakenMemory taken;
            const std::vector<Correction> found =
                animation.fields().corrections(static_cast<std::size_t>(group), taken);
            handle->of_corrections = taken.another();
            handle->of_corrections.take(sizeof(pdeanim_correction) * found.size(), "corrections of a group of frames");
            handle->corrections.reserve(found.size());
            for (const auto &[frame, vertex, offset] : found) {
                handle->corrections.push_back({frame, vertex, {offset[0], offset[1], offset[2]}});
            }
            handle->corrected_group = group;
        }
        *corrections = handle->corrections.data();
        *count = static_cast<int64_t>(handle->corrections.size());
    });
}

pdeanim_status pdeanim_elements(pdeanim_animation *handle, int32_t *out, pdeanim_error *error) {
    return guarded(error, [&] {
        const std::vector<i32> found = handle->only().fields().elements();
        std::copy(found.begin(), found.end(), out);
    });
}

int64_t pdeanim_section_count(const pdeanim_animation *animation) {
    return static_cast<int64_t>(sections_of(*animation).size());
}

pdeanim_status pdeanim_get_section(const pdeanim_animation *animation, int64_t index, pdeanim_section *section,
                                   pdeanim_error *error) {
    return guarded(error, [&] {
        check_index(index, pdeanim_section_count(animation), "section");
        const SectionEntry &found = sections_of(*animation)[static_cast<std::size_t>(index)];
        section->type = found.type.c_str();
        section->offset = found.offset;
        section->length = found.length;
    });
}

pdeanim_status pdeanim_verify(pdeanim_animation *animation, pdeanim_error *error) {
    return guarded(error, [&] {
        if (animation->animation) {
            animation->animation->verify();
            return;
        }
        const std::atomic<u64> &cancels = *animation->options.cancels;
        const u64 before = cancels;
        animation->file->container().verify();
        for (std::size_t run = 0; run < animation->file->runs().size(); ++run) {
            Animation own(animation->file, run, animation->options);
            if (cancels != before) throw CancelledError();
            own.verify();
        }
    });
}
