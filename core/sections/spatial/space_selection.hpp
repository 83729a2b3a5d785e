// Some of a space basis' functions: those of some subbands, which follow each other as all do.
//
// An encoder looks at some elements, and at the nodes of the partition tree above them, and takes these for the whole mesh.
#pragma once

#include <span>
#include <vector>

#include "sections/spatial/space_layout.hpp"

namespace pdeanim {

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

}  // namespace pdeanim
