// The mesh that an object's attributes are attached to, and the data that one attribute gives the coder of the next.
#pragma once

#include <algorithm>
#include <array>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "mesh/corner_table.hpp"
#include "sections/connectivity/connectivity.hpp"

namespace pdeanim {

class WedgeField;

using GridPoint = std::array<i64, 3>;  // grid coordinates of a vertex of the reference frame

// The elements that have values, and the corners of each. An element is a corner, a vertex, a face, or a row that is
// listed separately.
struct AttributeElements {
    // of_corner: element of each corner, -1 if it has none; count: number of elements.
    AttributeElements(std::vector<i32> of_corner, i64 count);

    i64 count() const { return static_cast<i64>(starts.size()) - 1; }

    std::vector<i32> of_corner;
    std::vector<i64> starts;   // element e has the corners corners[starts[e]] to corners[starts[e + 1] - 1], ascending
    std::vector<i32> corners;  // corners of an element
};

class AttributeMesh {
public:
    // grid: grid coordinates of the object's vertices; it must outlive the mesh.
    AttributeMesh(const ConnectivityView &part, std::span<const GridPoint> grid);
    ~AttributeMesh();

    const Polygons &polygons() const { return polygons_; }
    std::span<const GridPoint> grid() const { return grid_; }
    i64 corners() const { return static_cast<i64>(polygons_.vertex.size()); }

    // Return the vertex of each corner of a face.
    std::span<const i32> face_corners() const {
        return {polygons_.vertex.data(), static_cast<std::size_t>(polygons_.starts[polygons_.faces])};
    }

    // Return the polygons with vertices as corners, or with points: vertices at the same grid point count as one point.
    const CornerTable &by_vertex();
    const CornerTable &by_point();

    // Return the normals of polygons, scaled so that the largest component has at most 12 bits.
    const std::vector<GridPoint> &normals();

    // Return the elements of a domain; count: their number.
    AttributeElements elements_of(Domain domain, i64 count) const;

    // Return the number of elements of a domain; 0 for objects, whose rows are counted separately.
    i64 count_of(Domain domain) const;

    // Wedge of each corner in the previous attribute; empty if there was none.
    std::vector<i32> earlier;

    // Values of the previous measured attribute; null if there was none.
    std::unique_ptr<WedgeField> measured;

private:
    i64 cells_;
    Polygons polygons_;
    std::span<const GridPoint> grid_;
    std::optional<CornerTable> by_vertex_, by_point_;
    std::vector<GridPoint> normals_;
    bool has_points_ = false;
};

// Items numbered from 0 in order of first occurrence; equal items have the same number.
struct Numbered {
    std::vector<i32> of;     // number of each item
    std::vector<i32> first;  // for each number, the first item that has it
};

// Number items by their keys. Done by sorting, so that no choice of keys makes it slow.
template <class Key> Numbered number_by_key(const std::vector<Key> &keys) {
    std::vector<std::pair<Key, i32>> sorted;
    sorted.reserve(keys.size());
    for (std::size_t i = 0; i < keys.size(); ++i) sorted.emplace_back(keys[i], static_cast<i32>(i));
    std::sort(sorted.begin(), sorted.end());
    Numbered found;
    found.of.resize(keys.size());
    // For each item, the first item that equals it.
    i32 first = 0;
    for (std::size_t k = 0; k < sorted.size(); ++k) {
        if (k == 0 || sorted[k].first != sorted[k - 1].first) first = sorted[k].second;
        found.of[sorted[k].second] = first;
    }
    for (std::size_t i = 0; i < keys.size(); ++i) {
        const i32 equal = found.of[i];
        if (equal == static_cast<i32>(i)) {
            found.of[i] = static_cast<i32>(found.first.size());
            found.first.push_back(equal);
        } else {
            found.of[i] = found.of[equal];
        }
    }
    return found;
}

// Return some rows of an array with `channels` numbers per row.
template <class T> std::vector<T> rows_of(const std::vector<T> &values, i64 channels, std::span<const i32> rows) {
    std::vector<T> found;
    found.reserve(rows.size() * channels);
    for (const i32 row : rows) {
        const auto first = values.begin() + row * channels;
        found.insert(found.end(), first, first + channels);
    }
    return found;
}

// Number rows of up to four numbers; `codes` has `channels` numbers per row.
Numbered number_rows(std::span<const i32> codes, int channels);

// Number the keys at each vertex, in order of first occurrence; return the number for each corner.
std::vector<i32> fan_numbers(std::span<const i32> vertices, std::span<const i32> keys);

// How the rows of indexed values are numbered. Either each element has its own row, or each vertex has one (for
// corners), or rows are listed, or they are numbered by first use. From `first_used` on there are two rules for each
// order of elements: equal values share a row at a vertex, or everywhere. The orders are forward, backward in each
// face, and corners by vertex.
enum RowRule : i64 { not_indexed, by_vertex, listed, first_used, last_rule = first_used + 5 };

// Number rows by first use. Return the row of each element, and for each row the first element that has it.
//
// rule: `first_used` or more; codes: codes of all elements.
Numbered number_by_use(const AttributeMesh &mesh, Domain domain, i64 rule, std::span<const i32> codes, int channels);

}  // namespace pdeanim
