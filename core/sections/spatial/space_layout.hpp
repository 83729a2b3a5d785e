// The number, kind and order of the functions of space, which is needed to decode coefficients.
//
// It follows from the patches and from bytes in section MODL, not from the reference frame, so decoding coefficients
// does not have to wait for that frame. The order is: the affine functions of the whole mesh, the wavelets of each node
// of the partition tree, and the functions of each element that are not affine.
#pragma once

#include <array>
#include <memory>
#include <span>
#include <vector>

#include "base/arithmetic.hpp"
#include "mesh/bisection.hpp"

namespace pdeanim {

enum class SpaceKind { patch, curve };

// Parameters of a space basis that are stored in the file.
struct SpaceForm {
    SpaceKind kind = SpaceKind::patch;
    i64 points = 0;         // largest number of vertices of a patch; approximate number in a piece of a curve
    int functions = 0;      // largest number of functions of an element
    int threshold = 0;      // in sixteenths; lowers the fraction that must be new, so that no column is near it
    double rate = 0.0;      // rate r of Eqs. 14 and 16 over half the length of a piece
    bool is_affine = true;  // whether pieces of curves have affine functions and unit vectors, as patches always do
};

// Polynomials of an element's local coordinates, in the order in which functions are made from them.
//
// The four affine ones, 1, x, y and z, come first, then the others by degree. A factor of the third coordinate counts
// as degree two: there is less to describe across a surface than along it. Within a degree, higher powers of the first
// coordinate come first, then of the second.
constexpr int affine_count = 4;
constexpr int largest_degree = 10;  // for higher degrees, unit vectors are used
constexpr int normal_degree = 2;    // degree of a factor of the third coordinate

// How a polynomial is made from an earlier one.
struct Polynomial {
    std::array<int, 3> exponents{};
    std::array<int, 3> lower = {-1, -1, -1};  // the polynomial with one factor less on each axis, -1 for none
    int along = -1;                           // first axis that has a lower polynomial: the product of the two

    constexpr int degree() const { return exponents[0] + exponents[1] + normal_degree * exponents[2]; }
};

constexpr int polynomial_count = [] {
    int count = 0;
    for (int a = 0; a <= largest_degree; ++a) {
        for (int b = 0; a + b <= largest_degree; ++b) count += (largest_degree - a - b) / normal_degree + 1;
    }
    return count;
}();

inline constexpr std::array<Polynomial, polynomial_count> polynomials = [] {
    std::array<Polynomial, polynomial_count> found{};
    for (int axis = 0; axis < 3; ++axis) found[1 + axis].exponents[axis] = 1;
    int count = affine_count;
    for (int degree = 2; degree <= largest_degree; ++degree) {
        for (int a = degree; a >= 0; --a) {
            for (int b = degree - a; b >= 0; --b) {
                const int left = degree - a - b;
                const bool is_affine = a + b == 0 && left == normal_degree;
                if (left % normal_degree == 0 && !is_affine) found[count++].exponents = {a, b, left / normal_degree};
            }
        }
    }
    // Table of polynomials by exponents: searching would exceed what compilers evaluate at compile time.
    std::array<std::array<std::array<int, largest_degree + 1>, largest_degree + 1>, largest_degree + 1> numbers{};
    for (int j = 0; j < polynomial_count; ++j) {
        const auto &[a, b, c] = found[j].exponents;
        numbers[a][b][c] = j;
    }
    for (Polynomial &own : found) {
        for (int axis = 2; axis >= 0; --axis) {
            if (own.exponents[axis] == 0) continue;
            std::array<int, 3> wanted = own.exponents;
            --wanted[axis];
            own.lower[axis] = numbers[wanted[0]][wanted[1]][wanted[2]];
            own.along = axis;
        }
    }
    return found;
}();

// Subbands: functions that are coded together. A subband has the functions of the whole mesh, the wavelets of a node,
// or the other functions of an element.
struct SubbandTable {
    std::vector<i64> starts;   // first function of each subband, then the number of functions
    std::vector<i64> kinds;    // 0: whole mesh; a node's depth, from 1 on; or -1 - affine functions of an element
    std::vector<i64> parents;  // subband of the parent node
};

class SpaceLayout {
public:
    // local: number of local coordinates in the affine functions of each element that moves; empty if elements have no
    // such functions. Elements that stand still have no functions. masks: which of 1, x, y and z each node keeps that is not an element (bits 0 to 3).
    SpaceLayout(const SpaceForm &form, std::shared_ptr<const Patches> patches, std::vector<u8> local,
                std::vector<u8> masks);

    // Decode a layout. CorruptError if the bytes do not end where the partition tree does.
    static SpaceLayout of_bytes(const SpaceForm &form, std::shared_ptr<const Patches> patches,
                                std::span<const u8> data);
    std::vector<u8> to_bytes() const;

    const SpaceForm &form() const { return form_; }
    const std::shared_ptr<const Patches> &patches() const { return patches_; }
    i64 elements() const { return patches_->count(); }
    i64 nodes() const { return static_cast<i64>(affine_.size()); }
    i64 functions() const { return coefficient_starts_.back(); }

    // Return the number of functions of the whole mesh and of all nodes, which come first.
    i64 tree_functions() const { return coefficient_starts_.front(); }

    // Return the number of affine functions of an element that uses `local` local coordinates.
    static i64 affine_functions(const SpaceForm &form, i64 points, int local);

    // Return the number of affine functions of all elements, indexed by node; 0 for nodes that are not elements.
    static std::vector<i64> affine_of_elements(const SpaceForm &form, const Patches &patches,
                                               const std::vector<u8> &local);

    // Return the number of affine functions of a node, or of an element.
    i64 affine_of_node(i64 node) const { return affine_[node]; }
    i64 affine(i64 element) const { return affine_[patches_->node_of[element]]; }
    const std::vector<u8> &masks() const { return masks_; }
    const std::vector<u8> &local() const { return local_; }

    // Return the number of all functions of an element.
    i64 rank(i64 element) const { return affine(element) + others(element); }

    // Return the number of an element's functions that are not affine, and the index of the first of them.
    i64 others(i64 element) const { return coefficient_starts_[element + 1] - coefficient_starts_[element]; }
    const std::vector<i64> &coefficient_starts() const { return coefficient_starts_; }

    // Return the index at which an element's functions would begin if its affine functions came right before the
    // others.
    i64 first_function(i64 element) const { return coefficient_starts_[element] - affine(element); }

    // Return the index of a node's first wavelet.
    i64 first_wavelet(i64 node) const { return wavelet_starts_[node]; }

    const SubbandTable &subbands() const { return subbands_; }

private:
    SubbandTable make_subbands() const;

    SpaceForm form_;
    std::shared_ptr<const Patches> patches_;
    std::vector<u8> local_, masks_;
    std::vector<i64> affine_;  // number of affine functions of each node, elements included
    std::vector<i64> wavelet_starts_, coefficient_starts_;
    SubbandTable subbands_;
};

}  // namespace pdeanim
