#include "sections/attributes/wedges.hpp"

#include <utility>

namespace pdeanim {

namespace {

// The corner at `vertex` in the polygon across `edge`, and the one at its other end; -1, -1 where there is none.
std::pair<i32, i32> across(const CornerTable &corners, i32 edge, i32 vertex) {
    const i32 opposite = corners.opposite[edge];
    if (opposite < 0) return {-1, -1};
    const i32 next = corners.next[opposite];
    return corners.vertex(opposite) == vertex ? std::pair(opposite, next) : std::pair(next, opposite);
}

}  // namespace

WedgeModel::WedgeModel()
    : by_ends_(kinds * likenesses * likenesses * 3), by_bend_(kinds * bends * likenesses * likenesses),
      by_history_(histories * kinds * likenesses) {}

// 0 unknown, 1 at 90 degrees or more, up to 7 flat.
int WedgeModel::bend_of(const GridPoint &one, const GridPoint &another) {
    i64 dot = 0, square = 0, other_square = 0;
    for (int k = 0; k < 3; ++k) {
        dot += one[k] * another[k];
        square += one[k] * one[k];
        other_square += another[k] * another[k];
    }
    const i64 squares = square * other_square;
    if (squares == 0 || dot <= 0) return squares ? 1 : 0;
    // 1 / sin^2 of the angle between them.
    return least(1 + bit_length(squares / most<i64>(squares - dot * dot, 1)), bends - 1);
}

template <Mode mode> bool WedgeModel::code_same(RangeCoder<mode> &coder, const Comparison &of, bool is_same) {
    is_same = coder.template mixed<3>(
        {&by_ends_[((of.kind * likenesses + of.ends) * likenesses + of.agreement) * 3 + least(of.refused, 2)],
         &by_bend_[((of.kind * bends + of.bend) * likenesses + of.ends) * likenesses + of.seam],
         &by_history_[(history_ * kinds + of.kind) * likenesses + of.seam]},
        weights_[of.kind].data(), is_same);
    history_ = (2 * history_ + is_same) % histories;
    return is_same;
}

template <Mode mode> Wedges WedgeModel::code(RangeCoder<mode> &coder, AttributeMesh &mesh, const CornerTable &corners,
                                             const AttributeElements &elements, bool has_runs,
                                             std::span<const i32> wanted) {
    const std::vector<GridPoint> &normals = mesh.normals();
    const std::vector<i32> &earlier = mesh.earlier;
    const i64 count = elements.count();
    Wedges wedges;
    wedges.of_element.assign(count, -1);
    std::vector<i32> compared;  // the element that was compared with each wedge last
    const auto wedge_at = [&](i32 corner) {
        const i32 element = corner < 0 ? -1 : elements.of_corner[corner];
        return element < 0 ? -1 : wedges.of_element[element];
    };
    const auto is_wanted = [&](i32 wedge, i32 element) {
        if constexpr (mode == Mode::decode) return false;
        return wanted[wedges.first[wedge]] == wanted[element];
    };
    i32 before_it = -1;
    for (i32 element = 0; element < count; ++element) {
        coder.check_not_ended();
        i32 found = -1;
        int refused = 0;
        const i64 begin = elements.starts[element], end = least(elements.starts[element + 1], begin + most_corners);
        for (i64 place = begin; place < end && found < 0; ++place) {
            const i32 corner = elements.corners[place], point = corners.vertex(corner);
            const i32 before = corners.previous[corner], after = corners.next[corner];
            const auto [one, one_end] = across(corners, before, point);
            const auto [two, two_end] = across(corners, corner, point);
            const Likeness agreement = likeness(wedge_at(one), wedge_at(two));
            const i64 first = corners.fan_starts[point];
            const i64 turns = around + least(corners.fan_starts[point + 1] - first, most_corners);
            for (i64 turn = 0; turn < turns; ++turn) {
                const Kind kind = static_cast<Kind>(least<i64>(turn, around));
                const i32 beside = kind == beside_before  ? one
                                   : kind == beside_after ? two
                                                          : corners.fan[first + turn - around];
                const i32 candidate = wedge_at(beside);
                if (candidate < 0 || compared[candidate] == element) continue;
                compared[candidate] = element;
                Comparison comparison{kind, unsure, agreement, refused, 0, unsure};
                if (kind == beside_before) comparison.ends = likeness(wedge_at(before), wedge_at(one_end));
                if (kind == beside_after) comparison.ends = likeness(wedge_at(after), wedge_at(two_end));
                if (kind != around) {
                    comparison.bend = bend_of(normals[corners.polygon[corner]], normals[corners.polygon[beside]]);
                }
                if (!earlier.empty()) comparison.seam = earlier[beside] == earlier[corner] ? same : other;
                if (code_same(coder, comparison, is_wanted(candidate, element))) {
                    found = candidate;
                    break;
                }
                ++refused;
            }
        }
        if (found < 0 && has_runs && before_it >= 0 && compared[before_it] != element) {
            const Comparison comparison{latest, unsure, unsure, refused, 0, unsure};
            if (code_same(coder, comparison, is_wanted(before_it, element))) found = before_it;
        }
        if (found < 0) {
            found = static_cast<i32>(wedges.count());
            wedges.first.push_back(element);
            compared.push_back(-1);
        }
        wedges.of_element[element] = found;
        before_it = found;
    }
    return wedges;
}

template Wedges WedgeModel::code(RangeCoder<Mode::encode> &, AttributeMesh &, const CornerTable &,
                                 const AttributeElements &, bool, std::span<const i32>);
template Wedges WedgeModel::code(RangeCoder<Mode::decode> &, AttributeMesh &, const CornerTable &,
                                 const AttributeElements &, bool, std::span<const i32>);

}  // namespace pdeanim
