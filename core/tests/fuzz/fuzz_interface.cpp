// A target of libFuzzer: makes the calls of the C interface that the input bytes describe, with arbitrary numbers. The
// file is read through a callback, which may fail or return too few bytes.
//
// If the bytes end in a mark, the calls come before the mark, and the file before the calls. Otherwise all bytes are
// the file, and each kind of call is made once, so that the vectors are useful inputs to begin with.
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <string_view>
#include <vector>

#include "pdeanim.h"

namespace {

constexpr std::uint64_t max_memory = std::uint64_t{1} << 25, max_output = std::uint64_t{1} << 30;
constexpr std::uint64_t most_numbers = 1 << 21;  // largest output of a call, which the memory limit does not count
constexpr std::size_t most_calls = 12, most_times = 4, head_size = 2;
constexpr std::uint8_t kinds = 7;
constexpr std::string_view mark = "CALL";

// A call and its numbers, taken from the end of the bytes.
struct Call {
    std::uint8_t what = 0, quantity = 0;
    std::int64_t number = 0;
    float time = 0.0f;
};
constexpr std::size_t call_size = 2 + sizeof(std::int64_t) + sizeof(float);

Call call_at(const std::uint8_t *data) {
    Call call{.what = data[0], .quantity = data[1]};
    std::memcpy(&call.number, data + 2, sizeof call.number);
    std::memcpy(&call.time, data + 2 + sizeof call.number, sizeof call.time);
    if (call.what & 0x80) call.number %= 4;  // usually the number of an existing item
    return call;
}

struct File {
    const std::uint8_t *data;
    std::size_t size;
    std::size_t fails_after;  // number of reads before failure; 0: never fails
    std::size_t reads = 0;
};

int64_t read(void *user, uint64_t offset, void *into, size_t size) {
    File &file = *static_cast<File *>(user);
    if (file.fails_after && ++file.reads > file.fails_after) return file.reads % 2 ? -1 : 0;
    if (offset >= file.size) return 0;
    const std::size_t count = size < file.size - offset ? size : file.size - static_cast<std::size_t>(offset);
    std::memcpy(into, file.data + offset, count);
    return static_cast<std::int64_t>(count);
}

void check(pdeanim_status status) {
    if (status == PDEANIM_INTERNAL) std::abort();
}

// Evaluate at up to most_times times at once, some of which may be NaN.
void evaluate(pdeanim_animation *animation, const Call &call) {
    const auto vertices = static_cast<std::uint64_t>(pdeanim_vertex_count(animation));
    if (vertices * most_times * 3 > most_numbers) return;
    std::vector<double> times;
    for (std::size_t k = 0; k < most_times; ++k)
        times.push_back(static_cast<double>(call.time) * static_cast<double>(k));
    std::vector<float> out(vertices * most_times * 3);
    const auto quantity = static_cast<pdeanim_quantity>(call.quantity % 4);
    pdeanim_error error;
    check(pdeanim_evaluate(animation, quantity, times.data(), most_times, call.number, out.data(), &error));
    // A huge number of times must be refused before any of them is read.
    if (call.number < -1 &&
        pdeanim_evaluate(animation, PDEANIM_POSITIONS, times.data(), static_cast<std::size_t>(call.number),
                         PDEANIM_ALL_OBJECTS, out.data(), &error) == PDEANIM_OK &&
        vertices > 0) {
        std::abort();
    }
}

void look_at_group(pdeanim_animation *animation, const Call &call) {
    pdeanim_error error;
    pdeanim_group group;
    const pdeanim_status status = pdeanim_get_group(animation, call.number, &group, &error);
    check(status);
    const auto vertices = static_cast<std::uint64_t>(pdeanim_vertex_count(animation));
    const auto quantity = static_cast<pdeanim_quantity>(call.quantity % 4);
    std::int64_t first = 0, count = 0;
    check(pdeanim_groups_at(animation, quantity, call.time, &first, &count, &error));
    if (status) return;
    const auto functions = static_cast<std::uint64_t>(group.function_count);
    if (functions * vertices * 3 > most_numbers) return;
    std::vector<double> weights(3 * functions + 1);
    check(pdeanim_weights(animation, quantity, call.time, call.number, weights.data(), &error));
    std::vector<float> fields(3 * functions * vertices + 1);
    check(pdeanim_fields(animation, call.number, fields.data(), &error));
    const pdeanim_correction *corrections = nullptr;
    check(pdeanim_corrections(animation, call.number, &corrections, &count, &error));
}

void look_at_object(pdeanim_animation *animation, const Call &call) {
    pdeanim_error error;
    pdeanim_object object;
    pdeanim_cells cells;
    pdeanim_attribute attribute;
    std::int64_t count = 0;
    check(pdeanim_get_object(animation, call.number, &object, &error));
    check(pdeanim_get_cells(animation, call.number, &cells, &error));
    check(pdeanim_attribute_count(animation, call.number, &count, &error));
    check(pdeanim_get_attribute(animation, call.number, call.quantity, &attribute, &error));
    check(pdeanim_get_attribute(animation, call.quantity % 4, call.number, &attribute, &error));
}

// Evaluate a field at one time; then with a size that does not fit, which must be refused.
void look_at_field(pdeanim_animation *animation, const Call &call) {
    pdeanim_error error;
    pdeanim_field field;
    std::int64_t count = 0;
    check(pdeanim_field_count(animation, &count, &error));
    const pdeanim_status status = pdeanim_get_field(animation, call.number, &field, &error);
    check(status);
    if (status) return;
    const auto rows = static_cast<std::uint64_t>(field.row_count),
               columns = static_cast<std::uint64_t>(field.column_count);
    if (rows > most_numbers || rows * columns > most_numbers) return;
    std::vector<unsigned char> out(rows * columns * field.value_bytes + 1);
    const double time = call.time;
    const int derivative = static_cast<signed char>(call.quantity) % 4;
    check(pdeanim_evaluate_field(animation, call.number, &time, 1, derivative, out.data(), out.size() - 1, &error));
    if (pdeanim_evaluate_field(animation, call.number, &time, 1, 0, out.data(), out.size(), &error) == PDEANIM_OK)
        std::abort();
}

void look_at_file(pdeanim_animation *animation, const Call &call) {
    pdeanim_error error;
    pdeanim_section section;
    check(pdeanim_get_section(animation, call.number, &section, &error));
    const void *remarks = nullptr;
    std::size_t size = 0;
    check(pdeanim_remarks(animation, &remarks, &size, &error));
    pdeanim_first_frame_of_run(animation, call.number);
    pdeanim_run_at(animation, call.time);
    const auto vertices = static_cast<std::uint64_t>(pdeanim_vertex_count(animation));
    if (vertices * 3 > most_numbers) return;
    std::vector<float> points(3 * vertices);
    std::vector<std::int32_t> elements(vertices);
    check(pdeanim_reference(animation, points.data(), &error));
    check(pdeanim_elements(animation, elements.data(), &error));
}

void make(pdeanim_animation *animation, const Call &call) {
    pdeanim_error error;
    pdeanim_animation *run = nullptr;
    switch (call.what % kinds) {
        case 0: evaluate(animation, call); break;
        case 1: look_at_group(animation, call); break;
        case 2: look_at_object(animation, call); break;
        case 3: look_at_file(animation, call); break;
        case 4: check(pdeanim_verify(animation, &error)); break;
        case 5: look_at_field(animation, call); break;
        default:
            check(pdeanim_open_run(animation, call.number, &run, &error));
            if (!run) break;
            evaluate(run, call);
            look_at_group(run, call);
            look_at_object(run, call);
            look_at_field(run, call);
            pdeanim_close(run);
    }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t *data, std::size_t size) {
    std::size_t fails_after = 0;
    std::vector<Call> calls;
    if (size >= mark.size() + head_size && std::memcmp(data + size - mark.size(), mark.data(), mark.size()) == 0) {
        size -= mark.size() + head_size;
        fails_after = data[size];
        for (std::size_t count = data[size + 1] % most_calls; count > 0 && size >= call_size; --count) {
            size -= call_size;
            calls.push_back(call_at(data + size));
        }
    } else {
        for (std::uint8_t what = 0; what < kinds; ++what) calls.push_back({.what = what});
    }
    File file{data, size, fails_after};
    pdeanim_options options{};
    options.size = sizeof options;
    options.max_memory = max_memory;
    options.threads = 1;
    options.max_output = max_output;
    pdeanim_animation *animation = nullptr;
    pdeanim_error error;
    check(pdeanim_open_read(read, &file, size, &options, &animation, &error));
    if (!animation) return 0;
    for (const Call &call : calls) make(animation, call);
    pdeanim_close(animation);
    return 0;
}
