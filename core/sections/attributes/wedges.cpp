#include "sections/attributes/wedges.hpp"

#include <utility>

namespace pdeanim {

namespace {

// Return two corners of the polygon across `edge`: the one at `vertex` and the one at the edge's other end; -1, -1 if
// there is no such polygon.
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

// Class of the angle between two normals: 0 unknown, 1 at 90 degrees or more, up to 7 for parallel normals.
int WedgeModel::bend_of(const GridPoint &one, const GridPoint &another) {
    i64 dot = 0, square = 0, other_square = 0;
    for (int k = 0; k < 3; ++k) {
        dot += one[k] * another[k];
        square += one[k] * one[k];
        other_square += another[k] * another[k];
    }
    const i64 squares = square * other_square;
    if (squares == 0 || dot <= 0) return squares ? 1 : 0;
    // 1 / sin^2 of the angle between the normals.
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
    std::vector<i32> compared;  // the element that was last compared with each wedge
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

namespace {

constexpr i64 most_corners_around = 16;  // number of a wedge's corners that are examined
constexpr int ratio_bits = 16;           // fraction bits of a ratio of lengths
constexpr int vector_bits = 14;  // digits of the largest component of three edges, before their products are multiplied
// Largest distance of a point along an edge (8 edge lengths) and across it (4 times the distance of the third known
// point). Beyond that, a prediction only amplifies noise.
constexpr int along_bits = 3, aside_bits = 2;
constexpr int thinnest_bits = 10;  // smallest height of a triangle over its edge, squared; thinner ones do not predict
constexpr int score_bits = 10, score_rate = 3;

// Return the square root of a number below 2^62, rounded down.
i64 square_root(i64 number) {
    if (number <= 0) return 0;
    i64 root = i64{1} << ((bit_length(number) + 1) >> 1);
    while (true) {
        const i64 better = (root + number / root) >> 1;
        if (better >= root) return root;
        root = better;
    }
}

// Return the polygons of a mesh with wedges as vertices. Corners without a wedge get one more wedge.
CornerTable corners_of(const Polygons &mesh, const AttributeElements &elements, const Wedges &wedges) {
    const i32 none = static_cast<i32>(wedges.count());
    Polygons polygons;
    polygons.vertices = i64{none} + 1;
    if (!elements.corners.empty()) {
        polygons.starts = mesh.starts;
        polygons.faces = mesh.faces;
        for (const i32 element : elements.of_corner) {
            polygons.vertex.push_back(element < 0 ? none : wedges.of_element[element]);
        }
    }
    return CornerTable(std::move(polygons));
}

// Convert a linear value to another unit.
i32 shifted(i64 linear, int up) {
    if (up < 0) return static_cast<i32>(linear >> least(-up, linear_bits + 1));
    const i64 value = linear * (i64{1} << least(up, linear_bits + 1));
    return static_cast<i32>(clamp(value, -largest_linear, largest_linear));
}

i64 mean(i64 sum, i64 count) { return floor_divide(2 * sum + count, 2 * count); }

}  // namespace

WedgeField::WedgeField(AttributeMesh &mesh, const AttributeElements &elements, const Wedges &wedges, Scales scales)
    : count_(wedges.count()), scales_(std::move(scales)), corners_(corners_of(mesh.polygons(), elements, wedges)),
      order_(prediction_order(corners_)), positions_(count_ + 1), others_((count_ + 1) * channels()),
      has_other_(count_ + 1) {
    const WedgeField *other = mesh.measured.get();
    if (other && other->channels() != channels()) other = nullptr;
    for (i32 wedge = 0; wedge < count_; ++wedge) {
        const i32 element = wedges.first[wedge];
        if (elements.starts[element] == elements.starts[element + 1]) continue;
        const i32 corner = elements.corners[elements.starts[element]];
        positions_[wedge] = mesh.grid()[mesh.polygons().vertex[corner]];
        if (!other) continue;
        const i32 there = other->corners_.vertex(corner);
        has_other_[wedge] = there < other->count_;
        for (int k = 0; k < channels(); ++k) {
            others_[static_cast<i64>(wedge) * channels() + k] =
                shifted(other->value(there, k), scales_.shift - other->scales_.shift);
        }
    }
}

void WedgeField::restart() {
    linear_.assign(others_.size(), 0);
    lengths_.assign(others_.size(), 0);
    is_known_.assign(count_ + 1, false);
    scores_.fill(0);
}

// Predict the value at x from the known values at the triangle a, b, c, either across its edge from a to b or within
// its plane. If c is negative, predict from a and b alone.
void WedgeField::continue_map(i32 a, i32 b, i32 c, i32 x, bool is_across) {
    const GridPoint &from = positions_[a], &third = positions_[c >= 0 ? c : a];
    GridPoint to_b, to_x, to_c;
    i64 largest = 0;
    for (int k = 0; k < 3; ++k) {
        to_b[k] = positions_[b][k] - from[k];
        to_x[k] = positions_[x][k] - from[k];
        to_c[k] = third[k] - from[k];
        largest = most(largest, most(size_of(to_b[k]), most(size_of(to_x[k]), size_of(to_c[k]))));
    }
    const int shift = most(bit_length(largest) - vector_bits, 0);
    i64 bb = 0, bx = 0, bc = 0, xx = 0, cc = 0, xc = 0;
    for (int k = 0; k < 3; ++k) {
        const i64 u = to_b[k] >> shift, v = to_x[k] >> shift, w = to_c[k] >> shift;
        bb += u * u;
        bx += u * v;
        bc += u * w;
        xx += v * v;
        cc += w * w;
        xc += v * w;
    }
    if (bb == 0) return;
    const i64 along = floor_divide(bx * (1 << ratio_bits), bb);
    if (size_of(along) >> (ratio_bits + along_bits)) return;
    const i64 height = most<i64>(xx - bx * bx / bb, 0);
    if (c < 0) {
        if (height >> (2 * along_bits) > bb) return;
        const i64 aside = square_root((height << (2 * ratio_bits)) / bb);
        for (int k = 0; k < channels(); ++k) {
            const i64 straight = value(a, k) + (((value(b, k) - value(a, k)) * along) >> ratio_bits);
            i64 turn = 0;
            if (k < 2 && channels() > 1) {
                turn = ((value(b, 1 - k) - value(a, 1 - k)) * aside) >> ratio_bits;
                if (k == 0) turn = -turn;
            }
            findings_.predicted[turned][k] += straight + turn;
            findings_.predicted[mirrored][k] += straight - turn;
        }
        ++findings_.counts[turned];
        ++findings_.counts[mirrored];
        return;
    }
    const i64 third_height = cc - bc * bc / bb;
    if (third_height <= bb >> thinnest_bits) return;
    i64 aside;
    if (is_across) {
        if (height >> (2 * aside_bits) > third_height) return;
        aside = -square_root((height << (2 * ratio_bits)) / third_height);
    } else {
        aside = floor_divide((xc - floor_divide(bx * bc, bb)) * (1 << ratio_bits), third_height);
    }
    const i64 third_along = floor_divide(bc * (1 << ratio_bits), bb);
    if (size_of(aside) >> (ratio_bits + aside_bits) || size_of(third_along) >> (ratio_bits + along_bits)) return;
    for (int k = 0; k < channels(); ++k) {
        const i64 step = value(b, k) - value(a, k);
        const i64 off = value(c, k) - value(a, k) - ((step * third_along) >> ratio_bits);
        findings_.predicted[affine][k] += value(a, k) + ((step * along) >> ratio_bits) + ((off * aside) >> ratio_bits);
    }
    ++findings_.counts[affine];
}

void WedgeField::add_parallelogram(i32 a, i32 b, i32 c) {
    for (int k = 0; k < channels(); ++k) {
        findings_.predicted[parallelogram][k] += value(a, k) + value(b, k) - value(c, k);
    }
    ++findings_.counts[parallelogram];
}

// Return the wedge of a corner if it is known and not x, else -1.
i32 WedgeField::known_at(i32 corner, i32 x) const {
    const i32 wedge = corners_.vertex(corner);
    return is_known_[wedge] && wedge != x ? wedge : -1;
}

// Predict x across a side of its polygon: the side after the next corner, or the side before the previous corner.
// Return whether a prediction from the two ends of a side alone has been made, which happens only once.
bool WedgeField::look_across(i32 x, i32 corner, bool is_before, bool has_turned) {
    const std::vector<i32> &next = corners_.next, &previous = corners_.previous;
    const i32 edge = is_before ? previous[previous[corner]] : next[corner], end = next[edge];
    const i32 a = known_at(edge, x), b = known_at(end, x);
    if (a < 0 || b < 0 || a == b) return has_turned;
    if (!has_turned) continue_map(a, b, -1, x, false);
    const i32 size = corners_.size[corner], opposite = corners_.opposite[edge];
    if (opposite >= 0 && corners_.polygon[opposite] != corners_.polygon[corner]) {
        const i32 c = known_at(next[next[opposite]], x);
        if (c >= 0 && c != a && c != b) {
            continue_map(a, b, c, x, true);
            if (size == 3 && corners_.size[opposite] == 3) add_parallelogram(a, b, c);
        }
    }
    // Both sides of a quad lead to the same three corners.
    if (size > 4 || (size == 4 && !is_before)) {
        const i32 near = is_before ? next[corner] : previous[corner], far = is_before ? previous[edge] : next[end];
        i32 c = known_at(near, x);
        if (size == 4 && c >= 0) add_parallelogram(a, c, b);
        if (c < 0) c = known_at(far, x);
        if (c >= 0 && c != a && c != b) continue_map(a, b, c, x, false);
    }
    return true;
}

const WedgeField::Findings &WedgeField::look_around(i32 x) {
    auto &[predicted, counts, expected] = findings_;
    findings_ = {};
    const i64 first = corners_.fan_starts[x], end = least(corners_.fan_starts[x + 1], first + most_corners_around);
    for (i64 place = first; place < end; ++place) {
        const i32 corner = corners_.fan[place], size = corners_.size[corner];
        for (const i32 beside : {corners_.next[corner], corners_.previous[corner]}) {
            const i32 neighbour = known_at(beside, x);
            if (neighbour < 0) continue;
            ++counts[neighbours];
            for (int k = 0; k < channels(); ++k) {
                predicted[neighbours][k] += value(neighbour, k);
                expected[k] += length(neighbour, k);
            }
        }
        // A triangle has only one side that does not touch the corner.
        if (size < 3) continue;
        const bool has_turned = look_across(x, corner, false, false);
        if (size > 3) look_across(x, corner, true, has_turned);
    }
    if (counts[neighbours]) {
        for (int k = 0; k < channels(); ++k) expected[k] = mean(expected[k], counts[neighbours]);
    }
    if (has_other_[x]) {
        counts[other_attribute] = 1;
        for (int k = 0; k < channels(); ++k) {
            predicted[other_attribute][k] = others_[static_cast<i64>(x) * channels() + k];
        }
    }
    for (int way = 0; way < ways; ++way) {
        if (counts[way] <= 1) continue;
        for (int k = 0; k < channels(); ++k) predicted[way][k] = mean(predicted[way][k], counts[way]);
    }
    return findings_;
}

std::pair<WedgeField::Way, WedgeField::Way> WedgeField::best_ways() const {
    int best = ways, second = ways;
    for (int way = 0; way < ways; ++way) {
        if (findings_.counts[way] == 0) continue;
        if (best == ways || scores_[way] < scores_[best]) {
            second = best;
            best = way;
        } else if (second == ways || scores_[way] < scores_[second]) {
            second = way;
        }
    }
    return {static_cast<Way>(best), static_cast<Way>(second)};
}

void WedgeField::learn(i32 x) {
    std::array<i64, ways> digits{};
    i64 fewest = 64;
    for (int way = 0; way < ways; ++way) {
        if (!findings_.counts[way]) continue;
        i64 miss = 0;
        for (int k = 0; k < channels(); ++k) miss += size_of(value(x, k) - findings_.predicted[way][k]);
        digits[way] = 1 + bit_length(miss);
        fewest = least(fewest, digits[way]);
    }
    for (int way = 0; way < ways; ++way) {
        if (!findings_.counts[way]) continue;
        scores_[way] += (((digits[way] - fewest) << score_bits) - scores_[way]) >> score_rate;
    }
    is_known_[x] = true;
}

}  // namespace pdeanim
