// Arrays that begin with a line of the cache: a register as wide as a line is read from one line then, not from two.
#pragma once

#include <cstddef>
#include <new>
#include <vector>

namespace pdeanim {

constexpr std::size_t cache_line = 64;  // bytes

template <class T> struct OnCacheLine {
    using value_type = T;

    OnCacheLine() = default;
    template <class Other> OnCacheLine(const OnCacheLine<Other> &) {}

    T *allocate(std::size_t count) {
        return static_cast<T *>(::operator new(count * sizeof(T), std::align_val_t{cache_line}));
    }
    void deallocate(T *values, std::size_t) { ::operator delete(values, std::align_val_t{cache_line}); }

    friend bool operator==(const OnCacheLine &, const OnCacheLine &) { return true; }
};

template <class T> using AlignedArray = std::vector<T, OnCacheLine<T>>;

}  // namespace pdeanim
