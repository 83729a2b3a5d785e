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

    Lanes &operator+=(const Lanes &other) {
        for (int i = 0; i < count; ++i) values[i] += other.values[i];
        return *this;
    }
    friend Lanes operator*(T factor, Lanes a) {
        for (int i = 0; i < count; ++i) a.values[i] *= factor;
        return a;
    }
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

}  // namespace pdeanim
