// Where a prim of a scene stands: the transforms of the prim and those above it.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "usd_headers.hpp"

namespace pdeanim_usd {

// A value that may vary: one without a time code, or samples between which USD interpolates linearly.
struct Varying {
    std::vector<double> codes;
    std::vector<VtValue> values;

    // Return the value at a time code; an empty one if there is none.
    VtValue at(double code) const;
};

// One of the steps of UsdGeomXformable's xformOpOrder.
struct TransformStep {
    std::string kind;  // "translate", "rotateXYZ", ...
    bool is_inverse;
    Varying value;

    // Return the matrix for points that are rows. Raise Failure if the value is of another type.
    GfMatrix4d at(double code) const;
};

// The transforms of a prim; the last step is applied first.
class Placement {
public:
    // `above` may be NULL: there is none, or the prim does not inherit it.
    Placement(std::vector<TransformStep> steps, std::shared_ptr<const Placement> above);

    // Whether it is the same at all times.
    bool is_constant() const { return is_constant_; }

    // Return the matrix from the prim's space to the scene's, and its inverse. Raise Failure if there is none.
    GfMatrix4d matrix(double code) const;
    GfMatrix4d inverse(double code) const;

private:
    std::vector<TransformStep> steps_;
    std::shared_ptr<const Placement> above_;
    bool is_constant_;
};

}  // namespace pdeanim_usd
