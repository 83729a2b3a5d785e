// Section MODL: what the space basis of a file is built from.
#pragma once

#include <span>
#include <vector>

#include "errors.hpp"

namespace pdeanim {

enum class SpaceKind { patch, curve };

// The bases of space that there can be.
struct SpaceForm {
    SpaceKind kind = SpaceKind::patch;
    i64 points = 0;        // vertices of a patch at most; about as many of a piece of a curve
    int functions = 0;     // of an element at most
    int threshold = 0;     // which of the thresholds below which functions are dropped
    double rate = 0.0;     // r of Eqs. 14 and 16 over half a piece
    bool is_affine = true;  // the elements hang together in a partition tree, by affine functions
};

struct Model {
    SpaceForm form;
    double residual_step = 0.0;  // quantisation step of residuals [scene units]
    std::vector<u8> masks;       // of the partition tree's nodes: which affine functions they have

    // Read section MODL; CorruptError where a field is out of range.
    static Model of_bytes(std::span<const u8> data);
};

}  // namespace pdeanim
