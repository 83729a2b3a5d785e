// The classes of the C++ library for threads, as far as the core uses them, for a single thread: the C++ library that
// comes with the compiler for WebAssembly leaves them out. The compiler includes this header before every source
// (build.py).
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

    // There is no other thread that could make the predicate true: it is true already, or the core never waits for it.
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
