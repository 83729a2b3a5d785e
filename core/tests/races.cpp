// Shares animations among threads through the C interface, for ThreadSanitizer: races CALLS FILE...
//
// Each thread makes its part of the calls, on animations that all threads share: the first thread that needs data
// decodes them. Positions must equal those from a single thread, whatever the other threads do at the same time. Calls
// may be cancelled.
#include <atomic>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <thread>
#include <vector>

#include "pdeanim.h"

namespace {

constexpr std::int64_t threads = 8;
constexpr std::uint64_t max_kept = 1 << 12;  // so small that groups are evicted and decoded again

struct Shared {
    std::vector<std::uint8_t> data;
    pdeanim_animation *file = nullptr, *run = nullptr;  // the file, and its first run
    std::vector<double> times;
    std::vector<float> expected;
};

std::atomic<std::int64_t> faults, cancelled;

void check(pdeanim_status status, const pdeanim_error &error) {
    if (status == PDEANIM_CANCELLED) {
        ++cancelled;
    } else if (status != PDEANIM_OK) {
        ++faults;
        std::fprintf(stderr, "%s\n", error.text);
    }
}

pdeanim_status positions(pdeanim_animation *run, const std::vector<double> &times, std::vector<float> &out,
                         pdeanim_error *error) {
    out.resize(times.size() * 3 * static_cast<std::size_t>(pdeanim_vertex_count(run)));
    return pdeanim_evaluate(run, PDEANIM_POSITIONS, times.data(), times.size(), PDEANIM_ALL_OBJECTS, out.data(), error);
}

void open(Shared &shared) {
    pdeanim_options options{};
    options.size = sizeof options;
    options.threads = 2;
    options.max_kept = max_kept;
    pdeanim_error error;
    if (pdeanim_open_memory(shared.data.data(), shared.data.size(), &options, &shared.file, &error) ||
        pdeanim_open_run(shared.file, 0, &shared.run, &error)) {
        std::fprintf(stderr, "%s\n", error.text);
        std::exit(EXIT_FAILURE);
    }
}

void close(Shared &shared) {
    pdeanim_close(shared.run);
    pdeanim_close(shared.file);
}

void call(const Shared &shared, std::int64_t kind) {
    pdeanim_error error{};
    std::vector<float> out;
    std::int64_t first = 0, count = 0;
    const std::int64_t group = kind / 9 % pdeanim_group_count(shared.run);
    switch (kind % 9) {
        case 0: {
            const pdeanim_status status = positions(shared.run, shared.times, out, &error);
            check(status, error);
            if (status == PDEANIM_OK && out != shared.expected) ++faults;
            break;
        }
        case 1: {
            pdeanim_group found;
            check(pdeanim_get_group(shared.run, group, &found, &error), error);
            out.resize(static_cast<std::size_t>(3 * found.function_count * pdeanim_vertex_count(shared.run)));
            check(pdeanim_fields(shared.run, group, out.data(), &error), error);
            break;
        }
        case 2: {
            pdeanim_object object;
            check(pdeanim_get_object(shared.run, 0, &object, &error), error);
            check(pdeanim_attribute_count(shared.run, 0, &count, &error), error);
            pdeanim_attribute attribute;
            if (count > 0) check(pdeanim_get_attribute(shared.run, 0, kind % count, &attribute, &error), error);
            break;
        }
        case 3: check(pdeanim_verify(shared.file, &error), error); break;
        case 4: pdeanim_cancel(shared.run); break;
        case 5: {
            // A run that only this thread uses, in addition to the shared ones.
            pdeanim_animation *own = nullptr;
            check(pdeanim_open_run(shared.file, 0, &own, &error), error);
            check(positions(own, shared.times, out, &error), error);
            if (out != shared.expected) ++faults;
            pdeanim_close(own);
            break;
        }
        case 6: {
            const void *data = nullptr;
            std::size_t size = 0;
            check(pdeanim_remarks(shared.file, &data, &size, &error), error);
            check(pdeanim_groups_at(shared.run, PDEANIM_VELOCITIES, shared.times.back(), &first, &count, &error),
                  error);
            break;
        }
        case 7: {
            const pdeanim_correction *corrections = nullptr;
            check(pdeanim_corrections(shared.run, group, &corrections, &count, &error), error);
            break;
        }
        default: {
            out.resize(3 * static_cast<std::size_t>(pdeanim_vertex_count(shared.run)));
            check(pdeanim_reference(shared.run, out.data(), &error), error);
            std::vector<std::int32_t> elements(out.size() / 3);
            check(pdeanim_elements(shared.run, elements.data(), &error), error);
        }
    }
}

}  // namespace

int main(int argument_count, char **arguments) {
    if (argument_count < 3) {
        std::fprintf(stderr, "usage: %s CALLS FILE...\n", arguments[0]);
        return EXIT_FAILURE;
    }
    std::vector<Shared> files;
    for (int k = 2; k < argument_count; ++k) {
        std::FILE *file = std::fopen(arguments[k], "rb");
        if (!file) {
            std::perror(arguments[k]);
            return EXIT_FAILURE;
        }
        Shared &shared = files.emplace_back();
        for (int byte = std::fgetc(file); byte != EOF; byte = std::fgetc(file))
            shared.data.push_back(static_cast<std::uint8_t>(byte));
        std::fclose(file);
        // Compute the expected values in one thread, then close the animations, so that the threads start with nothing
        // decoded.
        open(shared);
        const double *times = pdeanim_times(shared.run);
        const std::int64_t last = pdeanim_frame_count(shared.run) - 1;
        shared.times = {times[last], times[0], times[last / 2], 0.3 * times[0] + 0.7 * times[last]};
        pdeanim_error error;
        check(positions(shared.run, shared.times, shared.expected, &error), error);
        close(shared);
        open(shared);
    }
    const std::int64_t calls = std::atoll(arguments[1]) / threads;
    std::vector<std::thread> working;
    for (std::int64_t number = 0; number < threads; ++number) {
        working.emplace_back([&files, calls, number] {
            for (std::int64_t k = 0; k < calls; ++k) {
                call(files[static_cast<std::size_t>(k) % files.size()], 7 * number + 31 * k);
            }
        });
    }
    for (std::thread &thread : working) thread.join();
    for (Shared &shared : files) close(shared);
    std::printf("%lld calls of %lld threads, %lld cancelled, %lld not as they must be\n",
                static_cast<long long>(calls * threads), static_cast<long long>(threads),
                static_cast<long long>(cancelled), static_cast<long long>(faults));
    return faults ? EXIT_FAILURE : EXIT_SUCCESS;
}
