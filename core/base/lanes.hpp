// Numbers side by side in vector registers, and loops that are compiled once for each register width.
//
// Only loops whose result does not depend on that width are written so: each lane computes what a loop over single
// numbers would. `Lanes` is one register; `Registers` is as many registers as a fixed count of numbers needs; `in_wide`
// and `in_widest` call a loop in the variant for wide registers.
#pragma once

#include <cstddef>
#include <cstring>
#include <type_traits>

// Marks a function that is compiled for certain instructions: one variant of a loop.
#if defined(__GNUC__) && defined(__x86_64__)
#define PDEANIM_FOR(instructions) __attribute__((target(instructions)))
#endif

// Inlines the templates that a loop calls into each of its variants. WebAssembly has a single variant, and inlining is
// left to the compiler there: a web page has to download the code.
#if defined(_MSC_VER)
#define PDEANIM_INLINE __forceinline
#elif defined(__wasm__)
#define PDEANIM_INLINE inline
#else
#define PDEANIM_INLINE inline __attribute__((always_inline))
#endif

// Inlines lambdas within such loops in the same way.
#if defined(__GNUC__)
#define PDEANIM_INLINE_LAMBDA __attribute__((always_inline))
#else
#define PDEANIM_INLINE_LAMBDA
#endif

#if defined(PDEANIM_FOR)
#include <cstdlib>
#endif

