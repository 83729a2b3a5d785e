// Numbers side by side in a vector register, or in several where the processor's are shorter.
#pragma once

#include "multiversion.hpp"

namespace pdeanim {

#if defined(__GNUC__)

template <class T, int count> struct LanesOf {
    typedef T Type __attribute__((vector_size(sizeof(T) * count)));
    typedef T InMemory __attribute__((vector_size(sizeof(T) * count), aligned(sizeof(T)), may_alias));
};
template <class T, int count> using Lanes = typename LanesOf<T, count>::Type;
template <class T, int count> using LanesInMemory = typename LanesOf<T, count>::InMemory;

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
template <class T, int count> using LanesInMemory = Lanes<T, count>;

#endif

// Numbers in an array as a register would hold them.
template <int count, class T> PDEANIM_INLINE LanesInMemory<T, count> &lanes_at(T *numbers) {
    return *reinterpret_cast<LanesInMemory<T, count> *>(numbers);
}
template <int count, class T> PDEANIM_INLINE const LanesInMemory<T, count> &lanes_at(const T *numbers) {
    return *reinterpret_cast<const LanesInMemory<T, count> *>(numbers);
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
