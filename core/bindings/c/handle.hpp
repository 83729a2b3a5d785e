// What the files of the C interface share: what a handle points to, and how arguments and exceptions become codes.
#pragma once

#include <atomic>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "decode/animation.hpp"
#include "pdeanim.h"

// What a caller's handle points to: a file of several runs, or one run, and what results point to that neither owns.
struct pdeanim_animation {
    pdeanim_animation(std::shared_ptr<const pdeanim::File> whole, const pdeanim::Animation::Options &chosen);
    pdeanim_animation(const pdeanim_animation &whole, std::size_t of_it);

    // The run; ArgumentError where there are several.
    pdeanim::Animation &only();

    std::shared_ptr<const pdeanim::File> file;
    pdeanim::Animation::Options options;
    std::size_t run = 0;
    std::unique_ptr<pdeanim::Animation> animation;
    std::vector<std::vector<std::vector<const char *>>> labels;  // of each object's attributes
    pdeanim::i64 corrected_group = -1;                           // the one that was asked for last
    std::vector<pdeanim_correction> corrections;                 // of it
    pdeanim::TakenMemory of_corrections;

    // Of several runs:
    std::mutex lock;
    std::optional<std::vector<pdeanim::u8>> remarks;
};

namespace pdeanim {

// Whether a handle has been opened and not closed since. What it points to is not read.
bool is_open(const pdeanim_animation *handle);

// ArgumentError for a handle that is not open.
template <class Handle> Handle &opened(Handle *handle) {
    if (!is_open(handle)) throw ArgumentError("the animation is NULL, or closed");
    return *handle;
}

// ArgumentError for NULL.
void check_given(const void *pointer, const char *name);

// ArgumentError where there is no such number of a `what`.
void check_index(i64 index, i64 count, const char *what);

Quantity quantity_of(const pdeanim_quantity &quantity);

// The status of the exception that is being handled, described in `error`, which may be NULL.
pdeanim_status describe_thrown(pdeanim_error *error);
pdeanim_status describe_success(pdeanim_error *error);

// Run `work`; nothing that it throws leaves the library.
template <class Work> pdeanim_status guarded(pdeanim_error *error, const Work &work) {
    try {
        work();
    } catch (...) {
        return describe_thrown(error);
    }
    return describe_success(error);
}

}  // namespace pdeanim
