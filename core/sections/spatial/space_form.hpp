// What a file says of its space basis.
#pragma once

#include "base/arithmetic.hpp"

namespace pdeanim {

enum class SpaceKind { patch, curve };

struct SpaceForm {
    SpaceKind kind = SpaceKind::patch;
    i64 points = 0;         // vertices of a patch at most; about as many of a piece of a curve
    int functions = 0;      // of an element at most
    int threshold = 0;      // sixteenths that columns need less than usual to be kept: none of the file is near to it
    double rate = 0.0;      // r of Eqs. 14 and 16 over half a piece
    bool is_affine = true;  // whether pieces have the affine four, and unit vectors to complete them; patches always do
};

}  // namespace pdeanim
