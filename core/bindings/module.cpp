// Python's view of the core, a file each part: on numpy arrays and bytes. The interpreter lock is released around
// everything that loops.
#include "bindings/bindings.hpp"
#include "errors.hpp"

using namespace pdeanim;
using namespace pdeanim::bindings;

NB_MODULE(_core, module) {
    module.doc() = "The native core of pdecodec.";
    nb::exception<CorruptError>(module, "CorruptError");
    nb::exception<LimitError>(module, "LimitError");
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
    bind_basis(module);
}
