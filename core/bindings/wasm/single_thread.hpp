// Single-threaded versions of the C++ library's classes for threads, as far as the core uses them: the C++ library that
// comes with the compiler for WebAssembly lacks them. The compiler includes this header before every source (build.py).
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

    // No other thread could make the predicate true: it is true already, or the core never waits for it.
    template <class Lock, class Predicate> void wait(Lock &, const Predicate &) {}
};

// A latch never has to wait: the work was done when the thread was made.
class latch {
public:
    explicit latch(long) {}
    void count_down() {}
    void wait() const {}
};

// A thread that does its work in its constructor.
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
