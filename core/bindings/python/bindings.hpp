// What the bindings share: numpy's arrays and Python's bytes as views, and vectors as arrays that own them.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "base/arithmetic.hpp"
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

// Connectivity of objects, each (vertices, face sizes, face indices, line sizes, line indices), whose arrays the caller
// keeps; ValueError where they do not fit together.
std::vector<ConnectivityView> views_of(const nb::list &parts);

// Attributes of each object: (name, domain, values, indices or None, labels), in arrays that cannot be written to.
nb::list to_list(const std::shared_ptr<const std::vector<std::vector<Attribute>>> &decoded);

// One function a part of the core; each adds its classes and functions to the module.
void bind_connectivity(nb::module_ &module);
void bind_reference(nb::module_ &module);
void bind_coefficients(nb::module_ &module);
void bind_time_functions(nb::module_ &module);
void bind_residuals(nb::module_ &module);
void bind_curves(nb::module_ &module);
void bind_evaluate(nb::module_ &module);
void bind_description(nb::module_ &module);
void bind_attributes(nb::module_ &module);
void bind_xpbd(nb::module_ &module);
void bind_text(nb::module_ &module);
void bind_baselines(nb::module_ &module);
void bind_animation(nb::module_ &module);
void bind_container(nb::module_ &module);
void bind_basis(nb::module_ &module);
void bind_encode(nb::module_ &module);
void bind_linear_algebra(nb::module_ &module);

}  // namespace pdeanim::bindings
