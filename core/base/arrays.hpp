// Arrays with special allocators: aligned to cache lines, or placed in large memory pages.
#pragma once

#include <cstddef>
#include <new>
#include <vector>

#if defined(__linux__)
#include <sys/mman.h>
#endif

namespace pdeanim {

// Arrays that begin at a cache line: a register as wide as a cache line is then loaded from one line, not from two.
constexpr std::size_t cache_line = 64;

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

// Arrays of many megabytes that are written before they are read. Their memory is not cleared first, and lies in the
// largest pages of the system: mapping small pages one by one takes longer than most work on the data in them.
template <class T> struct LargePages {
    using value_type = T;

    LargePages() = default;
    template <class Other> LargePages(const LargePages<Other> &) {}

    T *allocate(std::size_t count) {
        const std::size_t bytes = count * sizeof(T);
        if (bytes < worth_large_pages) return static_cast<T *>(::operator new(bytes));
        void *found = ::operator new(bytes, std::align_val_t{large_page});
#if defined(__linux__)
        madvise(found, bytes, MADV_HUGEPAGE);  // only a hint: the system may still use small pages
#endif
        return static_cast<T *>(found);
    }
    void deallocate(T *values, std::size_t count) {
        if (count * sizeof(T) < worth_large_pages) {
            ::operator delete(values);
        } else {
            ::operator delete(values, std::align_val_t{large_page});
        }
    }

    // Leave values uninitialised.
    template <class Value> void construct(Value *place) { ::new (static_cast<void *>(place)) Value; }

    friend bool operator==(const LargePages &, const LargePages &) { return true; }

private:
    static constexpr std::size_t large_page = std::size_t{1} << 21, worth_large_pages = 4 * large_page;
};

template <class T> using LargeArray = std::vector<T, LargePages<T>>;

}  // namespace pdeanim
