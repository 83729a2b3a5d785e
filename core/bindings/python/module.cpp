// The module itself: its errors, and all that the other files add.
#include "base/errors.hpp"
#include "bindings/python/bindings.hpp"

using namespace pdeanim;
using namespace pdeanim::bindings;

NB_MODULE(_core, module) {
    module.doc() = "The native core of pdecodec.";
    // Where it is known, with the byte and the frame: (message, offset or None, frame or None).
    static PyObject *corrupt = PyErr_NewException("pdecodec._core.CorruptError", nullptr, nullptr);
    module.attr("CorruptError") = nb::handle(corrupt);
    nb::register_exception_translator([](const std::exception_ptr &thrown, void *) {
        try {
            std::rethrow_exception(thrown);
        } catch (const CorruptError &error) {
            const auto place = [](i64 number) {
                return number < 0 ? nb::object(nb::none()) : nb::object(nb::int_(number));
            };
            const nb::tuple fields = nb::make_tuple(error.what(), place(error.offset), place(error.frame));
            PyErr_SetObject(corrupt, fields.ptr());
        }
    });
    nb::exception<LimitError>(module, "LimitError");
    nb::exception<ReadError>(module, "ReadError");
    bind_animation(module);
    bind_mesh(module);
    bind_motion(module);
    bind_space(module);
    bind_encode(module);
    bind_linear_algebra(module);
    bind_simulate(module);
    bind_text(module);
    bind_baselines(module);
}
