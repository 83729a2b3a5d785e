// The C interface: hands over to `Animation`, and turns what it throws into codes.
#include "pdeanim.h"

#include <algorithm>
#include <cstring>
#include <new>
#include <stdexcept>

#include "decoder/animation.hpp"

using namespace pdeanim;

// What a caller's handle points to: the animation, and what results point to that it does not own itself.
struct pdeanim_animation {
    pdeanim_animation(std::unique_ptr<Source> source, const Animation::Options &options)
        : animation(std::move(source), options) {}

    Animation animation;
    std::vector<std::vector<std::vector<const char *>>> labels;  // of each object's attributes
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
        return fail(error, PDEANIM_LIMIT, thrown.what());
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

Animation::Options options_of(const pdeanim_options *given) {
    Animation::Options options;
    if (!given) return options;
    // Fields that the caller's version of the structure does not have are as if they were 0.
    pdeanim_options known{};
    std::memcpy(&known, given, std::min(given->size, sizeof known));
    if (known.max_memory > 0) options.max_memory = known.max_memory;
    options.threads = static_cast<int>(std::min<uint32_t>(known.threads, 1024));
    return options;
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

}  // namespace

const char *pdeanim_version(void) { return "1.0.0"; }

int pdeanim_format_version(void) { return Container::major_version; }

pdeanim_status pdeanim_open_memory(const void *data, size_t size, const pdeanim_options *options,
                                   pdeanim_animation **animation, pdeanim_error *error) {
    if (animation) *animation = nullptr;
    if (!data || !animation) return fail(error, PDEANIM_ARGUMENT, "data and animation must not be NULL");
    return guarded(error, [&] {
        auto source = std::make_unique<MemorySource>(std::span<const u8>(static_cast<const u8 *>(data), size));
        *animation = new pdeanim_animation(std::move(source), options_of(options));
    });
}

pdeanim_status pdeanim_open_read(pdeanim_read read, void *user, uint64_t size, const pdeanim_options *options,
                                 pdeanim_animation **animation, pdeanim_error *error) {
    if (animation) *animation = nullptr;
    if (!read || !animation) return fail(error, PDEANIM_ARGUMENT, "read and animation must not be NULL");
    return guarded(error, [&] {
        const auto from = [read, user](u64 offset, std::span<u8> into) {
            const int64_t count = read(user, offset, into.data(), into.size());
            if (count < 0) throw ReadError("the file cannot be read");
            return std::min(static_cast<std::size_t>(count), into.size());
        };
        *animation = new pdeanim_animation(std::make_unique<CallbackSource>(size, from), options_of(options));
    });
}

void pdeanim_close(pdeanim_animation *animation) { delete animation; }

void pdeanim_cancel(pdeanim_animation *animation) { animation->animation.cancel(); }

int64_t pdeanim_frame_count(const pdeanim_animation *animation) { return animation->animation.frames(); }

int64_t pdeanim_vertex_count(const pdeanim_animation *animation) { return animation->animation.vertices(); }

int64_t pdeanim_object_count(const pdeanim_animation *animation) { return animation->animation.objects(); }

double pdeanim_frame_rate(const pdeanim_animation *animation) { return animation->animation.fps(); }

const double *pdeanim_times(const pdeanim_animation *animation) { return animation->animation.times().data(); }

pdeanim_status pdeanim_remarks(pdeanim_animation *animation, const void **data, size_t *size, pdeanim_error *error) {
    return guarded(error, [&] {
        const std::vector<u8> &remarks = animation->animation.remarks();
        *data = remarks.data();
        *size = remarks.size();
    });
}

pdeanim_status pdeanim_get_object(pdeanim_animation *handle, int64_t index, pdeanim_object *object,
                                  pdeanim_error *error) {
    return guarded(error, [&] {
        Animation &animation = handle->animation;
        check_index(index, animation.objects(), "object");
        const Connectivity &part = animation.connectivity()[index];
        object->name = animation.names()[index].c_str();
        object->first_vertex = animation.first_vertex(index);
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
        check_index(object, handle->animation.objects(), "object");
        *count = static_cast<int64_t>(handle->animation.attributes()[object].size());
    });
}

pdeanim_status pdeanim_get_attribute(pdeanim_animation *handle, int64_t object, int64_t index,
                                     pdeanim_attribute *attribute, pdeanim_error *error) {
    return guarded(error, [&] {
        Animation &animation = handle->animation;
        check_index(object, animation.objects(), "object");
        const std::vector<std::vector<Attribute>> &all = animation.attributes();
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
        Animation &animation = handle->animation;
        if (quantity < PDEANIM_POSITIONS || quantity > PDEANIM_ACCELERATIONS)
            throw ArgumentError("an unknown quantity");
        if (object != PDEANIM_ALL_OBJECTS) check_index(object, animation.objects(), "object");
        const std::optional<i64> which = object == PDEANIM_ALL_OBJECTS ? std::nullopt : std::optional<i64>(object);
        const i64 vertices =
            which ? animation.first_vertex(object + 1) - animation.first_vertex(object) : animation.vertices();
        if (count > 0 && (!times || (!out && vertices > 0))) throw ArgumentError("times and out must not be NULL");
        animation.evaluate(static_cast<Quantity>(quantity), {times, count}, which,
                           {out, count * 3 * static_cast<std::size_t>(vertices)});
    });
}

pdeanim_status pdeanim_verify(pdeanim_animation *animation, pdeanim_error *error) {
    return guarded(error, [&] { animation->animation.verify(); });
}
