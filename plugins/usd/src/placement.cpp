#include "placement.hpp"

#include <algorithm>
#include <optional>

#include "clip.hpp"

namespace pdeanim_usd {

namespace {

template <class Type> std::optional<VtValue> between(const VtValue &low, const VtValue &high, double share) {
    if (!low.IsHolding<Type>() || !high.IsHolding<Type>()) return std::nullopt;
    const Type &a = low.UncheckedGet<Type>(), &b = high.UncheckedGet<Type>();
    if constexpr (std::is_same_v<Type, GfQuatd> || std::is_same_v<Type, GfQuatf> || std::is_same_v<Type, GfQuath>) {
        return VtValue(GfSlerp(share, a, b));
    } else if constexpr (std::is_same_v<Type, GfMatrix4d>) {
        return VtValue(a * (1 - share) + b * share);
    } else {
        return VtValue(Type(GfLerp(share, a, b)));
    }
}

VtValue interpolated(const VtValue &low, const VtValue &high, double share) {
    std::optional<VtValue> found;
    const auto attempt = [&]<class... Types>() { ((found = found ? found : between<Types>(low, high, share)), ...); };
    attempt.operator()<GfMatrix4d, GfVec3d, GfVec3f, GfVec3h, double, float, GfHalf, GfQuatd, GfQuatf, GfQuath>();
    return found.value_or(low);
}

// Return the numbers of a value as float64: three of a vector, or one; nothing for another type.
std::optional<GfVec3d> vector_of(const VtValue &value) {
    if (value.IsHolding<GfVec3d>()) return value.UncheckedGet<GfVec3d>();
    if (value.IsHolding<GfVec3f>()) return GfVec3d(value.UncheckedGet<GfVec3f>());
    if (value.IsHolding<GfVec3h>()) return GfVec3d(value.UncheckedGet<GfVec3h>());
    return std::nullopt;
}

std::optional<double> scalar_of(const VtValue &value) {
    if (value.IsHolding<double>()) return value.UncheckedGet<double>();
    if (value.IsHolding<float>()) return value.UncheckedGet<float>();
    if (value.IsHolding<GfHalf>()) return static_cast<double>(value.UncheckedGet<GfHalf>());
    return std::nullopt;
}

std::optional<GfQuatd> quaternion_of(const VtValue &value) {
    if (value.IsHolding<GfQuatd>()) return value.UncheckedGet<GfQuatd>();
    if (value.IsHolding<GfQuatf>()) return GfQuatd(value.UncheckedGet<GfQuatf>());
    if (value.IsHolding<GfQuath>()) return GfQuatd(value.UncheckedGet<GfQuath>());
    return std::nullopt;
}

GfMatrix4d turn(char axis, double degrees) {
    GfVec3d around(0);
    around[axis - 'X'] = 1;
    return GfMatrix4d(1).SetRotate(GfRotation(around, degrees));
}

// Return the matrix of a step. Its kind may end with axes: of a single number, or of turns in order.
std::optional<GfMatrix4d> matrix_of(const std::string &kind, const VtValue &value) {
    const std::size_t end = kind.find_last_not_of("XYZ") + 1;
    const std::string verb = kind.substr(0, end), axes = kind.substr(end);
    if (kind == "transform" && value.IsHolding<GfMatrix4d>()) return value.UncheckedGet<GfMatrix4d>();
    if (kind == "orient") {
        const auto found = quaternion_of(value);
        return found ? std::optional(GfMatrix4d(GfRotation(*found), GfVec3d(0))) : std::nullopt;
    }
    const bool is_scale = verb == "scale";
    auto vector = vector_of(value);
    if (const auto number = scalar_of(value); number && axes.size() == 1) {
        vector = GfVec3d(is_scale ? 1 : 0);
        (*vector)[axes[0] - 'X'] = *number;
    }
    if (!vector) return std::nullopt;
    if (is_scale) return GfMatrix4d(1).SetScale(*vector);
    if (verb == "translate") return GfMatrix4d(1).SetTranslate(*vector);
    if (verb != "rotate") return std::nullopt;
    GfMatrix4d found(1);
    for (const char axis : axes) found *= turn(axis, (*vector)[axis - 'X']);
    return found;
}

}  // namespace

VtValue Varying::at(double code) const {
    if (values.empty()) return VtValue();
    const auto after = std::upper_bound(codes.begin(), codes.end(), code) - codes.begin();
    const std::size_t low = after ? after - 1 : 0;
    if (codes.empty() || low + 1 == codes.size() || code <= codes[low]) return values[low];
    return interpolated(values[low], values[low + 1], (code - codes[low]) / (codes[low + 1] - codes[low]));
}

GfMatrix4d TransformStep::at(double code) const {
    const VtValue found = value.at(code);
    if (found.IsEmpty()) return GfMatrix4d(1);
    const auto matrix = matrix_of(kind, found);
    if (!matrix) throw Failure("a transform of the scene (" + kind + ") is of a type that is not known");
    return is_inverse ? matrix->GetInverse() : *matrix;
}

Placement::Placement(std::vector<TransformStep> steps, std::shared_ptr<const Placement> above)
    : steps_(std::move(steps)), above_(std::move(above)) {
    is_constant_ = !above_ || above_->is_constant();
    for (const TransformStep &one : steps_) is_constant_ = is_constant_ && one.value.values.size() < 2;
}

GfMatrix4d Placement::matrix(double code) const {
    GfMatrix4d found(1);
    for (auto one = steps_.rbegin(); one != steps_.rend(); ++one) found *= one->at(code);
    return above_ ? found * above_->matrix(code) : found;
}

GfMatrix4d Placement::inverse(double code) const {
    double determinant;
    const GfMatrix4d found = matrix(code).GetInverse(&determinant);
    if (!(determinant != 0)) throw Failure("a transform of the scene flattens the mesh, so its points have no places");
    return found;
}

}  // namespace pdeanim_usd
