// Failures of the core: thrown inside, turned into codes at the C interface and into Python's errors at the bindings.
#pragma once

#include <stdexcept>
#include <string>

namespace pdeanim {

// The bytes are not those of a sound file.
struct CorruptError : std::runtime_error {
    using std::runtime_error::runtime_error;
};

// The bytes ask for more than the caller's limits allow.
struct LimitError : std::runtime_error {
    using std::runtime_error::runtime_error;
};

}  // namespace pdeanim