namespace pdeanim {

#if defined(__GNUC__)

template <class T, int count> struct LanesOf {
    typedef T Type __attribute__((vector_size(sizeof(T) * count)));
};
template <class T, int count> using Lanes = typename LanesOf<T, count>::Type;

#else

template <class T, int count> struct Lanes {
    T values[count];

    T &operator[](int i) { return values[i]; }
    const T &operator[](int i) const { return values[i]; }
    Lanes &operator+=(const Lanes &other) { return *this = *this + other; }
    Lanes &operator-=(const Lanes &other) { return *this = *this - other; }
    Lanes operator-() const { return T{} - *this; }
#define PDEANIM_LANEWISE(sign)                                         \
    friend Lanes operator sign(Lanes a, const Lanes &b) {              \
        for (int i = 0; i < count; ++i) a.values[i] = a[i] sign b[i];  \
        return a;                                                      \
    }                                                                  \
    friend Lanes operator sign(T a, const Lanes &b) {                  \
        Lanes found;                                                   \
        for (int i = 0; i < count; ++i) found.values[i] = a sign b[i]; \
        return found;                                                  \
    }                                                                  \
    friend Lanes operator sign(Lanes a, T b) {                         \
        for (int i = 0; i < count; ++i) a.values[i] = a[i] sign b;     \
        return a;                                                      \
    }
    PDEANIM_LANEWISE(+)
    PDEANIM_LANEWISE(-)
    PDEANIM_LANEWISE(*)
    PDEANIM_LANEWISE(/)
#undef PDEANIM_LANEWISE
};
#endif

// Load numbers of an array at any alignment. A pointer to a vector type would not do: some compilers assume that it is
// aligned.
template <int count, class T> PDEANIM_INLINE Lanes<T, count> lanes_at(const T *numbers) {
    Lanes<T, count> found;
    std::memcpy(&found, numbers, sizeof found);
    return found;
}

// Store registers in an array at any alignment.
template <class Row, class T> PDEANIM_INLINE void put_lanes(T *numbers, const Row &lanes) {
    std::memcpy(numbers, &lanes, sizeof lanes);
}

// Set registers, and arrays of registers, to zero. GCC would put `= {}` in memory; this stays in registers.
template <class Row> PDEANIM_INLINE void make_zero(Row &lanes) { lanes = Row{}; }
template <class Row, std::size_t count> PDEANIM_INLINE void make_zero(Row (&rows)[count]) {
    for (Row &row : rows) make_zero(row);
}

// Select `values` in the lanes where `tested` is positive; other lanes get 0.
template <class Row> PDEANIM_INLINE Row where_positive(const Row &tested, const Row &values) {
#if defined(__GNUC__)
    return tested > 0.0 ? values : Row{};
#else
    Row found{};
    for (std::size_t i = 0; i < sizeof(Row) / sizeof(found[0]); ++i) {
        const int lane = static_cast<int>(i);
        if (tested[lane] > 0) found[lane] = values[lane];
    }
    return found;
#endif
}

// Return the results of a function of the lane number, one in each lane.
template <class T, int count, class Number> PDEANIM_INLINE Lanes<T, count> lanes_by(const Number &number) {
    static_assert(count == 2 || count == 4 || count == 8);
    if constexpr (count == 2) {
        return Lanes<T, count>{number(0), number(1)};
    } else if constexpr (count == 4) {
        return Lanes<T, count>{number(0), number(1), number(2), number(3)};
    } else {
        return Lanes<T, count>{number(0), number(1), number(2), number(3), number(4), number(5), number(6), number(7)};
    }
}

// A fixed count of numbers: in one register of at most `bytes`, or in several if one is too short. (GCC keeps vectors
// longer than a register in memory.)
template <class T, int count, int bytes> struct Registers {
    static constexpr int size = bytes / static_cast<int>(sizeof(T)), parts = count / size;
    static_assert(parts * size == count);

    Lanes<T, size> part[parts];

    T operator[](int i) const { return part[i / size][i % size]; }

    static PDEANIM_INLINE Registers all(T value) {
        Registers found;
        for (int p = 0; p < parts; ++p) found.part[p] = value + Lanes<T, size>{};
        return found;
    }
    static PDEANIM_INLINE Registers at(const T *numbers) {
        Registers found;
        for (int p = 0; p < parts; ++p) found.part[p] = lanes_at<size>(numbers + p * size);
        return found;
    }
    // Return the results of a function of the lane number, one in each lane.
    template <class Number> static PDEANIM_INLINE Registers by_lane(const Number &number) {
        Registers found;
        for (int p = 0; p < parts; ++p) {
            found.part[p] = lanes_by<T, size>([&](int lane) PDEANIM_INLINE_LAMBDA { return number(p * size + lane); });
        }
        return found;
    }
    PDEANIM_INLINE void put(T *numbers) const {
        for (int p = 0; p < parts; ++p) put_lanes(numbers + p * size, part[p]);
    }

    PDEANIM_INLINE Registers &operator+=(const Registers &other) { return *this = *this + other; }
    PDEANIM_INLINE Registers &operator-=(const Registers &other) { return *this = *this - other; }
#define PDEANIM_BY_PARTS(sign)                                                       \
    friend PDEANIM_INLINE Registers operator sign(Registers a, const Registers &b) { \
        for (int p = 0; p < parts; ++p) a.part[p] = a.part[p] sign b.part[p];        \
        return a;                                                                    \
    }                                                                                \
    friend PDEANIM_INLINE Registers operator sign(T a, Registers b) {                \
        for (int p = 0; p < parts; ++p) b.part[p] = a sign b.part[p];                \
        return b;                                                                    \
    }                                                                                \
    friend PDEANIM_INLINE Registers operator sign(Registers a, T b) {                \
        for (int p = 0; p < parts; ++p) a.part[p] = a.part[p] sign b;                \
        return a;                                                                    \
    }
    PDEANIM_BY_PARTS(+)
    PDEANIM_BY_PARTS(-)
    PDEANIM_BY_PARTS(*)
    PDEANIM_BY_PARTS(/)
#undef PDEANIM_BY_PARTS
};

template <class T, int count, int bytes>
PDEANIM_INLINE Registers<T, count, bytes> where_positive(const Registers<T, count, bytes> &tested,
                                                         Registers<T, count, bytes> values) {
    for (int p = 0; p < values.parts; ++p) values.part[p] = where_positive(tested.part[p], values.part[p]);
    return values;
}

// Which variant of a loop runs: the one for the processor's widest registers, or a narrower one if the environment
// variable PDECODEC_INSTRUCTIONS is usual, avx2 or avx512f. All variants give the same bits; tests compare them.
template <int bytes> using RegisterBytes = std::integral_constant<int, bytes>;
constexpr int usual_bytes = 16;  // register width that every processor has: for loops without variants

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

// Call a lambda, PDEANIM_INLINE_LAMBDA, that is compiled for each width of vector registers and gets that width in
// bytes.
//
// Everything it calls must be PDEANIM_INLINE. `Registers` of a fixed count compute the same sums at any width. A loop
// has a variant only if that saves 10 % of a whole encode, decode or simulation: `in_wide` stops at 32 bytes, because
// wider registers save less.
template <class Work> void in_wide(const Work &work) {
#if defined(PDEANIM_FOR)
    if (has_avx2()) return with_avx2(work);
#endif
    work(RegisterBytes<usual_bytes>{});
}

template <class Work> void in_widest(const Work &work) {
#if defined(PDEANIM_FOR)
    if (has_avx512f()) return with_avx512f(work);
#endif
    in_wide(work);
}

}  // namespace pdeanim
