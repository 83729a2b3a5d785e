// Python's view of the core, a file each part: on numpy arrays and bytes. The interpreter lock is released around
// everything that loops.
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
    bind_connectivity(module);
    bind_reference(module);
    bind_coefficients(module);
    bind_time_functions(module);
    bind_residuals(module);
    bind_curves(module);
    bind_evaluate(module);
    bind_description(module);
    bind_attributes(module);
    bind_xpbd(module);
    bind_text(module);
    bind_baselines(module);
    bind_animation(module);
    bind_container(module);
    bind_basis(module);
    bind_encode(module);
    bind_linear_algebra(module);
}
