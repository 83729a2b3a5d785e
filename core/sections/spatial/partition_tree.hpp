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
#include <span>
#include <vector>

#include "sections/spatial/elements.hpp"
#include "sections/spatial/space_layout.hpp"

namespace pdeanim {

// Some of a space basis' functions: those of some subbands, which follow each other as all do.
//
// An encoder looks at some elements, and at the nodes of the partition tree above them, and takes these for the whole mesh.
struct SpaceSelection {
    // `subbands`: ascending, the first of them that of the whole's affine functions.
    SpaceSelection(const SpaceLayout &layout, std::span<const i64> subbands);

    bool has_element(i64 element) const { return element_rows[element] >= 0; }

    i64 functions = 0;
    std::vector<i64> elements;      // ascending
    std::vector<i64> tree_rows;     // of each function of the whole and of all nodes, where it stands, or -1
    std::vector<i64> element_rows;  // of each element, where its first function stands that is not affine, or -1
    std::vector<u8> has_elements;   // of each node: whether some of these are below it, or are it
};

class PartitionTree {
public:
    static constexpr int most_functions = 2 * affine_count;  // of two halves

    // Orthogonal: rows are a node's affine functions and then its wavelets, columns the first half's affine functions and
    // then the second's.
    using Matrix = std::array<std::array<double, most_functions>, most_functions>;

    // Over elements with the sums of their affine functions.
    PartitionTree(const Elements &elements, const std::vector<AffineSums> &sums,
                  std::shared_ptr<const SpaceLayout> layout);

    // The same, and choose what nodes keep; `local`: local coordinates that each element takes.
    PartitionTree(const Elements &elements, const std::vector<AffineSums> &sums, std::vector<u8> local);

    const std::shared_ptr<const SpaceLayout> &layout() const { return layout_; }

    // Of a node that is no element. Two children follow for each such node, in order.
    const Matrix &matrix(i64 node) const { return matrices_[(layout_->patches()->children[node] - 1) / 2]; }

    // From the affine coefficients of elements to those of the whole and of the wavelets, upwards. `affine`: four rows of
    // `channels` a node, those of elements given; `coefficients`: a row a function, of all or of a selection, written for
    // those of the whole and of nodes.
    template <class Real>
    void analyse(std::span<double> affine, Real *coefficients, i64 channels, const SpaceSelection *selection) const;

    // Undo `analyse`: affine coefficients of every node, downwards.
    void synthesise(const double *coefficients, std::span<double> affine, i64 channels) const;

    // The least relative distance of a share from its threshold.
    double nearest = std::numeric_limits<double>::infinity();

private:
    void build_matrices(const Elements &elements, const std::vector<AffineSums> &of_elements,
                        const std::vector<u8> &local, std::vector<u8> &masks, bool chooses);

    std::shared_ptr<const SpaceLayout> layout_;
    std::vector<Matrix> matrices_;  // of nodes that are no elements, in order
};

}  // namespace pdeanim
