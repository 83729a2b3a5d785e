// The module pdecodec._core: what Python sees of the core, on numpy arrays and bytes.
//
// Begin here, then read module.cpp, which calls one function a file:
//
//     animation.cpp       an open file: class Animation; source.cpp: where its bytes come from
//     mesh.cpp            sections of meshes: SEQN, CONN, ORDR, REST, ATTR, and the curves of a mesh
//     motion.cpp          sections of motion: TIME, COEF, CORR
//     space.cpp           patches, space bases, and the positions that coefficients give
//     encode.cpp          loops of the encoder: displacements, quantisation, misses
//     linear_algebra.cpp  products and decompositions
//     simulate.cpp, text.cpp, baselines.cpp   XPBD sweeps, OBJ text, coders of the published baselines
//
// The interpreter lock is released around everything that loops. Several results are a named tuple. pdecodec/_core.pyi has
// the types; tests/codec/test_core_types.py compares the two. This header has what the files share.
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

// Rows of so many numbers.
template <class T, int columns> using Rows =
    nb::ndarray<const T, nb::shape<-1, columns>, nb::c_contig, nb::device::cpu>;

template <class T> std::span<const T> view(const Flat<T> &array) { return {array.data(), array.size()}; }

inline std::span<const u8> view(const nb::bytes &data) {
    return {reinterpret_cast<const u8 *>(data.data()), data.size()};
}

inline nb::bytes to_bytes(const std::vector<u8> &data) { return nb::bytes(data.data(), data.size()); }

// A one-dimensional array that owns its values.
template <class T> nb::object to_array(std::vector<T> &&values) {
    auto *kept = new std::vector<T>(std::move(values));
    nb::capsule owner(kept, [](void *pointer) noexcept { delete static_cast<std::vector<T> *>(pointer); });
    return nb::cast(nb::ndarray<nb::numpy, T, nb::ndim<1>>(kept->data(), {kept->size()}, owner));
}

// What keeps something alive that an array lies in.
template <class T> nb::capsule owner_of(std::shared_ptr<T> shared) {
    auto *kept = new std::shared_ptr<T>(std::move(shared));
    return nb::capsule(kept, [](void *pointer) noexcept { delete static_cast<std::shared_ptr<T> *>(pointer); });
}

// A one-dimensional array that cannot be written to and lies in what its owner keeps alive.
template <class T> nb::object shared_array(const std::vector<T> &values, const nb::capsule &owner) {
    return nb::cast(nb::ndarray<nb::numpy, const T, nb::ndim<1>>(values.data(), {values.size()}, owner));
}

// Rows of numbers, as an array that owns them.
template <class Values> nb::object to_matrix(Values &&values, std::size_t rows, std::size_t columns) {
    using Kept = std::remove_cvref_t<Values>;
    auto *kept = new Kept(std::move(values));
    nb::capsule owner(kept, [](void *pointer) noexcept { delete static_cast<Kept *>(pointer); });
    using Matrix = nb::ndarray<nb::numpy, typename Kept::value_type, nb::ndim<2>>;
    return nb::cast(Matrix(kept->data(), {rows, columns}, owner));
}

// The same of `columns` numbers each.
template <class T> nb::object to_rows(std::vector<T> &&values, std::size_t columns) {
    const std::size_t rows = columns ? values.size() / columns : 0;
    return to_matrix(std::move(values), rows, columns);
}

// Add a named tuple to the module, as collections.namedtuple takes it.
inline void add_tuple(nb::module_ &module, const char *name, const char *fields) {
    const nb::object make = nb::module_::import_("collections").attr("namedtuple");
    module.attr(name) = make(name, fields, nb::arg("module") = "pdecodec._core");
}

// One of those tuples, of these values.
template <class... Values> nb::object named(const char *name, Values &&...values) {
    return nb::module_::import_("pdecodec._core").attr(name)(std::forward<Values>(values)...);
}

// ValueError unless something holds.
inline void require(bool holds, const char *message) {
    if (!holds) throw nb::value_error(message);
}

// Connectivity of objects, each (vertices, face sizes, face indices, line sizes, line indices), whose arrays the caller
// keeps; ValueError where they do not fit together.
std::vector<ConnectivityView> views_of(const nb::list &parts);

// Grid coordinates of all vertices, as the core has them; ValueError unless there is one for each of the objects' vertices.
std::span<const GridPoint> grid_of(const Rows<i64, 3> &grid, const std::vector<ConnectivityView> &objects);

// The bytes of a file: Python's bytes, a file's descriptor, or a file that Python reads, with the interpreter lock. The
// caller keeps it.
std::unique_ptr<Source> source_of(const nb::object &file);

// What moves the vertices in a group of frames, in the precision of its sums.
struct PyMotion {
    std::variant<Motion<float>, Motion<double>> motion;
};

// One function a file; each adds its classes and functions to the module.
void bind_animation(nb::module_ &module);
void bind_mesh(nb::module_ &module);
void bind_motion(nb::module_ &module);
void bind_space(nb::module_ &module);
void bind_encode(nb::module_ &module);
void bind_linear_algebra(nb::module_ &module);
void bind_simulate(nb::module_ &module);
void bind_text(nb::module_ &module);
void bind_baselines(nb::module_ &module);

}  // namespace pdeanim::bindings
