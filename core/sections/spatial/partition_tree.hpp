// The partition tree: the affine functions that two halves have in common are stored once, in their parent.
//
// A node's affine functions are orthogonal combinations of those of its halves; the remaining combinations are the
// node's wavelets. The file says which of 1, x, y and z a node keeps, so no decoder has to detect dependent functions.
// (Alpert 1993, "A class of bases in L2 for the sparse representation of integral operators": multiwavelets, here on
// the vertices of a mesh.)
#pragma once

#include <array>
#include <limits>
#include <memory>
#include <span>
#include <vector>

#include "sections/spatial/elements.hpp"
#include "sections/spatial/space_layout.hpp"

namespace pdeanim {

// A selection of subbands of a space basis, with rows numbered in the order of the whole basis.
//
// An encoder examines some elements, and the nodes of the partition tree above them, as a sample of the whole mesh.
struct SpaceSelection {
    // subbands: ascending; the first one is the subband of the affine functions of the whole mesh.
    SpaceSelection(const SpaceLayout &layout, std::span<const i64> subbands);

    bool has_element(i64 element) const { return element_rows[element] >= 0; }

    i64 functions = 0;
    std::vector<i64> elements;      // ascending
    std::vector<i64> tree_rows;     // row of each function of the whole mesh and of nodes, or -1
    std::vector<i64> element_rows;  // row of each element's first function that is not affine, or -1
    std::vector<u8> has_elements;   // whether a node contains, or is, one of the elements
};

class PartitionTree {
public:
    static constexpr int most_functions = 2 * affine_count;  // affine functions of both halves

    // An orthogonal matrix. Its rows are a node's affine functions, then its wavelets; its columns are the affine
    // functions of the first half, then of the second.
    using Matrix = std::array<std::array<double, most_functions>, most_functions>;

    // sums: sums over the affine functions of each element.
    PartitionTree(const Elements &elements, const std::vector<AffineSums> &sums,
                  std::shared_ptr<const SpaceLayout> layout);

    // Also choose the functions that nodes keep. local: number of local coordinates of each element.
    PartitionTree(const Elements &elements, const std::vector<AffineSums> &sums, std::vector<u8> local);

    const std::shared_ptr<const SpaceLayout> &layout() const { return layout_; }

    // Return the matrix of a node that is not an element. Such nodes have two children with consecutive numbers.
    const Matrix &matrix(i64 node) const { return matrices_[(layout_->patches()->children[node] - 1) / 2]; }

    // Transform the affine coefficients of elements, upwards, to coefficients of the whole mesh's affine functions and
    // of wavelets. affine: four rows of `channels` per node, of which those of elements must be set; coefficients: one
    // row per function, of all functions or of a selection; the rows of the whole mesh and of nodes are written.
    template <class Real>
    void analyse(std::span<double> affine, Real *coefficients, i64 channels, const SpaceSelection *selection) const;

    // Undo `analyse`: compute the affine coefficients of every node, downwards.
    void synthesise(const double *coefficients, std::span<double> affine, i64 channels) const;

    // Smallest relative distance of a new fraction from its threshold.
    double nearest = std::numeric_limits<double>::infinity();

private:
    void build_matrices(const Elements &elements, const std::vector<AffineSums> &of_elements,
                        const std::vector<u8> &local, std::vector<u8> &masks, bool chooses);

    std::shared_ptr<const SpaceLayout> layout_;
    std::vector<Matrix> matrices_;  // one per node that is not an element, in order
};

}  // namespace pdeanim
