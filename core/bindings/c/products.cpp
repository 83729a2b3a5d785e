// The part of the C interface for programs that evaluate on a graphics processor: groups of frames, and the weights,
// fields and corrections that add up to a quantity.
#include <algorithm>
#include <cstdint>

#include "bindings/c/handle.hpp"
#include "pdeanim.h"

using namespace pdeanim;

int64_t pdeanim_group_count(const pdeanim_animation *animation) {
    if (!is_open(animation)) return -1;
    return animation->animation ? static_cast<int64_t>(animation->animation->sections().table().groups().size()) : 0;
}

pdeanim_status pdeanim_get_group(pdeanim_animation *handle, int64_t index, pdeanim_group *group, pdeanim_error *error) {
    return guarded(error, [&] {
        Animation &animation = opened(handle).only();
        check_given(group, "group");
        check_index(index, pdeanim_group_count(handle), "group");
        const Group &found = animation.sections().table().groups()[static_cast<std::size_t>(index)];
        group->first_frame = found.first;
        group->frame_count = found.frames;
        group->function_count = found.functions;
        group->axis_count = found.axes();
    });
}

pdeanim_status pdeanim_reference(pdeanim_animation *handle, float *out, pdeanim_error *error) {
    return guarded(error, [&] {
        Animation &animation = opened(handle).only();
        if (animation.sections().vertices() > 0) check_given(out, "out");
        const std::vector<double> &points = animation.sections().reference().points;
        std::transform(points.begin(), points.end(), out, [](double number) { return static_cast<float>(number); });
    });
}

pdeanim_status pdeanim_groups_at(pdeanim_animation *handle, pdeanim_quantity quantity, double time, int64_t *first,
                                 int64_t *count, pdeanim_error *error) {
    return guarded(error, [&] {
        Animation &animation = opened(handle).only();
        check_given(first, "first");
        check_given(count, "count");
        const auto [begin, end] = animation.evaluator().groups_at(quantity_of(quantity), time);
        *first = static_cast<int64_t>(begin);
        *count = static_cast<int64_t>(end - begin);
    });
}

pdeanim_status pdeanim_weights(pdeanim_animation *handle, pdeanim_quantity quantity, double time, int64_t group,
                               double *out, pdeanim_error *error) {
    return guarded(error, [&] {
        Animation &animation = opened(handle).only();
        check_index(group, pdeanim_group_count(handle), "group");
        const std::vector<double> found =
            animation.evaluator().weights(quantity_of(quantity), time, static_cast<std::size_t>(group));
        if (!found.empty()) check_given(out, "out");
        std::copy(found.begin(), found.end(), out);
    });
}

pdeanim_status pdeanim_fields(pdeanim_animation *handle, int64_t group, float *out, pdeanim_error *error) {
    return guarded(error, [&] {
        Animation &animation = opened(handle).only();
        check_index(group, pdeanim_group_count(handle), "group");
        const auto index = static_cast<std::size_t>(group);
        const i64 channels = animation.sections().table().groups()[index].channels();
        const auto count = static_cast<std::size_t>(channels * animation.sections().vertices());
        if (count > 0) check_given(out, "out");
        animation.fields().fields(index, {out, count});
    });
}

pdeanim_status pdeanim_corrections(pdeanim_animation *handle, int64_t group, const pdeanim_correction **corrections,
                                   int64_t *count, pdeanim_error *error) {
    return guarded(error, [&] {
        Animation &animation = opened(handle).only();
        check_given(corrections, "corrections");
        check_given(count, "count");
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
        Animation &animation = opened(handle).only();
        if (animation.sections().vertices() > 0) check_given(out, "out");
        const std::vector<i32> found = animation.fields().elements();
        std::copy(found.begin(), found.end(), out);
    });
}
