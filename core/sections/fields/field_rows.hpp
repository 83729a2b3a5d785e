// The rows of a field (vertices, faces, corners, objects or cells), their order, and the rows that predict each row.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "base/arithmetic.hpp"
#include "mesh/corner_table.hpp"

namespace pdeanim {

struct FieldRows {
    static constexpr int most_neighbours = 4;

    // Number the rows of objects, one object after the other. Vertices have neighbours along edges, also inside solids;
    // faces across edges; cells across the sides of solids. The neighbours of a corner are another corner of its vertex
    // and the other corners of its face. Objects have none.
    FieldRows(Domain domain, std::span<const ConnectivityView> objects);

    // Return the peak memory of the constructor.
    static u64 building_bytes(Domain domain, std::span<const ConnectivityView> objects);

    u64 bytes() const { return sizeof(i64) * starts.capacity() + sizeof(i32) * neighbours.capacity(); }

    i64 count() const { return static_cast<i64>(starts.size()) - 1; }
    std::span<const i32> of(i64 row) const {
        return {neighbours.data() + starts[row], neighbours.data() + starts[row + 1]};
    }

    std::vector<i64> starts;      // where the neighbours of each row start
    std::vector<i32> neighbours;  // earlier rows near each row, the latest first, at most `most_neighbours`
};

}  // namespace pdeanim
