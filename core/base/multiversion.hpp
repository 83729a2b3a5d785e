// Loops that are compiled once for each width of vector registers; instructions.hpp says which are taken.
//
// Only for loops whose result does not depend on that width: each lane does what a loop over single numbers would.
#pragma once

// A variant of such a loop.
#if defined(__GNUC__) && defined(__x86_64__)
#define PDEANIM_FOR(instructions) __attribute__((target(instructions)))
#endif

// For the templates that such loops are written as: they must become part of each version. In a page there is one version,
// and code is fetched.
#if defined(_MSC_VER)
#define PDEANIM_INLINE __forceinline
#elif defined(__wasm__)
#define PDEANIM_INLINE inline
#else
#define PDEANIM_INLINE inline __attribute__((always_inline))
#endif

// For the lambdas within them.
#if defined(__GNUC__)
#define PDEANIM_INLINE_LAMBDA __attribute__((always_inline))
#else
#define PDEANIM_INLINE_LAMBDA
#endif
