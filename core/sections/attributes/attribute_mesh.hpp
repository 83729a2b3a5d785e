// The mesh that the attributes of one object are attached to, and the knowledge that attributes share.
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

enum class Domain : u8 { vertex, face, corner, object };
constexpr i64 domain_count = 4;

// Elements that have values, and their corners: a corner, a vertex, a face, or a row that is listed separately.
struct AttributeElements {
    // of_corner: element of each corner, -1 for none.
    AttributeElements(std::vector<i32> of_corner, i64 count);

    i64 count() const { return static_cast<i64>(starts.size()) - 1; }

    std::vector<i32> of_corner;
    std::vector<i64> starts;   // element e has the corners corners[starts[e]] to corners[starts[e + 1] - 1], ascending
    std::vector<i32> corners;  // corners of an element
};

class AttributeMesh {
public:
    // grid: of the object's vertices; it must outlive the mesh.
    AttributeMesh(const ConnectivityView &part, std::span<const GridPoint> grid);
    ~AttributeMesh();

    const Polygons &polygons() const { return polygons_; }
    std::span<const GridPoint> grid() const { return grid_; }
    i64 corners() const { return static_cast<i64>(polygons_.vertex.size()); }

    // Vertex of each corner of a face.
    std::span<const i32> face_corners() const {
        return {polygons_.vertex.data(), static_cast<std::size_t>(polygons_.starts[polygons_.faces])};
    }

    // The polygons over vertices, and over points: vertices at the same grid point are one.
    const CornerTable &by_vertex();
    const CornerTable &by_point();

    // Normals of polygons, with at most 12 bits in the largest component.
    const std::vector<GridPoint> &normals();

    // The elements of a domain; `count` is their number.
    AttributeElements elements_of(Domain domain, i64 count) const;

    // Number of elements of a domain; 0 for objects, whose rows are counted separately.
    i64 count_of(Domain domain) const;

    // Wedge of each corner in the previous attribute; empty without one.
    std::vector<i32> earlier;

    // Values of the previous measured attribute, if any.
    std::unique_ptr<WedgeField> measured;

private:
    Polygons polygons_;
    std::span<const GridPoint> grid_;
    std::optional<CornerTable> by_vertex_, by_point_;
    std::vector<GridPoint> normals_;
    bool has_points_ = false;
};

// Items numbered from 0 in order of first occurrence; equal items share a number.
struct Numbered {
    std::vector<i32> of;     // each thing's number
    std::vector<i32> first;  // the first item of each number
};

// By sorting, so that no choice of keys makes it slow.
template <class Key> Numbered number_by_key(const std::vector<Key> &keys) {
    std::vector<std::pair<Key, i32>> sorted;
    sorted.reserve(keys.size());
    for (std::size_t i = 0; i < keys.size(); ++i) sorted.emplace_back(keys[i], static_cast<i32>(i));
    std::sort(sorted.begin(), sorted.end());
    Numbered found;
    found.of.resize(keys.size());
    // Initially, the first item that each one equals.
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

// Some rows of an array with `channels` numbers per row.
template <class T> std::vector<T> rows_of(const std::vector<T> &values, i64 channels, std::span<const i32> rows) {
    std::vector<T> found;
    found.reserve(rows.size() * channels);
    for (const i32 row : rows) {
        const auto first = values.begin() + row * channels;
        found.insert(found.end(), first, first + channels);
    }
    return found;
}

// Number rows of up to four numbers, in an array of `channels` per row.
Numbered number_rows(std::span<const i32> codes, int channels);

// For each corner, number its key among those of its vertex, in order of first occurrence.
std::vector<i32> fan_numbers(std::span<const i32> vertices, std::span<const i32> keys);

// Rules of rows: one per element; one per vertex, for corners; listed; and from `first_used` on, numbered by first use:
// two rules for each order of elements, with rows shared by equal values at a vertex, or by all equal values. The
// orders are: forward; backward in each face; corners by vertex.
enum RowRule : i64 { not_indexed, by_vertex, listed, first_used, last_rule = first_used + 5 };

// Number rows by first use: return the row of each element, and an element of each row.
//
// rule: `first_used` or more; codes: those of every element.
Numbered number_by_use(const AttributeMesh &mesh, Domain domain, i64 rule, std::span<const i32> codes, int channels);

}  // namespace pdeanim
