// Numbers side by side in a vector register, or in several where the processor's are shorter.
#pragma once

#include <cstring>

#include "multiversion.hpp"

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

// Numbers of an array, wherever they lie: a type of numbers that lie so is one whose alignment some compilers forget.
template <int count, class T> PDEANIM_INLINE Lanes<T, count> lanes_at(const T *numbers) {
    Lanes<T, count> found;
    std::memcpy(&found, numbers, sizeof found);
    return found;
}

// Write them.
template <class Row, class T> PDEANIM_INLINE void put_lanes(T *numbers, const Row &lanes) {
    std::memcpy(numbers, &lanes, sizeof lanes);
}

// Values where what is tested is more than 0, else 0.
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

}  // namespace pdeanim
