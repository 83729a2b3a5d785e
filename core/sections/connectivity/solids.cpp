#include "sections/connectivity/solids.hpp"

#include <utility>

namespace pdeanim {

namespace {

constexpr i32 none = -1;

// Sides go counterclockwise seen from outside; edges are in the order of the nodes on them.
struct Solid {
    i32 corners, side_count, edge_count;
    std::array<std::array<i32, 4>, 6> sides;
    std::array<std::array<i32, 2>, 12> edges;
};

constexpr std::array<Solid, 4> solids = {
    {{4,
      4,
      6,
      {{{0, 1, 3, none}, {1, 2, 3, none}, {0, 3, 2, none}, {0, 2, 1, none}}},
      {{{0, 1}, {1, 2}, {2, 0}, {0, 3}, {1, 3}, {2, 3}}}},
     {5,
      5,
      8,
      {{{0, 1, 4, none}, {1, 2, 4, none}, {2, 3, 4, none}, {3, 0, 4, none}, {0, 3, 2, 1}}},
      {{{0, 1}, {1, 2}, {2, 3}, {3, 0}, {0, 4}, {1, 4}, {2, 4}, {3, 4}}}},
     {6,
      5,
      9,
      {{{0, 1, 4, 3}, {1, 2, 5, 4}, {0, 3, 5, 2}, {0, 2, 1, none}, {3, 4, 5, none}}},
      {{{0, 1}, {1, 2}, {2, 0}, {3, 4}, {4, 5}, {5, 3}, {0, 3}, {1, 4}, {2, 5}}}},
     {8,
      6,
      12,
      {{{0, 1, 5, 4}, {1, 2, 6, 5}, {2, 3, 7, 6}, {0, 4, 7, 3}, {0, 3, 2, 1}, {4, 5, 6, 7}}},
      {{{0, 1}, {1, 2}, {2, 3}, {3, 0}, {4, 5}, {5, 6}, {6, 7}, {7, 4}, {0, 4}, {1, 5}, {2, 6}, {3, 7}}}}}};

// Visit the solids of an object: the number, the shape and the nodes of each.
template <class Visit> void for_each_solid(const ConnectivityView &object, const Visit &visit) {
    std::size_t at = 0;
    for (std::size_t cell = 0; cell < object.cell_sizes.size(); ++cell) {
        const int shape = object.cell_shapes[cell] - static_cast<int>(CellShape::tetrahedron);
        const std::size_t size = static_cast<std::size_t>(object.cell_sizes[cell]);
        if (shape >= 0) visit(static_cast<i32>(cell), solids[shape], object.cell_indices.subspan(at, size));
        at += size;
    }
}

// Append the border of a side: its corners, with the nodes on its edges if there are any.
void add_border(const Solid &solid, i32 number, std::span<const i32> nodes, Connectivity &found) {
    const auto &side = solid.sides[number];
    const i32 size = side[3] == none ? 3 : 4;
    const bool has_middles = static_cast<i32>(nodes.size()) >= solid.corners + solid.edge_count;
    found.face_sizes.push_back(has_middles ? 2 * size : size);
    for (i32 k = 0; k < size; ++k) {
        const i32 tail = side[k], head = side[(k + 1) % size];
        found.face_indices.push_back(nodes[tail]);
        for (i32 edge = 0; has_middles && edge < solid.edge_count; ++edge) {
            const auto &[a, b] = solid.edges[edge];
            if ((a == tail && b == head) || (a == head && b == tail)) {
                found.face_indices.push_back(nodes[solid.corners + edge]);
            }
        }
    }
}

}  // namespace

CellSides sides_of_solids(const ConnectivityView &object) {
    CellSides found;
    std::vector<i32> corners;  // four of each side, in ascending order
    for_each_solid(object, [&](i32 cell, const Solid &solid, std::span<const i32> nodes) {
        for (i32 place = 0; place < solid.side_count; ++place) {
            found.cell.push_back(cell);
            found.place.push_back(place);
            for (const i32 corner : solid.sides[place]) {
                corners.push_back(corner == none ? none : nodes[corner]);
                for (std::size_t at = corners.size() - 1; at % 4 > 0 && corners[at - 1] > corners[at]; --at) {
                    std::swap(corners[at - 1], corners[at]);
                }
            }
        }
    });
    found.corners = number_rows(corners, 4);
    return found;
}

Connectivity inner_sides(const ConnectivityView &object) {
    const CellSides sides = sides_of_solids(object);
    const std::vector<i32> &of = sides.corners.of, &first = sides.corners.first;
    std::vector<bool> is_inner(first.size());
    for (std::size_t side = 0; side < of.size(); ++side) {
        if (first[of[side]] != static_cast<i32>(side)) is_inner[of[side]] = true;
    }
    Connectivity found;
    found.vertices = object.vertices;
    std::size_t side = 0;
    for_each_solid(object, [&](i32, const Solid &solid, std::span<const i32> nodes) {
        for (i32 place = 0; place < solid.side_count; ++place, ++side) {
            const i32 number = of[side];
            if (is_inner[number] && first[number] == static_cast<i32>(side)) add_border(solid, place, nodes, found);
        }
    });
    return found;
}

std::vector<Connectivity> with_inner_sides(std::span<const Connectivity> objects) {
    std::vector<Connectivity> found(objects.begin(), objects.end());
    for (Connectivity &own : found) {
        const Connectivity inner = inner_sides(view_of(own));
        for (const i32 size : inner.face_sizes) own.face_sizes.push_back(size);
        for (const i32 index : inner.face_indices) own.face_indices.push_back(index);
    }
    return found;
}

}  // namespace pdeanim
