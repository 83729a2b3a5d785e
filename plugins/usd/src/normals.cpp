#include "normals.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>

namespace pdeanim_usd {

namespace {

bool has_direction(double length) { return length > 0 && length < std::numeric_limits<double>::infinity(); }

}  // namespace

NormalRows::NormalRows(std::int64_t vertices, std::span<const std::int32_t> face_sizes,
                       std::span<const std::int32_t> corners, const std::vector<std::int32_t> &keys,
                       const std::vector<std::int32_t> &shared)
    : vertices_(vertices), count_(vertices), face_sizes_(face_sizes.begin(), face_sizes.end()),
      corners_(corners.begin(), corners.end()), corner_rows_(corners_) {
    // The groups of a vertex are numbered by their first corners, and further rows are in order of vertex and number.
    std::vector<std::int32_t> order(corners.size());
    std::iota(order.begin(), order.end(), 0);
    std::stable_sort(order.begin(), order.end(), [&](auto a, auto b) { return corners[a] < corners[b]; });
    for (std::size_t first = 0, end; first < order.size(); first = end) {
        std::vector<std::int32_t> groups;
        for (end = first; end < order.size() && corners[order[end]] == corners[order[first]]; ++end) {
            const auto found = std::find(groups.begin(), groups.end(), keys[order[end]]);
            const auto number = found - groups.begin();
            if (found == groups.end()) groups.push_back(keys[order[end]]);
            if (number > 0) corner_rows_[order[end]] = static_cast<std::int32_t>(count_ + number - 1);
        }
        count_ += static_cast<std::int64_t>(groups.size()) - 1;
    }
    if (shared.empty()) return;
    leaders_.resize(count_);
    std::iota(leaders_.begin(), leaders_.end(), 0);
    std::map<std::int32_t, std::int32_t> first_vertices;
    for (std::int32_t vertex = 0; vertex < vertices; ++vertex) {
        if (shared[vertex] > 0) leaders_[vertex] = first_vertices.try_emplace(shared[vertex], vertex).first->second;
    }
}

VtVec3fArray NormalRows::find(const VtVec3fArray &points) const {
    std::vector<GfVec3d> sums(count_, GfVec3d(0));
    const GfVec3f *at = points.cdata();
    std::size_t first = 0;
    for (const std::int32_t size : face_sizes_) {
        const auto point = [&](std::int32_t k) { return GfVec3d(at[corners_[first + k]]); };
        // Coordinates are relative to the first corner, so that nothing cancels far from the origin.
        GfVec3d area(0);
        const GfVec3d origin = point(0);
        for (std::int32_t k = 1; k + 1 < size; ++k) area += GfCross(point(k) - origin, point(k + 1) - origin);
        if (const double length = area.GetLength(); has_direction(length)) {
            for (std::int32_t k = 0; k < size; ++k) {
                const GfVec3d here = point(k);
                const GfVec3d next = point(k + 1 == size ? 0 : k + 1) - here;
                const GfVec3d previous = point(k == 0 ? size - 1 : k - 1) - here;
                const double angle = std::atan2(GfCross(next, previous).GetLength(), GfDot(next, previous));
                const std::int32_t row = corner_rows_[first + k];
                sums[leaders_.empty() ? row : leaders_[row]] += area * (angle / length);
            }
        }
        first += size;
    }
    VtVec3fArray found(count_);
    GfVec3f *normals = found.data();
    for (std::int64_t row = 0; row < count_; ++row) {
        const GfVec3d &sum = sums[leaders_.empty() ? row : leaders_[row]];
        const double length = sum.GetLength();
        normals[row] = has_direction(length) ? GfVec3f(sum * (1 / length)) : GfVec3f(0, 0, 1);
    }
    return found;
}

}  // namespace pdeanim_usd
