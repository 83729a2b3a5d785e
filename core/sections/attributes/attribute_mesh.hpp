// What the attributes of one object are attached to: its polygons, and what they say of each other.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <span>
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

}  // namespace pdeanim
