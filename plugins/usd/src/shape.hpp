// What an object of a .pdeanim file is in USD: its type, and the attributes that are constant within a run of frames.
#pragma once

#include <pdeanim.h>

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "normals.hpp"
#include "usd_headers.hpp"
#include "values.hpp"

namespace pdeanim_usd {

// An attribute with its value in a run of frames.
struct Property {
    std::string name;
    TfToken type;
    VtValue value;
    std::string interpolation = {};  // of primvars
    bool is_own = false;             // whether only pdecodec reads it
};

// A set of faces of a material or a group.
struct FaceSet {
    std::string role, label;
    VtIntArray members;
};

// What objects of several runs have in common if they are the same prim.
struct ShapeKey {
    std::string name;
    int number = 0;                              // among objects of one run that agree in everything else
    std::string schema;                          // "Mesh", "BasisCurves" or "Points"
    std::string subdivision, curve_basis, wrap;  // labels, may be empty
    auto operator<=>(const ShapeKey &) const = default;
};

struct Shape {
    ShapeKey key;
    std::int64_t vertex_count = 0;
    std::vector<int> gather;  // the vertex of each point of curves; empty: all in order
    std::vector<Property> properties;
    std::vector<FaceSet> face_sets;
    std::span<const std::int32_t> face_sizes, face_indices;  // of the open animation
    std::shared_ptr<const NormalRows> normals;               // may be NULL
    bool shows_normals = false;                              // outside of scenes
    std::vector<double> transform;                           // rows of a time [s] and a matrix
};

// A field of a run, and the rows that each object has.
struct Field {
    std::string name, unit, interpolation;
    int index;
    NumberType type;
    std::int64_t columns, rows;
    std::vector<std::int64_t> first_rows;  // of each object, and the number of rows at the end
    std::vector<bool> is_of_object;
};

// Return the shapes of all objects; `changes` says whether the file has several runs.
std::vector<Shape> shapes_of(pdeanim_animation *animation, bool changes);
std::vector<Field> fields_of(pdeanim_animation *animation);

// Return the type of a field's attribute.
const ArrayType &field_type(const Field &field);

// Return rows of a field as an array of its attribute's type.
VtValue field_value(const Field &field, const std::vector<char> &rows);

}  // namespace pdeanim_usd
