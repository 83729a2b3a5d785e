// What the attributes of one object are attached to: its polygons, and what they say of each other.
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

// What has values, and where: a corner, a vertex, a face, or a row that is named apart.
struct AttributeElements {
    // of_corner: element of each corner, -1 for none.
    AttributeElements(std::vector<i32> of_corner, i64 count);

    i64 count() const { return static_cast<i64>(starts.size()) - 1; }

    std::vector<i32> of_corner;
    std::vector<i64> starts;   // element e has the corners corners[starts[e]] to corners[starts[e + 1] - 1], ascending
    std::vector<i32> corners;  // those that are of an element
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

    // The polygons over their vertices, and over their points: vertices that lie on one point of the grid are one.
    const CornerTable &by_vertex();
    const CornerTable &by_point();

    // Of polygons, their largest component of 12 bits at most.
    const std::vector<GridPoint> &normals();

    // The elements of a domain, of which there are `count`.
    AttributeElements elements_of(Domain domain, i64 count) const;

    // How many elements a domain has; 0 of objects, whose rows are counted apart.
    i64 count_of(Domain domain) const;

    // Of each corner, its wedge in the attribute before; empty where there is none.
    std::vector<i32> earlier;

    // The values of the attribute before that measures, if there is one.
    std::unique_ptr<WedgeField> measured;

private:
    Polygons polygons_;
    std::span<const GridPoint> grid_;
    std::optional<CornerTable> by_vertex_, by_point_;
    std::vector<GridPoint> normals_;
    bool has_points_ = false;
};

// Things numbered from 0, equal ones alike, as they come first.
struct Numbered {
    std::vector<i32> of;     // each thing's number
    std::vector<i32> first;  // the first thing of each number
};

// By sorting: nobody can choose keys for which that takes long.
template <class Key> Numbered number_by_key(const std::vector<Key> &keys) {
    std::vector<std::pair<Key, i32>> sorted;
    sorted.reserve(keys.size());
    for (std::size_t i = 0; i < keys.size(); ++i) sorted.emplace_back(keys[i], static_cast<i32>(i));
    std::sort(sorted.begin(), sorted.end());
    Numbered found;
    found.of.resize(keys.size());
    // At first, the first thing that each one is equal to.
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

// Some rows of an array of so many channels.
template <class T> std::vector<T> rows_of(const std::vector<T> &values, i64 channels, std::span<const i32> rows) {
    std::vector<T> found;
    found.reserve(rows.size() * channels);
    for (const i32 row : rows) {
        const auto first = values.begin() + row * channels;
        found.insert(found.end(), first, first + channels);
    }
    return found;
}

// Rows of up to four numbers, in an array of so many channels each.
Numbered number_rows(std::span<const i32> codes, int channels);

// Of each corner, the number of its key among those of its vertex, as they come first.
std::vector<i32> fan_numbers(std::span<const i32> vertices, std::span<const i32> keys);

// Rules of rows: one for each element; one for each vertex, of corners; as listed; and from `first_used` on, numbered as
// elements use them for the first time: two rules for each order of elements, rows being shared by equal values at a
// vertex, or by all equal values. The orders are: as they are; backward in each face; corners by their vertex.
enum RowRule : i64 { not_indexed, by_vertex, listed, first_used, last_rule = first_used + 5 };

// Rows numbered as elements use them first: the row of each element, and an element of each row.
//
// rule: `first_used` or more; codes: those of every element.
Numbered number_by_use(const AttributeMesh &mesh, Domain domain, i64 rule, std::span<const i32> codes, int channels);

}  // namespace pdeanim
