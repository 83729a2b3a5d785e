// What GCC's newer headers need of libraries that are newer than the systems a wheel is for (core/wheels.py): the C++ library
// of GCC 8 and glibc 2.28. Each is written with functions that those have; none is seen from outside the module.
#include <condition_variable>
#include <new>

#define PDEANIM_NAMED(name) __asm__(name) __attribute__((visibility("hidden")))

extern "C" {

// glibc 2.32; 0 says that there may be threads.
char single_threaded PDEANIM_NAMED("__libc_single_threaded") = 0;

// GLIBCXX_3.4.29
void throw_bad_length() PDEANIM_NAMED("_ZSt28__throw_bad_array_new_lengthv");
void throw_bad_length() { throw std::bad_array_new_length(); }

// GLIBCXX_3.4.26: std::runtime_error(std::runtime_error &&) copies, which counts a reference.
void copy_error(void *self, const void *other) __asm__("_ZNSt13runtime_errorC2ERKS_");
void move_error(void *self, void *other) PDEANIM_NAMED("_ZNSt13runtime_errorC2EOS_");
void move_error(void *self, void *other) { copy_error(self, other); }

// CXXABI_1.3.13: a copy of std::exception_ptr that is never destroyed counts a reference, and a destructor releases one.
void copy_pointer(void *self, const void *other) __asm__("_ZNSt15__exception_ptr13exception_ptrC1ERKS0_");
void destroy_pointer(void *self) __asm__("_ZNSt15__exception_ptr13exception_ptrD1Ev");
void add_reference(void *self) PDEANIM_NAMED("_ZNSt15__exception_ptr13exception_ptr9_M_addrefEv");
void release(void *self) PDEANIM_NAMED("_ZNSt15__exception_ptr13exception_ptr10_M_releaseEv");
void add_reference(void *self) {
    void *copy;
    copy_pointer(&copy, self);
}
void release(void *self) { destroy_pointer(self); }

// GLIBCXX_3.4.30: std::condition_variable::wait; the class begins with its pthread_cond_t.
void wait_locked(void *self, std::unique_lock<std::mutex> &lock)
    PDEANIM_NAMED("_ZNSt18condition_variable4waitERSt11unique_lockISt5mutexE");
void wait_locked(void *self, std::unique_lock<std::mutex> &lock) {
    pthread_cond_wait(static_cast<pthread_cond_t *>(self), lock.mutex()->native_handle());
}
}
