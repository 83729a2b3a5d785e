// The C interface (begin here): calls `Animation`. handle.cpp opens and closes animations and turns exceptions into
// status codes; products.cpp has the functions for programs that evaluate on a graphics processor.
#include "pdeanim.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>

#include "bindings/c/handle.hpp"

using namespace pdeanim;

namespace {

pdeanim_type type_of(ValueType type) {
    switch (type) {
        case ValueType::float32: return PDEANIM_FLOAT32;
        case ValueType::float64: return PDEANIM_FLOAT64;
        case ValueType::int32: return PDEANIM_INT32;
        case ValueType::int64: return PDEANIM_INT64;
        default: return PDEANIM_UINT8;
    }
}

const std::vector<SectionEntry> &sections_of(const pdeanim_animation &handle) {
    return handle.animation ? handle.animation->sections().container().entries() : handle.file->container().entries();
}

}  // namespace

const char *pdeanim_version(void) { return "1.0.0"; }

int pdeanim_format_version(void) { return Container::major_version; }

int64_t pdeanim_frame_count(const pdeanim_animation *animation) {
    if (!is_open(animation)) return -1;
    return animation->animation ? animation->animation->sections().frames() : animation->file->frames();
}

int64_t pdeanim_vertex_count(const pdeanim_animation *animation) {
    if (!is_open(animation)) return -1;
    if (animation->animation) return animation->animation->sections().vertices();
    i64 found = 0;
    for (const Run &run : animation->file->runs()) found = std::max(found, run.vertices);
    return found;
}

int64_t pdeanim_object_count(const pdeanim_animation *animation) {
    if (!is_open(animation)) return -1;
    return animation->animation ? animation->animation->sections().objects() : 0;
}

double pdeanim_frame_rate(const pdeanim_animation *animation) {
    return is_open(animation) ? animation->file->sequence().fps : -1;
}

const double *pdeanim_times(const pdeanim_animation *animation) {
    if (!is_open(animation)) return nullptr;
    return (animation->animation ? animation->animation->sections().times() : animation->file->sequence().times).data();
}

int64_t pdeanim_run_count(const pdeanim_animation *animation) {
    if (!is_open(animation)) return -1;
    return animation->animation ? 1 : static_cast<int64_t>(animation->file->runs().size());
}

