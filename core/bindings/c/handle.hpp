// Shared by the files of the C interface: the object that a handle points to, and how arguments and exceptions become
// status codes.
#pragma once

#include <atomic>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "decode/animation.hpp"
#include "pdeanim.h"

// The object that a caller's handle points to: a file of several runs, or one run. It also stores results that C
// callers access through pointers and that neither of the two owns.
struct pdeanim_animation {
    pdeanim_animation(std::shared_ptr<const pdeanim::File> whole, const pdeanim::Animation::Options &chosen);
    pdeanim_animation(const pdeanim_animation &whole, std::size_t of_it);

    // Return the only run; ArgumentError if there are several.
    pdeanim::Animation &only();

    std::shared_ptr<const pdeanim::File> file;
    pdeanim::Animation::Options options;
    std::size_t run = 0;
    std::unique_ptr<pdeanim::Animation> animation;
    std::vector<std::vector<std::vector<const char *>>> labels;  // labels of each object's attributes
    pdeanim::i64 corrected_group = -1;                           // the group whose corrections are kept
    std::vector<pdeanim_correction> corrections;                 // corrections in the last group requested
    pdeanim::TakenMemory of_corrections;

    // Guards the members above if the file has several runs.
    std::mutex lock;
    std::optional<std::vector<pdeanim::u8>> remarks;
};

namespace pdeanim {

// Whether the handle is that of an open animation. The handle is not dereferenced.
bool is_open(const pdeanim_animation *handle);

// Return the animation of a handle; ArgumentError if it is not open.
template <class Handle> Handle &opened(Handle *handle) {
    if (!is_open(handle)) throw ArgumentError("the animation is NULL, or closed");
    return *handle;
}

// Raise ArgumentError if a pointer is NULL.
void check_given(const void *pointer, const char *name);

// Raise ArgumentError unless `index` is below `count`; `what` is the name of an item.
void check_index(i64 index, i64 count, const char *what);

Quantity quantity_of(const pdeanim_quantity &quantity);

// Return the status of the exception being handled, and describe it in `error`, which may be NULL.
pdeanim_status describe_thrown(pdeanim_error *error);
pdeanim_status describe_success(pdeanim_error *error);

// Run `work`, and turn every exception into a status.
template <class Work> pdeanim_status guarded(pdeanim_error *error, const Work &work) {
    try {
        work();
    } catch (...) {
        return describe_thrown(error);
    }
    return describe_success(error);
}

}  // namespace pdeanim
