#include "sections/spatial/space_layout.hpp"

#include <utility>

#include "base/errors.hpp"
#include "entropy/range_coder.hpp"
#include "sections/spatial/series.hpp"

namespace pdeanim {

namespace {

constexpr int most_local = affine_count - 1;

// Code the number of local coordinates of each element, with the number of the previous element as context.
template <Mode mode> void code_local(RangeCoder<mode> &coder, std::vector<u8> &local) {
    std::array<std::array<BitModel, most_local>, most_local + 1> models;
    int before = most_local;
    for (u8 &own : local) {
        coder.check_not_ended();
        int found = 0;
        while (found < most_local && coder.bit(models[before][found], own > found)) ++found;
        own = static_cast<u8>(found);
        before = found;
    }
}

// Code which of 1, x, y and z the nodes keep, from the leaves upwards. affine: number of affine functions of each node,
// which must be set for elements and is written for other nodes.
template <Mode mode> void code_masks(RangeCoder<mode> &coder, const std::vector<i64> &children,
                                     std::vector<i64> &affine, std::vector<u8> &masks) {
    std::array<std::array<BitModel, affine_count>, 3> models;  // contexts: number of full halves, axis
    for (i64 node = static_cast<i64>(children.size()); node-- > 0;) {
        const i64 half = children[node];
        if (half < 0) continue;
        const i64 size = affine[half] + affine[half + 1];
        const int full = (affine[half] == affine_count) + (affine[half + 1] == affine_count);
        // The constant is always kept.
        u8 mask = size > 0;
        i64 count = mask;
        for (int c = 1; c < affine_count; ++c) {
            if (count < size && coder.bit(models[full][c], masks[node] >> c & 1)) {
                mask = static_cast<u8>(mask | 1 << c);
                ++count;
            }
        }
        masks[node] = mask;
        affine[node] = count;
    }
}

std::size_t count_of_local(const SpaceForm &form, const Patches &patches) {
    return form.is_affine ? static_cast<std::size_t>(patches.moving) : 0;
}

}  // namespace

i64 SpaceLayout::affine_functions(const SpaceForm &form, i64 points, int local) {
    return least(least<i64>(1 + local, form.functions), points);
}

std::vector<i64> SpaceLayout::affine_of_elements(const SpaceForm &form, const Patches &patches,
                                                 const std::vector<u8> &local) {
    std::vector<i64> affine(patches.children.size());
    for (std::size_t e = 0; e < local.size(); ++e) {
        affine[patches.node_of[e]] = affine_functions(form, patches.size(static_cast<i64>(e)), local[e]);
    }
    return affine;
}

SpaceLayout::SpaceLayout(const SpaceForm &form, std::shared_ptr<const Patches> patches, std::vector<u8> local,
                         std::vector<u8> masks)
    : form_(form), patches_(std::move(patches)), local_(std::move(local)), masks_(std::move(masks)),
      affine_(affine_of_elements(form_, *patches_, local_)), wavelet_starts_(affine_.size()),
      coefficient_starts_(elements() + 1) {
    const std::vector<i64> &children = patches_->children;
    for (i64 node = nodes(); node-- > 0;) {
        if (children[node] >= 0) affine_[node] = std::popcount(masks_[node]);
    }
    i64 functions = affine_[0];
    for (i64 node = 0; node < nodes(); ++node) {
        wavelet_starts_[node] = functions;
        const i64 half = children[node];
        if (half >= 0) functions += affine_[half] + affine_[half + 1] - affine_[node];
    }
    coefficient_starts_[0] = functions;
    // Unit vectors complete a basis if there are too few polynomials.
    const i64 most = form.is_affine ? form.functions : least(form.functions, space_functions);
    for (i64 e = 0; e < elements(); ++e) {
        const i64 count = e < patches_->moving ? least(patches_->size(e), most) : 0;
        coefficient_starts_[e + 1] = coefficient_starts_[e] + count - affine(e);
    }
    subbands_ = make_subbands();
}

SpaceLayout SpaceLayout::of_bytes(const SpaceForm &form, std::shared_ptr<const Patches> patches,
                                  std::span<const u8> data) {
    RangeCoder<Mode::decode> coder(data);
    std::vector<u8> local(count_of_local(form, *patches)), masks(patches->children.size());
    code_local(coder, local);
    std::vector<i64> affine = affine_of_elements(form, *patches, local);
    code_masks(coder, patches->children, affine, masks);
    if (!coder.is_finished()) {
        throw CorruptError(Section("MODL"), "does not end with its partition tree; get the file again");
    }
    return {form, std::move(patches), std::move(local), std::move(masks)};
}

std::vector<u8> SpaceLayout::to_bytes() const {
    RangeCoder<Mode::encode> coder;
    std::vector<u8> local = local_, masks = masks_;
    std::vector<i64> affine = affine_;  // a copy, so that measuring does not change the layout
    code_local(coder, local);
    code_masks(coder, patches_->children, affine, masks);
    return coder.finish();
}

SubbandTable SpaceLayout::make_subbands() const {
    const Patches &patches = *patches_;
    std::vector<i64> depth(nodes()), above(nodes());
    SubbandTable found{{0}, {0}, {0}};
    for (i64 node = 0; node < nodes(); ++node) {
        const i64 first = patches.children[node];
        if (first < 0) continue;
        for (const i64 half : {first, first + 1}) {
            depth[half] = depth[node] + 1;
            above[half] = static_cast<i64>(found.kinds.size());
        }
        found.starts.push_back(wavelet_starts_[node]);
        found.kinds.push_back(depth[node] + 1);
        found.parents.push_back(above[node]);
    }
    found.starts.insert(found.starts.end(), coefficient_starts_.begin(), coefficient_starts_.end());
    for (i64 e = 0; e < elements(); ++e) {
        found.kinds.push_back(-1 - affine(e));
        found.parents.push_back(above[patches.node_of[e]]);
    }
    return found;
}

}  // namespace pdeanim
