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
    bind_curves(module);
    bind_evaluate(module);
    bind_basis(module);
}
