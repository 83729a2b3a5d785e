// Failures of the core: thrown inside, turned into codes at the C interface and into Python's errors at the bindings.
#pragma once

#include <stdexcept>
#include <string>

#include "base/arithmetic.hpp"

namespace pdeanim {

// The bytes are not those of a sound file; where that is known, at which byte of the file and at which frame.
struct CorruptError : std::runtime_error {
    explicit CorruptError(const std::string &message, i64 offset_ = -1, i64 frame_ = -1)
        : std::runtime_error(message), offset(offset_), frame(frame_) {}

    i64 offset, frame;
};

// The bytes ask for more than the caller's limits allow.
struct LimitError : std::runtime_error {
    using std::runtime_error::runtime_error;
};

// What the caller asks for cannot be had.
struct ArgumentError : std::invalid_argument {
    using std::invalid_argument::invalid_argument;
};

// The caller's read callback failed.
struct ReadError : std::runtime_error {
    using std::runtime_error::runtime_error;
};

}  // namespace pdeanim
