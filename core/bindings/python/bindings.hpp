// The module pdecodec._core: the core as Python sees it, with numpy arrays and bytes.
//
// Begin here, then read module.cpp, which calls one function per file:
//
//     animation.cpp       an open file: class Animation; source.cpp: where its bytes come from
//     mesh.cpp            sections of meshes: SEQN, CONN, ORDR, REST, ATTR, and the curves of a mesh
//     motion.cpp          sections of motion: TIME, COEF, CORR
//     space.cpp           patches, space bases, and positions from coefficients
//     fields.cpp          chunks of fields: FDAT
//     encode.cpp          loops of the encoder: displacements, quantisation, missed vertices
//     linear_algebra.cpp  products and decompositions
//     simulate.cpp, text.cpp, baselines.cpp   XPBD sweeps, OBJ text, coders of the published baselines
//
// All loops run with the interpreter lock released. Functions with several results return a named tuple. The types are
// in pdecodec/_core.pyi; tests/codec/test_core_types.py compares them with the module. The rest of this header are
// helpers that several of these files use.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <memory>
#include <span>
#include <utility>
#include <variant>
#include <vector>

#include "base/arithmetic.hpp"
#include "decode/container.hpp"
#include "decode/evaluate/motion.hpp"
#include "sections/attributes/attributes.hpp"
#include "sections/connectivity/connectivity.hpp"

namespace pdeanim::bindings {

namespace nb = nanobind;

template <class T> using Flat = nb::ndarray<const T, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

// Arrays with a fixed number of columns.
template <class T, int columns> using Rows =
    nb::ndarray<const T, nb::shape<-1, columns>, nb::c_contig, nb::device::cpu>;

template <class T> std::span<const T> view(const Flat<T> &array) { return {array.data(), array.size()}; }

inline std::span<const u8> view(const nb::bytes &data) {
    return {reinterpret_cast<const u8 *>(data.data()), data.size()};
}

inline nb::bytes to_bytes(const std::vector<u8> &data) { return nb::bytes(data.data(), data.size()); }

// Turn values into a one-dimensional array that owns them.
template <class T> nb::object to_array(std::vector<T> &&values) {
    auto *kept = new std::vector<T>(std::move(values));
    nb::capsule owner(kept, [](void *pointer) noexcept { delete static_cast<std::vector<T> *>(pointer); });
    return nb::cast(nb::ndarray<nb::numpy, T, nb::ndim<1>>(kept->data(), {kept->size()}, owner));
}

// Make an owner that keeps an object alive as long as numpy arrays view its memory.
template <class T> nb::capsule owner_of(std::shared_ptr<T> shared) {
    auto *kept = new std::shared_ptr<T>(std::move(shared));
    return nb::capsule(kept, [](void *pointer) noexcept { delete static_cast<std::shared_ptr<T> *>(pointer); });
}

// Return a one-dimensional read-only view of values that `owner` keeps alive.
template <class T> nb::object shared_array(const std::vector<T> &values, const nb::capsule &owner) {
    return nb::cast(nb::ndarray<nb::numpy, const T, nb::ndim<1>>(values.data(), {values.size()}, owner));
}

// Turn values into a matrix that owns them.
template <class Values> nb::object to_matrix(Values &&values, std::size_t rows, std::size_t columns) {
    using Kept = std::remove_cvref_t<Values>;
    auto *kept = new Kept(std::move(values));
    nb::capsule owner(kept, [](void *pointer) noexcept { delete static_cast<Kept *>(pointer); });
    using Matrix = nb::ndarray<nb::numpy, typename Kept::value_type, nb::ndim<2>>;
    return nb::cast(Matrix(kept->data(), {rows, columns}, owner));
}

// Turn values into a matrix of `columns` columns that owns them.
template <class T> nb::object to_rows(std::vector<T> &&values, std::size_t columns) {
    const std::size_t rows = columns ? values.size() / columns : 0;
    return to_matrix(std::move(values), rows, columns);
}

// Add a named tuple type to the module; arguments as for collections.namedtuple.
inline void add_tuple(nb::module_ &module, const char *name, const char *fields) {
    const nb::object make = nb::module_::import_("collections").attr("namedtuple");
    module.attr(name) = make(name, fields, nb::arg("module") = "pdecodec._core");
}

// Return a named tuple of a type that `add_tuple` has added.
template <class... Values> nb::object named(const char *name, Values &&...values) {
    return nb::module_::import_("pdecodec._core").attr(name)(std::forward<Values>(values)...);
}

// Raise ValueError unless a condition holds.
inline void require(bool holds, const char *message) {
    if (!holds) throw nb::value_error(message);
}

// Return the connectivity of objects as views of arrays that the caller keeps; ValueError if an object is inconsistent.
// Each part is a tuple (vertices, face sizes, face indices, line sizes, line indices).
std::vector<ConnectivityView> views_of(const nb::list &parts);

// Return the grid coordinates of all vertices in the core's layout; ValueError unless there is one row per vertex.
std::span<const GridPoint> grid_of(const Rows<i64, 3> &grid, const std::vector<ConnectivityView> &objects);

// Return a reader of a file: of Python's bytes, of a file descriptor, or of a Python file object, which is read with
// the interpreter lock. The caller keeps `file` alive.
std::unique_ptr<Source> source_of(const nb::object &file);

// The motion of the vertices in a group of frames, in single or double precision as the group requires.
struct PyMotion {
    std::variant<Motion<float>, Motion<double>> motion;
};

// Each function adds the classes and functions of the file of the same name to the module.
void bind_animation(nb::module_ &module);
void bind_mesh(nb::module_ &module);
void bind_motion(nb::module_ &module);
void bind_space(nb::module_ &module);
void bind_encode(nb::module_ &module);
void bind_linear_algebra(nb::module_ &module);
void bind_simulate(nb::module_ &module);
void bind_text(nb::module_ &module);
void bind_baselines(nb::module_ &module);
void bind_fields(nb::module_ &module);

}  // namespace pdeanim::bindings
