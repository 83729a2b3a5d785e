// Numbers for things that are alike, and the rules by which an attribute's rows are numbered.
#pragma once

#include <algorithm>
#include <array>
#include <span>
#include <utility>
#include <vector>

#include "sections/attributes/attribute_mesh.hpp"

namespace pdeanim {

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
