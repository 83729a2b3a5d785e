// The part of the C++ library's threads that the core uses, for a single thread: the C++ library that comes with the
// compiler for WebAssembly leaves these classes out. Every source is compiled with this header in front (build.py).
#pragma once

namespace std {

class mutex {
public:
    void lock() {}
    bool try_lock() { return true; }
    void unlock() {}
};

using recursive_mutex = mutex;

class condition_variable {
public:
    void notify_one() {}
    void notify_all() {}

    // No other thread can make the predicate true: it already is, or the core never waits for it.
    template <class Lock, class Predicate> void wait(Lock &, const Predicate &) {}
};

// The work to wait for is already done.
class latch {
public:
    explicit latch(long) {}
    void count_down() {}
    void wait() const {}
};

// Does its work at once.
class jthread {
public:
    jthread() = default;
    template <class Work> explicit jthread(Work &&work) { work(); }
};

class thread {
public:
    static unsigned hardware_concurrency() { return 1; }
};

}  // namespace std
