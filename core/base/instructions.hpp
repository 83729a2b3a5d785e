// Which of the loops that are written for several widths of vector registers are taken: those of the widest that the
// processor has, or narrower ones where the environment's PDECODEC_INSTRUCTIONS says usual, avx2 or avx512f. All give the
// same bits; tests compare them.
#pragma once

#include <type_traits>

#include "base/multiversion.hpp"

#if defined(PDEANIM_FOR)
#include <cstdlib>
#include <cstring>
#endif

namespace pdeanim {

template <int bytes> using RegisterBytes = std::integral_constant<int, bytes>;

#if defined(PDEANIM_FOR)

enum class Instructions { usual, avx2, avx512f };

inline Instructions instructions() {
    static const Instructions found = [] {
        Instructions widest = Instructions::usual;
        if (__builtin_cpu_supports("avx2")) widest = Instructions::avx2;
        if (__builtin_cpu_supports("avx512f")) widest = Instructions::avx512f;
        const char *asked = std::getenv("PDECODEC_INSTRUCTIONS");
        if (asked && std::strcmp(asked, "usual") == 0) return Instructions::usual;
        if (asked && std::strcmp(asked, "avx2") == 0 && widest > Instructions::avx2) return Instructions::avx2;
        return widest;
    }();
    return found;
}

inline bool has_avx512f() { return instructions() >= Instructions::avx512f; }
inline bool has_avx2() { return instructions() >= Instructions::avx2; }

template <class Work> PDEANIM_FOR("avx512f") void with_avx512f(const Work &work) { work(RegisterBytes<64>{}); }
template <class Work> PDEANIM_FOR("avx2") void with_avx2(const Work &work) { work(RegisterBytes<32>{}); }

#endif

// Call a lambda, PDEANIM_INLINE_LAMBDA, that is compiled for each width of vector registers and gets how many bytes they
// have; so must be what it calls, PDEANIM_INLINE. `Registers` of so many numbers, whatever their width, are what it does
// the same sums in.
template <class Work> void in_widest(const Work &work) {
#if defined(PDEANIM_FOR)
    if (has_avx512f()) return with_avx512f(work);
    if (has_avx2()) return with_avx2(work);
#endif
    work(RegisterBytes<16>{});
}

}  // namespace pdeanim
