#include "sections/fields/field_rows.hpp"

#include <algorithm>
#include <numeric>

#include "mesh/graph.hpp"
#include "sections/connectivity/solids.hpp"

namespace pdeanim {

namespace {

// Two rows that are neighbours.
struct Link {
    i32 later, earlier;
};

struct Links : std::vector<Link> {
    void add(i64 one, i64 other) {
        if (one != other) push_back({static_cast<i32>(std::max(one, other)), static_cast<i32>(std::min(one, other))});
    }
};

void link_vertices(const ConnectivityView &object, i64 first, Links &links) {
    for (const Edge &edge : edges_of({&object, 1})) links.add(first + edge.tail, first + edge.head);
    if (object.cell_sizes.empty()) return;
    const Connectivity inner = inner_sides(object);
    link_vertices(view_of(inner), first, links);
}

// If several solids share a side, each is a neighbour of the one before.
void link_cells(const ConnectivityView &object, i64 first, Links &links) {
    const CellSides sides = sides_of_solids(object);
    std::vector<i32> before(sides.corners.first.size(), -1);  // the latest cell on a side
    for (std::size_t side = 0; side < sides.cell.size(); ++side) {
        i32 &latest = before[sides.corners.of[side]];
        if (latest >= 0) links.add(first + sides.cell[side], first + latest);
        latest = sides.cell[side];
    }
}

// Link faces that share an edge. If several faces share an edge, each is a neighbour of the one before.
void link_faces(const ConnectivityView &object, i64 first, Links &links) {
    struct Side {
        i32 low, high;
        i64 face;
        auto operator<=>(const Side &) const = default;
    };
    std::vector<Side> sides;
    sides.reserve(object.face_indices.size());
    const std::vector<Edge> edges = edges_of({&object, 1});  // edges of faces come first, corner by corner
    auto edge = edges.begin();
    i64 face = first;
    for (const i32 size : object.face_sizes) {
        for (i32 k = 0; k < size; ++k, ++edge) {
            sides.push_back({std::min(edge->tail, edge->head), std::max(edge->tail, edge->head), face});
        }
        ++face;
    }
    std::sort(sides.begin(), sides.end());
    for (std::size_t i = 1; i < sides.size(); ++i) {
        if (sides[i].low == sides[i - 1].low && sides[i].high == sides[i - 1].high) {
            links.add(sides[i].face, sides[i - 1].face);
        }
    }
}

// Link a corner to the latest corner of the same vertex, and to the two corners before it in its face.
void link_corners(const ConnectivityView &object, i64 first, Links &links) {
    std::vector<i64> latest(object.vertices, -1);
    i64 corner = first;
    for (const i32 size : object.face_sizes) {
        const i64 begin = corner;
        for (; corner < begin + size; ++corner) {
            i64 &latest_here = latest[object.face_indices[corner - first]];
            if (latest_here >= 0) links.add(corner, latest_here);
            latest_here = corner;
            for (i64 other = std::max(begin, corner - 2); other < corner; ++other) links.add(corner, other);
        }
    }
}

}  // namespace

u64 FieldRows::building_bytes(Domain domain, std::span<const ConnectivityView> objects) {
    // Memory per row of tables that grow by doubling; and per link, of the links and of the edges or sides from which
    // they are made.
    constexpr u64 bytes_per_row = 2 * (sizeof(i64) + most_neighbours * sizeof(i32));
    // Sides of solids and borders of the inner ones, both of which grow: fewer than nodes of solids.
    constexpr u64 bytes_per_node = 192;
    const u64 bytes_per_corner = domain == Domain::vertex   ? 32
                                 : domain == Domain::face   ? 48
                                 : domain == Domain::corner ? 72
                                                            : 0;
    u64 bytes = sizeof(i64);
    for (const ConnectivityView &object : objects) {
        const u64 corners = object.face_indices.size() + object.line_indices.size();
        bytes += bytes_per_row * static_cast<u64>(element_count(domain, object)) + bytes_per_corner * corners;
        if (domain == Domain::vertex || domain == Domain::cell) bytes += bytes_per_node * object.cell_indices.size();
        if (domain == Domain::corner) bytes += sizeof(i64) * static_cast<u64>(object.vertices);
    }
    return bytes;
}

FieldRows::FieldRows(Domain domain, std::span<const ConnectivityView> objects) {
    Links links;
    i64 rows = 0;
    for (const ConnectivityView &object : objects) {
        switch (domain) {
            case Domain::vertex: link_vertices(object, rows, links); break;
            case Domain::face: link_faces(object, rows, links); break;
            case Domain::corner: link_corners(object, rows, links); break;
            case Domain::object: break;
            case Domain::cell: link_cells(object, rows, links); break;
        }
        rows += element_count(domain, object);
    }
    std::sort(links.begin(), links.end(), [](const Link &a, const Link &b) {
        return a.later != b.later ? a.later < b.later : a.earlier > b.earlier;
    });
    starts.assign(rows + 1, 0);
    auto link = links.begin();
    for (i64 row = 0; row < rows; ++row) {
        const std::size_t first = neighbours.size();
        for (; link != links.end() && link->later == row; ++link) {
            const bool is_new = neighbours.size() == first || neighbours.back() != link->earlier;
            if (is_new && neighbours.size() < first + most_neighbours) neighbours.push_back(link->earlier);
        }
        starts[row + 1] = static_cast<i64>(neighbours.size());
    }
}

}  // namespace pdeanim
