// What a module of WebAssembly has in place of a process: messages that go nowhere, and an end that is a trap.
//
// The C++ library and its exceptions come from the compiler's package (build.py); this stands in place of what in it would
// write to a console.
extern "C" {

[[noreturn]] __attribute__((visibility("hidden"))) void __abort_message(const char *, ...) { __builtin_trap(); }

// The tag that every exception of C++ is thrown under. https://github.com/WebAssembly/tool-conventions, EHScheme
asm(".globl __cpp_exception\n"
    ".tagtype __cpp_exception i32\n"
    "__cpp_exception:\n");
}

namespace std {
inline namespace __1 {

[[noreturn]] void __libcpp_verbose_abort(char const *, ...) noexcept { __builtin_trap(); }

}  // namespace __1
}  // namespace std
