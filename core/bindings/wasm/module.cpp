// The WebAssembly module for a web page (begin here; build.py builds it): opens a file that the page reads, and
// replaces what an operating system would provide. single_thread.hpp replaces the C++ library's threads, which
// WebAssembly lacks.
#include "pdeanim.h"

extern "C" {

__attribute__((import_module("pdeanim"), import_name("read"))) int64_t pdeanim_page_read(void *user, uint64_t offset,
                                                                                         void *into, size_t size);

// Open a file through the page's read function, which gets `user` as the number of the file.
__attribute__((export_name("pdeanim_open_page"))) pdeanim_status pdeanim_open_page(void *user, uint64_t size,
                                                                                   const pdeanim_options *options,
                                                                                   pdeanim_animation **animation,
                                                                                   pdeanim_error *error) {
    return pdeanim_open_read(pdeanim_page_read, user, size, options, animation, error);
}
}

// The C++ library and its exceptions come from the compiler's package. The functions below replace those that would
// write to a console: messages are dropped, and aborting is a trap.
extern "C" {

[[noreturn]] __attribute__((visibility("hidden"))) void __abort_message(const char *, ...) { __builtin_trap(); }

// The tag of all C++ exceptions. https://github.com/WebAssembly/tool-conventions, EHScheme
asm(".globl __cpp_exception\n"
    ".tagtype __cpp_exception i32\n"
    "__cpp_exception:\n");
}

namespace std {
inline namespace __1 {

[[noreturn]] void __libcpp_verbose_abort(char const *, ...) noexcept { __builtin_trap(); }

}  // namespace __1
}  // namespace std
