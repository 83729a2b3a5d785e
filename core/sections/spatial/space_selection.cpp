#include "sections/spatial/space_selection.hpp"

namespace pdeanim {

SpaceSelection::SpaceSelection(const SpaceLayout &layout, std::span<const i64> subbands)
    : tree_rows(layout.tree_functions(), -1), element_rows(layout.elements(), -1), has_elements(layout.nodes()) {
    const SubbandTable &all = layout.subbands();
    const i64 first_element = static_cast<i64>(all.kinds.size()) - layout.elements();
    for (const i64 subband : subbands) {
        const i64 begin = all.starts[subband], end = all.starts[subband + 1];
        if (subband < first_element) {
            for (i64 function = begin; function < end; ++function) tree_rows[function] = functions + function - begin;
        } else {
            const i64 element = subband - first_element;
            elements.push_back(element);
            element_rows[element] = functions;
            has_elements[layout.patches()->node_of[element]] = 1;
        }
        functions += end - begin;
    }
    const std::vector<i64> &children = layout.patches()->children;
    for (i64 node = layout.nodes(); node-- > 0;) {
        const i64 half = children[node];
        if (half >= 0) has_elements[node] = has_elements[half] | has_elements[half + 1];
    }
}

}  // namespace pdeanim
