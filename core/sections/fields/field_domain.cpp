#include "sections/fields/field_domain.hpp"

#include <algorithm>
#include <numeric>

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

// Edges between the corners of a polygon, or along a line.
template <class Visit> void for_each_edge(std::span<const i32> corners, bool is_closed, const Visit &visit) {
    for (std::size_t i = 1; i < corners.size(); ++i) visit(corners[i - 1], corners[i]);
    if (is_closed) visit(corners.back(), corners.front());
}

template <class Visit>
void for_each_polygon(std::span<const i32> sizes, std::span<const i32> indices, const Visit &visit) {
    std::size_t first = 0;
    for (const i32 size : sizes) {
        visit(indices.subspan(first, size));
        first += size;
    }
}

void link_vertices(const ConnectivityView &object, i64 first, Links &links) {
    const auto link = [&](i32 one, i32 other) { links.add(first + one, first + other); };
    for_each_polygon(object.face_sizes, object.face_indices,
                     [&](std::span<const i32> corners) { for_each_edge(corners, true, link); });
    for_each_polygon(object.line_sizes, object.line_indices,
                     [&](std::span<const i32> corners) { for_each_edge(corners, false, link); });
}

// Of several faces on an edge, each is a neighbour of the one before.
void link_faces(const ConnectivityView &object, i64 first, Links &links) {
    struct Side {
        i32 low, high;
        i64 face;
        auto operator<=>(const Side &) const = default;
    };
    std::vector<Side> sides;
    i64 face = first;
    for_each_polygon(object.face_sizes, object.face_indices, [&](std::span<const i32> corners) {
        for_each_edge(corners, true,
                      [&](i32 one, i32 other) { sides.push_back({std::min(one, other), std::max(one, other), face}); });
        ++face;
    });
    std::sort(sides.begin(), sides.end());
    for (std::size_t i = 1; i < sides.size(); ++i) {
        if (sides[i].low == sides[i - 1].low && sides[i].high == sides[i - 1].high) {
            links.add(sides[i].face, sides[i - 1].face);
        }
    }
}

// The latest corner of the same vertex, and the two corners before it in its face.
void link_corners(const ConnectivityView &object, i64 first, Links &links) {
    std::vector<i64> latest(object.vertices, -1);
    i64 corner = first;
    for_each_polygon(object.face_sizes, object.face_indices, [&](std::span<const i32> corners) {
        const i64 begin = corner;
        for (const i32 vertex : corners) {
            if (latest[vertex] >= 0) links.add(corner, latest[vertex]);
            latest[vertex] = corner;
            for (i64 other = std::max(begin, corner - 2); other < corner; ++other) links.add(corner, other);
            ++corner;
        }
    });
}

}  // namespace

FieldDomain::FieldDomain(FieldSite site, std::span<const ConnectivityView> objects) {
    Links links;
    i64 rows = 0;
    for (const ConnectivityView &object : objects) {
        switch (site) {
            case FieldSite::vertex:
                link_vertices(object, rows, links);
                rows += object.vertices;
                break;
            case FieldSite::face:
                link_faces(object, rows, links);
                rows += static_cast<i64>(object.face_sizes.size());
                break;
            case FieldSite::corner:
                link_corners(object, rows, links);
                rows += static_cast<i64>(object.face_indices.size());
                break;
            case FieldSite::object: ++rows;
        }
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
