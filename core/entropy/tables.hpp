// Tables of the range coder: integers that the specification defines, the same on every machine.
#pragma once

#include <array>

#include "base/arithmetic.hpp"

// Without this, every access goes through a table of addresses: -fvisibility does not apply to `extern`.
#if defined(__GNUC__)
#pragma GCC visibility push(hidden)
#endif

namespace pdeanim::tables {

inline constexpr int logistic_limit = 2047;  // largest magnitude of log odds [1/256]
inline constexpr int rarest = 32;            // least probability of either bit [1/65536]

// Logistic domain, from -logistic_limit on, to probability [1/65536], none below the least.
extern const std::array<u16, 2 * logistic_limit + 1> squash;

// Probability [1/4096] to the logistic domain [1/256].
extern const std::array<i16, 4096> stretch;

// Cost of a bit of a probability [1/4096], in 1/65536 of a bit.
extern const std::array<i32, 4096> costs;

}  // namespace pdeanim::tables

#if defined(__GNUC__)
#pragma GCC visibility pop
#endif
