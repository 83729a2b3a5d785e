// Arrays of USD made from rows of numbers, by the type of the numbers and their role.
#pragma once

#include <pdeanim.h>

#include <span>
#include <string>
#include <vector>

#include "usd_headers.hpp"

namespace pdeanim_usd {

// A type of USD's attributes that holds rows of numbers.
struct ArrayType {
    TfToken name;
    std::size_t row_bytes;                                 // bytes of one element of the array
    VtValue (*make)(const void *data, std::size_t count);  // copies `count` elements
};

// The number's kind ('f', 'i', 'u' or 'b') and its size [bytes].
struct NumberType {
    char kind;
    std::size_t bytes;
    std::string name() const;  // NumPy's name, as "float32"
};

NumberType number_type(pdeanim_type type);
NumberType number_type(pdeanim_field_type type);

// Return the type for rows of a role ("uv", "color", "vector", "normal" or ""), or NULL if no type fits.
const ArrayType *array_type(const std::string &role, NumberType type, std::int64_t columns);

// Return the type for single numbers of a field: int for those that USD does not have.
const ArrayType &scalar_type(NumberType type);

// Return the numbers as 32-bit integers.
std::vector<std::int32_t> as_int32(const void *data, std::size_t count, NumberType type);

// Return rows of some bytes each in another order.
std::vector<char> rows_in_order(const void *data, std::size_t row_bytes, const std::vector<std::int32_t> &order);

// Return the order of corners that reverses every face; applied twice, it restores the original order.
std::vector<std::int32_t> reversed_corners(std::span<const std::int32_t> face_sizes);

template <class Row> VtArray<Row> array_of(const void *data, std::size_t count) {
    const Row *rows = static_cast<const Row *>(data);
    return VtArray<Row>(rows, rows + count);
}

}  // namespace pdeanim_usd
