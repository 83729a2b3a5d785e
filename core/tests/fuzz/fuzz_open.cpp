// A target of libFuzzer: opens the input bytes as a file, and requests all of its contents, within a small memory
// limit.
//
// If built with FUZZING_BUILD_MODE_UNSAFE_FOR_PRODUCTION, checksums are not compared, so that damaged bytes reach the
// decoders.
#include <cstdint>
#include <cstdlib>
#include <vector>

#include "pdeanim.h"

namespace {

constexpr std::uint64_t max_memory = std::uint64_t{1} << 25;
constexpr std::int64_t most_evaluated = 1 << 18;  // largest number of positions: the memory limit does not count them
constexpr std::int64_t most_runs = 16;            // largest number of runs to open

void ask_for_objects(pdeanim_animation *animation) {
    for (std::int64_t object = 0; object < pdeanim_object_count(animation); ++object) {
        pdeanim_object found;
        std::int64_t attributes = 0;
        if (pdeanim_get_object(animation, object, &found, nullptr)) return;
        if (pdeanim_attribute_count(animation, object, &attributes, nullptr)) return;
        for (std::int64_t index = 0; index < attributes; ++index) {
            pdeanim_attribute attribute;
            if (pdeanim_get_attribute(animation, object, index, &attribute, nullptr)) std::abort();
        }
    }
}

void evaluate(pdeanim_animation *animation) {
    const std::int64_t vertices = pdeanim_vertex_count(animation), frames = pdeanim_frame_count(animation);
    const double *times = pdeanim_times(animation);
    const double first = times[0], last = times[frames - 1];
    const double asked[] = {first, first + (last - first) / 3, (first + last) / 2, last};
    if (vertices * 4 > most_evaluated) return;
    std::vector<float> out(static_cast<std::size_t>(vertices) * 4 * 3);
    for (const pdeanim_quantity quantity : {PDEANIM_POSITIONS, PDEANIM_VELOCITIES, PDEANIM_ACCELERATIONS}) {
        pdeanim_error error;
        const pdeanim_status status =
            pdeanim_evaluate(animation, quantity, asked, 4, PDEANIM_ALL_OBJECTS, out.data(), &error);
        if (status == PDEANIM_INTERNAL || status == PDEANIM_ARGUMENT) std::abort();
    }
}

void evaluate_fields(pdeanim_animation *animation) {
    std::int64_t count = 0;
    if (pdeanim_field_count(animation, &count, nullptr)) return;
    const double *times = pdeanim_times(animation);
    const double last = times[pdeanim_frame_count(animation) - 1];
    const double asked[] = {last, times[0], times[0] + (last - times[0]) / 3};
    for (std::int64_t index = 0; index < count; ++index) {
        pdeanim_field field;
        const pdeanim_status described = pdeanim_get_field(animation, index, &field, nullptr);
        if (described == PDEANIM_INTERNAL || described == PDEANIM_ARGUMENT) std::abort();
        if (described) return;
        const std::int64_t values = field.row_count * field.column_count;
        if (field.row_count > most_evaluated || values > most_evaluated) continue;
        std::vector<unsigned char> out(static_cast<std::size_t>(values) * field.value_bytes * 3);
        const int derivatives = field.type <= PDEANIM_FIELD_FLOAT64 ? 2 : 0;
        for (int derivative = 0; derivative <= derivatives; ++derivative) {
            const pdeanim_status status =
                pdeanim_evaluate_field(animation, index, asked, 3, derivative, out.data(), out.size(), nullptr);
            if (status == PDEANIM_INTERNAL || status == PDEANIM_ARGUMENT) std::abort();
        }
    }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t *data, std::size_t size) {
    const pdeanim_options options{sizeof(pdeanim_options), max_memory, 2, 0, 0};
    pdeanim_animation *animation = nullptr;
    pdeanim_error error;
    const pdeanim_status opened = pdeanim_open_memory(data, size, &options, &animation, &error);
    if (opened == PDEANIM_INTERNAL) std::abort();
    if (opened) return 0;
    if (pdeanim_verify(animation, &error) == PDEANIM_INTERNAL) std::abort();
    const std::int64_t runs = pdeanim_run_count(animation);
    for (std::int64_t k = 0; k < runs && k < most_runs; ++k) {
        pdeanim_animation *run = nullptr;
        const std::int64_t first = pdeanim_first_frame_of_run(animation, k);
        if (first < 0 || pdeanim_run_at(animation, pdeanim_times(animation)[first]) != k) std::abort();
        const pdeanim_status status = pdeanim_open_run(animation, k, &run, &error);
        if (status == PDEANIM_INTERNAL || status == PDEANIM_ARGUMENT) std::abort();
        if (status) continue;
        ask_for_objects(run);
        evaluate(run);
        evaluate_fields(run);
        pdeanim_close(run);
    }
    pdeanim_close(animation);
    return 0;
}
