// How many functions of space there are, of which kind, and in which order: what coefficients are decoded by.
//
// It follows from the patches and from bytes in section MODL, not from the reference frame: coefficients need not wait
// for that. Functions stand in this order: the whole's affine functions, the wavelets of each node of the partition tree,
// and the functions of each element that are not affine.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "mesh/bisection.hpp"
#include "sections/spatial/polynomials.hpp"
#include "sections/spatial/space_form.hpp"

namespace pdeanim {

// Functions as they are coded together: those of the whole, the wavelets of a node, or the others of an element.
struct SubbandTable {
    std::vector<i64> starts;   // where each begins among the functions, and where the last ends
    std::vector<i64> kinds;    // 0 of the whole, a node's depth from 1 on, or -1 - affine functions of an element
    std::vector<i64> parents;  // the subband of the node above
};

class SpaceLayout {
public:
    // `local`: how many local coordinates the affine functions of each element take, where elements have such functions.
    // `masks`: which of 1, x, y and z each node keeps that is no element, bits 0 to 3.
    SpaceLayout(const SpaceForm &form, std::shared_ptr<const Patches> patches, std::vector<u8> local,
                std::vector<u8> masks);

    // CorruptError if the bytes do not end where the partition tree does.
    static SpaceLayout of_bytes(const SpaceForm &form, std::shared_ptr<const Patches> patches,
                                std::span<const u8> data);
    std::vector<u8> to_bytes() const;

    const SpaceForm &form() const { return form_; }
    const std::shared_ptr<const Patches> &patches() const { return patches_; }
    i64 elements() const { return patches_->count(); }
    i64 nodes() const { return static_cast<i64>(affine_.size()); }
    i64 functions() const { return coefficient_starts_.back(); }

    // Functions of the whole and of all nodes, which are the first of all.
    i64 tree_functions() const { return coefficient_starts_.front(); }

    // Affine functions that an element has which takes so many local coordinates.
    static i64 affine_functions(const SpaceForm &form, i64 points, int local);

    // The same of all elements, as the nodes that they are; 0 of other nodes.
    static std::vector<i64> affine_of_elements(const SpaceForm &form, const Patches &patches,
                                               const std::vector<u8> &local);

    // Affine functions of a node, or of an element.
    i64 affine_of_node(i64 node) const { return affine_[node]; }
    i64 affine(i64 element) const { return affine_[patches_->node_of[element]]; }
    const std::vector<u8> &masks() const { return masks_; }
    const std::vector<u8> &local() const { return local_; }

    // All functions of an element.
    i64 rank(i64 element) const { return affine(element) + others(element); }

    // Those that are not affine, and where they begin among the functions of all.
    i64 others(i64 element) const { return coefficient_starts_[element + 1] - coefficient_starts_[element]; }
    const std::vector<i64> &coefficient_starts() const { return coefficient_starts_; }

    // Where an element's functions would begin among those of all, if its affine ones were among them.
    i64 first_function(i64 element) const { return coefficient_starts_[element] - affine(element); }

    // Where a node's wavelets begin among the functions.
    i64 first_wavelet(i64 node) const { return wavelet_starts_[node]; }

    const SubbandTable &subbands() const { return subbands_; }

private:
    SubbandTable make_subbands() const;

    SpaceForm form_;
    std::shared_ptr<const Patches> patches_;
    std::vector<u8> local_, masks_;
    std::vector<i64> affine_;  // affine functions of each node, elements included
    std::vector<i64> wavelet_starts_, coefficient_starts_;
    SubbandTable subbands_;
};

}  // namespace pdeanim
