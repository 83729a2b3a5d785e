// The partition tree: what the affine functions of two halves have in common, they share.
//
// A node's affine functions are an orthogonal combination of those of its halves; the rest of the combinations are the
// node's wavelets. Which of 1, x, y and z a node keeps is in the file, so that no decoder need find out what depends on
// what. (Alpert 1993, "A class of bases in L2 for the sparse representation of integral operators": multiwavelets, here on
// the vertices of a mesh.)
#pragma once

#include <array>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "basis/elements.hpp"

namespace pdeanim {

class PartitionTree {
public:
    static constexpr int most_functions = 2 * affine_count;  // of two halves

    // Orthogonal: rows are a node's affine functions and then its wavelets, columns the first half's affine functions and
    // then the second's.
    using Matrix = std::array<std::array<double, most_functions>, most_functions>;

    // Over elements whose affine functions are counted, with their sums. `masks`: which of 1, x, y and z the nodes keep,
    // coded; without it they are chosen. CorruptError where the bytes do not end where the tree does.
    PartitionTree(const Elements &elements, const std::vector<AffineSums> &sums,
                  std::optional<std::span<const u8>> masks);

    i64 nodes() const { return static_cast<i64>(affine_.size()); }

    // Affine functions of the whole, which are the first of all functions, and wavelets of all nodes, which follow.
    i64 functions() const { return functions_; }
    i64 affine() const { return affine_[0]; }

    // Affine functions of a node.
    i64 affine_of(i64 node) const { return affine_[node]; }

    // Where a node's wavelets begin among the functions.
    i64 first_wavelet(i64 node) const { return wavelet_starts_[node]; }

    // Of a node that is no element. Two children follow for each such node, in order.
    const Matrix &matrix(i64 node) const { return matrices_[(patches_->children[node] - 1) / 2]; }

    std::vector<u8> encode_masks() const;

    // From the affine coefficients of elements to those of the whole and of the wavelets, upwards. `affine`: four rows of
    // `channels` a node, those of elements given; `coefficients`: a row a function, written for `functions()` rows.
    void analyse(std::span<double> affine, double *coefficients, i64 channels) const;

    // Undo `analyse`: affine coefficients of every node, downwards.
    void synthesise(const double *coefficients, std::span<double> affine, i64 channels) const;

    // The least relative distance of a share from its threshold.
    double nearest = std::numeric_limits<double>::infinity();

private:
    void build_matrices(const Elements &elements, const std::vector<AffineSums> &of_elements, bool chooses);

    std::shared_ptr<const Patches> patches_;
    std::vector<i64> affine_;  // affine functions of each node
    std::vector<u8> masks_;    // which of 1, x, y and z a node keeps that is no element: bits 0 to 3
    std::vector<i64> wavelet_starts_;
    std::vector<Matrix> matrices_;  // of nodes that are no elements, in order
    i64 functions_ = 0;
};

}  // namespace pdeanim
