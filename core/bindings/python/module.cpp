// The module itself: translates errors of the core to those of pdecodec.errors, and adds the functions of the other
// files.
#include "base/errors.hpp"
#include "bindings/python/bindings.hpp"

using namespace pdeanim;
using namespace pdeanim::bindings;
using namespace nb::literals;

namespace {

// In the order of FaultCode.
constexpr const char *code_names[] = {
    "identifier",       "version",         "header-checksum", "table",
    "table-checksum",   "truncated",       "trailing-bytes",  "section-unknown-required",
    "section-checksum", "section-content", "group-checksum",  "group-content",
};

// Raise an error of pdecodec.errors.
template <class... Fields> void raise(const char *kind, const std::exception &error, const Fields &...fields) {
    const nb::object made = nb::module_::import_("pdecodec.errors").attr(kind)(error.what(), fields...);
    PyErr_SetObject(made.type().ptr(), made.ptr());
}

nb::object known(i64 number) { return number < 0 ? nb::object(nb::none()) : nb::object(nb::int_(number)); }

nb::object known(const std::string &text) {
    return text.empty() ? nb::object(nb::none()) : nb::object(nb::str(text.c_str()));
}

void translate(const std::exception_ptr &thrown) {
    try {
        std::rethrow_exception(thrown);
    } catch (const CorruptError &error) {
        raise("CorruptFileError", error, "code"_a = code_names[static_cast<int>(error.code)],
              "section"_a = known(error.section), "offset"_a = known(error.offset), "frame"_a = known(error.frame));
    } catch (const LimitError &error) {
        raise("LimitError", error, "limit"_a = "max_memory");
    } catch (const ReadError &error) {
        raise("InputError", error, "code"_a = "unreadable");
    }
}

}  // namespace

NB_MODULE(_core, module) {
    module.doc() = "The native core of pdecodec.";
    nb::register_exception_translator([](const std::exception_ptr &thrown, void *) { translate(thrown); });
    bind_animation(module);
    bind_mesh(module);
    bind_motion(module);
    bind_space(module);
    bind_encode(module);
    bind_linear_algebra(module);
    bind_simulate(module);
    bind_text(module);
    bind_baselines(module);
    bind_fields(module);
}
