// Normals of a mesh, computed from its positions and from which corners of a vertex share a normal.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "usd_headers.hpp"

namespace pdeanim_usd {

// Rows of normals: one per vertex in order, then one for each further group of corners of a vertex.
class NormalRows {
public:
    // keys: corners of a vertex with equal keys share a normal; shared: vertices with the same number from 1 share a
    // normal, may be empty.
    NormalRows(std::int64_t vertices, std::span<const std::int32_t> face_sizes, std::span<const std::int32_t> corners,
               const std::vector<std::int32_t> &keys, const std::vector<std::int32_t> &shared);

    // Whether there is one row per vertex.
    bool is_smooth() const { return count_ == vertices_; }

    // Return the row of each corner.
    VtIntArray corner_rows() const { return VtIntArray(corner_rows_.begin(), corner_rows_.end()); }

    // Return the unit normal of each row: normals of faces, weighted by the angles of their corners.
    VtVec3fArray find(const VtVec3fArray &points) const;

private:
    std::int64_t vertices_, count_;
    std::vector<std::int32_t> face_sizes_, corners_, corner_rows_;
    std::vector<std::int32_t> leaders_;  // the row whose normal a row has; empty: its own
};

}  // namespace pdeanim_usd
