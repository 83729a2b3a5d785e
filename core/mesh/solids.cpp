#include "mesh/solids.hpp"

#include <algorithm>

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

std::vector<CellSide> sides_of_solids(const ConnectivityView &object) {
    std::vector<CellSide> found;
    for_each_solid(object, [&](i32 cell, const Solid &solid, std::span<const i32> nodes) {
        for (i32 number = 0; number < solid.side_count; ++number) {
            CellSide side{.corners = {none, none, none, none}, .cell = cell, .number = number};
            for (std::size_t k = 0; k < 4; ++k) {
                if (const i32 corner = solid.sides[number][k]; corner != none) side.corners[k] = nodes[corner];
            }
            std::sort(side.corners.begin(), side.corners.end());
            found.push_back(side);
        }
    });
    std::sort(found.begin(), found.end());
    return found;
}

Connectivity inner_sides(const ConnectivityView &object) {
    const std::vector<CellSide> sides = sides_of_solids(object);
    std::vector<std::array<i32, 2>> firsts;  // cell and number of the first of several equal sides
    for (std::size_t begin = 0, end = 0; begin < sides.size(); begin = end) {
        while (end < sides.size() && sides[end].corners == sides[begin].corners) ++end;
        if (end > begin + 1) firsts.push_back({sides[begin].cell, sides[begin].number});
    }
    std::sort(firsts.begin(), firsts.end());
    Connectivity found;
    found.vertices = object.vertices;
    auto first = firsts.begin();
    for_each_solid(object, [&](i32 cell, const Solid &solid, std::span<const i32> nodes) {
        for (; first != firsts.end() && (*first)[0] == cell; ++first) add_border(solid, (*first)[1], nodes, found);
    });
    return found;
}

std::vector<Connectivity> with_inner_sides(std::span<const ConnectivityView> objects) {
    std::vector<Connectivity> found;
    for (const ConnectivityView &object : objects) {
        Connectivity own;
        own.vertices = object.vertices;
        own.face_sizes.assign(object.face_sizes.begin(), object.face_sizes.end());
        own.face_indices.assign(object.face_indices.begin(), object.face_indices.end());
        own.line_sizes.assign(object.line_sizes.begin(), object.line_sizes.end());
        own.line_indices.assign(object.line_indices.begin(), object.line_indices.end());
        const Connectivity inner = inner_sides(object);
        own.face_sizes.insert(own.face_sizes.end(), inner.face_sizes.begin(), inner.face_sizes.end());
        own.face_indices.insert(own.face_indices.end(), inner.face_indices.begin(), inner.face_indices.end());
        found.push_back(std::move(own));
    }
    return found;
}

}  // namespace pdeanim
