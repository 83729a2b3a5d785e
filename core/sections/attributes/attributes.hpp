// Section ATTR: constant data of objects, coded by means of the faces and the reference frame that a decoder already
// has.
//
// Values of corners, vertices or faces are coded in two steps: first which of them are equal around each point, then
// the values. Measured values (UVs, colours) are predicted over the surface; labels are coded as steps. Row numbers
// take no bytes if rows are numbered by first use.
//
// This folder codes section ATTR (17 of the specification). Begin here: attributes.cpp has the stream, plan the head of
// an attribute and the model of its values, wedges the equal values around a point and their prediction, scales the
// quantised values of a channel, attribute_mesh the mesh that attributes are attached to.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/errors.hpp"
#include "sections/attributes/attribute_mesh.hpp"

namespace pdeanim {

// Types, with their numbers in the stream. The bytes of values are little-endian, as on every supported machine.
enum class ValueType : i64 { float32, float64, int32, uint8, int64 };
constexpr i64 value_types = 5;

constexpr i64 bytes_of(ValueType type) {
    constexpr i64 sizes[] = {4, 8, 4, 1, 8};
    return sizes[static_cast<i64>(type)];
}

// Constant data that travels with an object.
struct Attribute {
    i64 numbers() const { return columns ? columns - 1 : 1; }  // number of numbers per row

    std::string name;  // UTF-8, like the labels
    Domain domain = Domain::vertex;
    ValueType type = ValueType::float32;
    i64 rows = 0, columns = 0;  // columns: 0 for one-dimensional values, else 1 + the number of columns
    std::vector<u8> values;
    std::optional<std::vector<i32>> indices;  // row of each element of the domain, -1 for none
    std::vector<std::string> labels;
};

// An attribute as views of the caller's arrays.
struct AttributeView {
    std::string name;
    Domain domain;
    ValueType type;
    i64 rows, columns;
    std::span<const u8> values;
    std::optional<std::span<const i32>> indices;
    std::vector<std::string> labels;
};

// One object, and its attributes to encode.
struct AttributedPart {
    ConnectivityView connectivity;
    std::vector<AttributeView> attributes;
};

struct AttributeSettings {
    std::optional<double> uv_tolerance;  // largest error of texture coordinates on each axis; empty: exact
    bool keeps_rows = true;              // whether the rows of indexed values keep their numbers
};

// Encode the attributes of all parts. grid: grid coordinates of the vertices of all parts, one part after the other. An
// index is a row of the values, or -1.
std::vector<u8> encode_attributes(std::span<const AttributedPart> parts, std::span<const GridPoint> grid,
                                  const AttributeSettings &settings);

// Return the attributes of each part. CorruptError if the section is damaged, LimitError if all attributes together
// need more memory than is left. The memory of the result is counted in `taken`.
std::vector<std::vector<Attribute>> decode_attributes(std::span<const u8> data, std::span<const ConnectivityView> parts,
                                                      std::span<const GridPoint> grid, TakenMemory &taken);

}  // namespace pdeanim