int64_t pdeanim_run_at(const pdeanim_animation *animation, double time) {
    if (!is_open(animation) || std::isnan(time)) return -1;
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
        opened(animation);
        check_given(data, "data");
        check_given(size, "size");
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
        Animation &animation = opened(handle).only();
        check_given(object, "object");
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

pdeanim_status pdeanim_get_cells(pdeanim_animation *handle, int64_t index, pdeanim_cells *cells, pdeanim_error *error) {
    return guarded(error, [&] {
        Animation &animation = opened(handle).only();
        check_given(cells, "cells");
        check_index(index, animation.sections().objects(), "object");
        const Connectivity &part = animation.sections().connectivity()[index];
        *cells = {.cell_count = static_cast<int64_t>(part.cell_sizes.size()),
                  .node_count = static_cast<int64_t>(part.cell_indices.size()),
                  .shapes = part.cell_shapes.data(),
                  .sizes = part.cell_sizes.data(),
                  .indices = part.cell_indices.data()};
    });
}

pdeanim_status pdeanim_attribute_count(pdeanim_animation *handle, int64_t object, int64_t *count,
                                       pdeanim_error *error) {
    return guarded(error, [&] {
        Animation &animation = opened(handle).only();
        check_given(count, "count");
        check_index(object, animation.sections().objects(), "object");
        *count = static_cast<int64_t>(animation.sections().attributes()[object].size());
    });
}

pdeanim_status pdeanim_get_attribute(pdeanim_animation *handle, int64_t object, int64_t index,
                                     pdeanim_attribute *attribute, pdeanim_error *error) {
    return guarded(error, [&] {
        Animation &animation = opened(handle).only();
        check_given(attribute, "attribute");
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

pdeanim_status pdeanim_field_count(pdeanim_animation *handle, int64_t *count, pdeanim_error *error) {
    return guarded(error, [&] {
        check_given(count, "count");
        *count = static_cast<int64_t>(opened(handle).only().stored_fields().headers().size());
    });
}

pdeanim_status pdeanim_get_field(pdeanim_animation *handle, int64_t index, pdeanim_field *field, pdeanim_error *error) {
    return guarded(error, [&] {
        StoredFields &fields = opened(handle).only().stored_fields();
        check_given(field, "field");
        check_index(index, static_cast<i64>(fields.headers().size()), "field");
        const FieldHeader &found = fields.headers()[index];
        *field = {.name = found.name.c_str(),
                  .unit = found.unit.c_str(),
                  .domain = static_cast<pdeanim_domain>(found.domain),
                  .type = static_cast<pdeanim_field_type>(found.type),
                  .row_count = fields.rows(index),
                  .column_count = found.components,
                  .value_bytes = static_cast<size_t>(size_of_type(found.type)),
                  .smallest = found.smallest,
                  .largest = found.largest,
                  .bound = found.bound,
                  .object_count = static_cast<int64_t>(found.objects.size()),
                  .objects = found.objects.data()};
    });
}

pdeanim_status pdeanim_evaluate_field(pdeanim_animation *handle, int64_t index, const double *times, size_t count,
                                      int derivative, void *out, size_t size, pdeanim_error *error) {
    return guarded(error, [&] {
        StoredFields &fields = opened(handle).only().stored_fields();
        check_index(index, static_cast<i64>(fields.headers().size()), "field");
        if (count > 0) check_given(times, "times");
        if (size > 0) check_given(out, "out");
        const FieldHeader &found = fields.headers()[index];
        const u64 row = static_cast<u64>(fields.rows(index) * found.components * size_of_type(found.type));
        if (count > PTRDIFF_MAX / sizeof(double)) throw ArgumentError("there cannot be so many times");
        if (row > 0 ? size % row != 0 || size / row != count : size != 0)
            throw ArgumentError("size does not fit the field");
        if (derivative < 0 || derivative > 2 || (derivative && !is_float(found.type))) {
            throw ArgumentError("a derivative is 0 to 2, and of floats alone");
        }
        fields.evaluate(index, {times, count}, derivative, std::nullopt, {static_cast<u8 *>(out), size});
    });
}

pdeanim_status pdeanim_evaluate(pdeanim_animation *handle, pdeanim_quantity quantity, const double *times, size_t count,
                                int64_t object, float *out, pdeanim_error *error) {
    return guarded(error, [&] {
        Animation &animation = opened(handle).only();
        const Quantity wanted = quantity_of(quantity);
        if (object != PDEANIM_ALL_OBJECTS) check_index(object, animation.sections().objects(), "object");
        const std::optional<i64> which = object == PDEANIM_ALL_OBJECTS ? std::nullopt : std::optional<i64>(object);
        const i64 vertices =
            which ? animation.sections().first_vertex(object + 1) - animation.sections().first_vertex(object)
                  : animation.sections().vertices();
        if (count > 0) check_given(times, "times");
        if (count > 0 && vertices > 0) check_given(out, "out");
        // A negative count, converted to unsigned, is larger than any memory.
        if (count > PTRDIFF_MAX / (3 * sizeof(float)) / static_cast<std::size_t>(std::max<i64>(vertices, 1)))
            throw ArgumentError("there cannot be so many times");
        animation.evaluator().evaluate(wanted, {times, count}, which,
                                       {out, count * 3 * static_cast<std::size_t>(vertices)});
    });
}

int64_t pdeanim_section_count(const pdeanim_animation *animation) {
    return is_open(animation) ? static_cast<int64_t>(sections_of(*animation).size()) : -1;
}

pdeanim_status pdeanim_get_section(const pdeanim_animation *animation, int64_t index, pdeanim_section *section,
                                   pdeanim_error *error) {
    return guarded(error, [&] {
        const std::vector<SectionEntry> &sections = sections_of(opened(animation));
        check_given(section, "section");
        check_index(index, static_cast<i64>(sections.size()), "section");
        const SectionEntry &found = sections[static_cast<std::size_t>(index)];
        section->type = found.type.c_str();
        section->offset = found.offset;
        section->length = found.length;
    });
}

pdeanim_status pdeanim_verify(pdeanim_animation *animation, pdeanim_error *error) {
    return guarded(error, [&] {
        if (opened(animation).animation) {
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
