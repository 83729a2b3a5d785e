#include "decode/model.hpp"

#include "decode/fields.hpp"
#include "decode/limits.hpp"

namespace pdeanim {

namespace {

constexpr i64 most_points[] = {256, 65535};  // by the kind of basis
constexpr int most_functions = 128;          // building them costs the square of their number
constexpr int thresholds = 8;

}  // namespace

Model Model::of_bytes(std::span<const u8> data) {
    FieldReader fields(data, "MODL");
    const u8 kind = fields.integer<u8>();
    if (kind > static_cast<u8>(SpaceKind::curve)) {
        throw CorruptError("section MODL names space basis " + std::to_string(kind) + ", which is unknown");
    }
    Model model;
    SpaceForm &form = model.form;
    form.kind = static_cast<SpaceKind>(kind);
    form.points = fields.count();
    form.functions = fields.integer<u8>();
    form.threshold = fields.integer<u8>();
    int affine = 1;
    if (form.kind == SpaceKind::curve) {
        form.rate = fields.real();
        affine = fields.integer<u8>();
    }
    form.is_affine = affine != 0;
    model.residual_step = fields.real();
    if (form.points < 1 || form.points > most_points[kind] || form.functions < 1 || form.functions > most_functions) {
        throw CorruptError("section MODL has a size of patches out of range");
    }
    if (form.threshold >= thresholds || affine > 1 || !(form.rate >= 0.0 && form.rate <= limits::largest_rate)) {
        throw CorruptError("section MODL has a threshold, a rate or a sort of pieces out of range");
    }
    if (!(model.residual_step > 0.0 && model.residual_step <= limits::largest_step)) {
        throw CorruptError("section MODL has a quantisation step out of range");
    }
    const std::span<const u8> layout = fields.rest();
    model.layout.assign(layout.begin(), layout.end());
    return model;
}

}  // namespace pdeanim
