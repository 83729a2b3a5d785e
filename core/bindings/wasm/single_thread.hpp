// What the core uses of the C++ library's threads, for a machine that has one thread: the C++ library that comes with the
// compiler for WebAssembly leaves these classes out. Every source is compiled with it in front (build.py).
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

    // Nobody else can make it true: it is, or is never waited for.
    template <class Lock, class Predicate> void wait(Lock &, const Predicate &) {}
};

// What it waits for was done at once.
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
