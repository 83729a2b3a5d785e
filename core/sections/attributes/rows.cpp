#include "sections/attributes/rows.hpp"

#include <numeric>

namespace pdeanim {

namespace {

enum Order { forward, backward, by_site };

// A site, or -1, and up to four codes.
using Key = std::array<i32, 5>;

std::vector<Key> keys_of(std::span<const i32> codes, int channels) {
    std::vector<Key> keys(channels ? codes.size() / channels : 0, Key{-1});
    for (std::size_t row = 0; row < keys.size(); ++row) {
        for (int k = 0; k < channels; ++k) keys[row][1 + k] = codes[row * channels + k];
    }
    return keys;
}

// Corners of faces, each face from its last one.
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
