#include "sections/attributes/attribute_mesh.hpp"

#include <numeric>
#include <utility>

#include "sections/attributes/wedges.hpp"

namespace pdeanim {

namespace {

// Bits of the largest component of a face's normal, and of the edges whose cross products are summed for it.
constexpr int normal_bits = 12, edge_bits = 16;

GridPoint normal_of(std::span<const i32> vertices, std::span<const GridPoint> grid) {
    const GridPoint &origin = grid[vertices[0]];
    i64 largest = 0;
    for (const i32 vertex : vertices) {
        for (int k = 0; k < 3; ++k) largest = most(largest, size_of(grid[vertex][k] - origin[k]));
    }
    const int shift = most(bit_length(largest) - edge_bits, 0);
    GridPoint normal{};
    for (std::size_t corner = 1; corner + 1 < vertices.size(); ++corner) {
        GridPoint u, w;
        for (int k = 0; k < 3; ++k) {
            u[k] = (grid[vertices[corner]][k] - origin[k]) >> shift;
            w[k] = (grid[vertices[corner + 1]][k] - origin[k]) >> shift;
        }
        for (int k = 0; k < 3; ++k) normal[k] += u[(k + 1) % 3] * w[(k + 2) % 3] - u[(k + 2) % 3] * w[(k + 1) % 3];
    }
    const i64 greatest = most(size_of(normal[0]), most(size_of(normal[1]), size_of(normal[2])));
    const int digits = most(bit_length(greatest) - normal_bits, 0);
    for (i64 &component : normal) component >>= digits;
    return normal;
}

}  // namespace

AttributeElements::AttributeElements(std::vector<i32> of_corner_, i64 count)
    : of_corner(std::move(of_corner_)), starts(count + 1) {
    for (const i32 element : of_corner) {
        if (element >= 0) ++starts[element + 1];
    }
    std::partial_sum(starts.begin(), starts.end(), starts.begin());
    corners.resize(starts[count]);
    std::vector<i64> fill(starts.begin(), starts.end() - 1);
    for (std::size_t corner = 0; corner < of_corner.size(); ++corner) {
        if (of_corner[corner] >= 0) corners[fill[of_corner[corner]]++] = static_cast<i32>(corner);
    }
}

AttributeMesh::AttributeMesh(const ConnectivityView &part, std::span<const GridPoint> grid)
    : cells_(static_cast<i64>(part.cell_sizes.size())), grid_(grid) {
    polygons_.faces = static_cast<i64>(part.face_sizes.size());
    polygons_.vertices = part.vertices;
    for (const i32 size : part.face_sizes) polygons_.starts.push_back(polygons_.starts.back() + size);
    polygons_.vertex.assign(part.face_indices.begin(), part.face_indices.end());
    std::size_t first = 0;
    for (const i32 size : part.line_sizes) {
        for (i32 piece = 0; piece + 1 < size; ++piece) {
            polygons_.vertex.push_back(part.line_indices[first + piece]);
            polygons_.vertex.push_back(part.line_indices[first + piece + 1]);
            polygons_.starts.push_back(polygons_.starts.back() + 2);
        }
        first += size;
    }
}

AttributeMesh::~AttributeMesh() = default;

const CornerTable &AttributeMesh::by_vertex() {
    if (!by_vertex_) by_vertex_.emplace(polygons_);
    return *by_vertex_;
}

const CornerTable &AttributeMesh::by_point() {
    if (!has_points_) {
        has_points_ = true;
        const Numbered points = number_by_key(std::vector<GridPoint>(grid_.begin(), grid_.end()));
        if (points.first.size() < grid_.size()) {
            Polygons welded = polygons_;
            for (i32 &vertex : welded.vertex) vertex = points.of[vertex];
            welded.vertices = static_cast<i64>(points.first.size());
            by_point_.emplace(std::move(welded));
        }
    }
    return by_point_ ? *by_point_ : by_vertex();
}

const std::vector<GridPoint> &AttributeMesh::normals() {
    const std::vector<i64> &starts = polygons_.starts;
    if (normals_.empty()) {
        for (std::size_t polygon = 0; polygon + 1 < starts.size(); ++polygon) {
            const std::size_t size = static_cast<std::size_t>(starts[polygon + 1] - starts[polygon]);
            normals_.push_back(normal_of({polygons_.vertex.data() + starts[polygon], size}, grid_));
        }
    }
    return normals_;
}

AttributeElements AttributeMesh::elements_of(Domain domain, i64 count) const {
    if (domain == Domain::vertex) return {polygons_.vertex, count};
    std::vector<i32> of_corner(corners(), -1);
    if (domain == Domain::corner) std::iota(of_corner.begin(), of_corner.begin() + count, 0);
    if (domain == Domain::face) {
        for (i64 face = 0; face < count; ++face) {
            for (i64 corner = polygons_.starts[face]; corner < polygons_.starts[face + 1]; ++corner) {
                of_corner[corner] = static_cast<i32>(face);
            }
        }
    }
    return {std::move(of_corner), count};
}

i64 AttributeMesh::count_of(Domain domain) const {
    switch (domain) {
        case Domain::vertex: return polygons_.vertices;
        case Domain::face: return polygons_.faces;
        case Domain::corner: return static_cast<i64>(face_corners().size());
        case Domain::cell: return cells_;
        default: return 0;
    }
}

namespace {

enum Order { forward, backward, by_site };

// The point of an element, or -1, and up to four codes of its value.
using Key = std::array<i32, 5>;

std::vector<Key> keys_of(std::span<const i32> codes, int channels) {
    std::vector<Key> keys(channels ? codes.size() / channels : 0, Key{-1});
    for (std::size_t row = 0; row < keys.size(); ++row) {
        for (int k = 0; k < channels; ++k) keys[row][1 + k] = codes[row * channels + k];
    }
    return keys;
}

// Return the corners of all faces, face after face, in each face from its last corner to its first.
std::vector<i32> backward_corners(const Polygons &polygons) {
    std::vector<i32> sequence;
    for (i64 face = 0; face < polygons.faces; ++face) {
        for (i64 corner = polygons.starts[face + 1]; corner-- > polygons.starts[face];) {
            sequence.push_back(static_cast<i32>(corner));
        }
    }
    return sequence;
}

}  // namespace

Numbered number_rows(std::span<const i32> codes, int channels) { return number_by_key(keys_of(codes, channels)); }

std::vector<i32> fan_numbers(std::span<const i32> vertices, std::span<const i32> keys) {
    std::vector<std::pair<i32, i32>> pairs;
    pairs.reserve(vertices.size());
    for (std::size_t corner = 0; corner < vertices.size(); ++corner) pairs.emplace_back(vertices[corner], keys[corner]);
    Numbered fans = number_by_key(pairs);
    std::vector<i32> fans_at(vertices.empty() ? 0 : i64{1} + *std::max_element(vertices.begin(), vertices.end()));
    std::vector<i32> number(fans.first.size());
    for (std::size_t fan = 0; fan < number.size(); ++fan) number[fan] = fans_at[vertices[fans.first[fan]]]++;
    for (i32 &fan : fans.of) fan = number[fan];
    return std::move(fans.of);
}

Numbered number_by_use(const AttributeMesh &mesh, Domain domain, i64 rule, std::span<const i32> codes, int channels) {
    const Order order = static_cast<Order>((rule - first_used) / 2);
    const bool is_global = (rule - first_used) % 2;
    std::vector<Key> keys = keys_of(codes, channels);
    const std::span<const i32> vertices = mesh.face_corners();
    const bool is_corner = domain == Domain::corner;
    if (!is_global) {
        for (std::size_t i = 0; i < keys.size(); ++i) keys[i][0] = is_corner ? vertices[i] : static_cast<i32>(i);
    }
    Numbered alike = number_by_key(keys);
    if (order == forward || !is_corner) return alike;
    std::vector<i32> sequence;
    if (order == backward) {
        sequence = backward_corners(mesh.polygons());
    } else {
        sequence.resize(keys.size());
        std::iota(sequence.begin(), sequence.end(), 0);
        std::stable_sort(sequence.begin(), sequence.end(), [&](i32 a, i32 b) { return vertices[a] < vertices[b]; });
    }
    std::vector<i32> number(alike.first.size(), -1);
    Numbered found;
    found.of.resize(keys.size());
    for (const i32 element : sequence) {
        i32 &row = number[alike.of[element]];
        if (row < 0) {
            row = static_cast<i32>(found.first.size());
            found.first.push_back(element);
        }
        found.of[element] = row;
    }
    return found;
}

}  // namespace pdeanim
