// Products and decompositions of matrices for Python.
#include <memory>

#include "base/arrays.hpp"
#include "bindings/python/bindings.hpp"
#include "encode/matrices.hpp"
#include "linalg/products.hpp"

namespace pdeanim::bindings {

namespace {

template <class T> using Matrix = nb::ndarray<const T, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using AnyMatrix = nb::ndarray<const double, nb::ndim<2>, nb::device::cpu>;

template <class T> i64 rows_of(const T &matrix) { return static_cast<i64>(matrix.shape(0)); }
template <class T> i64 columns_of(const T &matrix) { return static_cast<i64>(matrix.shape(1)); }

nb::object py_product(const AnyMatrix &left, const Matrix<double> &right, int threads) {
    require(left.shape(1) == right.shape(0), "the left matrix must have as many columns as the right one has rows");
    const ProductSizes sizes{rows_of(left), columns_of(left), columns_of(right)};
    LargeArray<double> found;
    {
        nb::gil_scoped_release release;
        found = LargeArray<double>(sizes.rows * sizes.columns);
        multiply(found.data(), {left.data(), left.stride(0), left.stride(1)}, right.data(), sizes, threads);
    }
    return to_matrix(std::move(found), left.shape(0), right.shape(1));
}

template <class Real>
nb::object py_multiply_rows(const Matrix<Real> &rows, const Matrix<double> &factors, i64 axes, int threads) {
    require(axes > 0 && columns_of(rows) == axes * rows_of(factors), "rows must have one number per factor and axis");
    const ProductSizes sizes{rows_of(rows), rows_of(factors), columns_of(factors)};
    LargeArray<Real> found;
    {
        nb::gil_scoped_release release;
        found = LargeArray<Real>(sizes.rows * sizes.columns * axes);
        multiply_rows(found.data(), rows.data(), factors.data(), sizes, axes, threads);
    }
    return to_matrix(std::move(found), rows.shape(0), factors.shape(1) * axes);
}

template <class Row> nb::object py_sums_of_squares(const Matrix<Row> &rows, bool single, int threads) {
    LargeArray<double> found;
    {
        nb::gil_scoped_release release;
        found = LargeArray<double>(rows.shape(1) * rows.shape(1));
        const auto added = single ? sums_of_squares<float, Row> : sums_of_squares<double, Row>;
        added(found.data(), rows.data(), rows_of(rows), columns_of(rows), threads);
    }
    return to_matrix(std::move(found), rows.shape(1), rows.shape(1));
}

template <class Real>
nb::object py_sums_of_products(const Matrix<Real> &rows, const Matrix<Real> &others, int threads) {
    require(rows.shape(0) == others.shape(0), "the two matrices must have equally many rows");
    LargeArray<double> found;
    {
        nb::gil_scoped_release release;
        found = LargeArray<double>(rows.shape(1) * others.shape(1));
        sums_of_products(found.data(), rows.data(), others.data(), rows_of(rows), columns_of(rows), columns_of(others),
                         threads);
    }
    return to_matrix(std::move(found), rows.shape(1), others.shape(1));
}

double py_sum_of_products(const Flat<double> &a, const Flat<double> &b) {
    require(a.size() == b.size(), "the two rows must be equally long");
    nb::gil_scoped_release release;
    return sum_of_products(a.data(), b.data(), static_cast<i64>(a.size()));
}

nb::object py_eigen(const Matrix<double> &matrix, bool with_vectors, int threads) {
    require(matrix.shape(0) == matrix.shape(1), "a symmetric matrix must have as many rows as columns");
    Eigen found;
    {
        nb::gil_scoped_release release;
        found = symmetric_eigen(matrix.data(), rows_of(matrix), with_vectors, threads);
    }
    const std::size_t size = matrix.shape(0);
    return named("Eigen", to_array(std::move(found.values)),
                 to_matrix(std::move(found.vectors), with_vectors ? size : 0, size));
}

nb::object py_orthonormal_columns(const Matrix<double> &matrix) {
    require(matrix.shape(0) >= matrix.shape(1), "there must be at least as many rows as columns");
    OrthonormalColumns found;
    {
        nb::gil_scoped_release release;
        found = orthonormal_columns(matrix.data(), rows_of(matrix), columns_of(matrix));
    }
    return named("OrthonormalColumns", to_matrix(std::move(found.vectors), matrix.shape(1), matrix.shape(0)),
                 to_matrix(std::move(found.triangle), matrix.shape(1), matrix.shape(1)));
}

nb::object py_binary_logarithms(const Matrix<double> &values) {
    LargeArray<double> found;
    {
        nb::gil_scoped_release release;
        found = LargeArray<double>(values.size());
        binary_logarithms(found.data(), values.data(), static_cast<i64>(values.size()));
    }
    return to_matrix(std::move(found), values.shape(0), values.shape(1));
}

template <class Real> void bind_rows(nb::module_ &module) {
    module.def("multiply_rows", &py_multiply_rows<Real>, nb::arg("rows").noconvert(), nb::arg("factors"),
               nb::arg("axes"), nb::arg("threads"));
    module.def("sums_of_squares", &py_sums_of_squares<Real>, nb::arg("rows").noconvert(), nb::arg("single"),
               nb::arg("threads"));
    module.def("sums_of_products", &py_sums_of_products<Real>, nb::arg("rows").noconvert(), nb::arg("others"),
               nb::arg("threads"));
}

}  // namespace

void bind_linear_algebra(nb::module_ &module) {
    add_tuple(module, "Eigen", "values vectors");
    add_tuple(module, "OrthonormalColumns", "vectors triangle");
    bind_rows<float>(module);
    bind_rows<double>(module);
    module.def("product", &py_product, nb::arg("left"), nb::arg("right"), nb::arg("threads"));
    module.def("sum_of_products", &py_sum_of_products, nb::arg("a"), nb::arg("b"));
    module.def("symmetric_eigen", &py_eigen, nb::arg("matrix"), nb::arg("with_vectors"), nb::arg("threads"));
    module.def("orthonormal_columns", &py_orthonormal_columns, nb::arg("matrix"));
    module.def("binary_logarithms", &py_binary_logarithms, nb::arg("values"));
}

}  // namespace pdeanim::bindings
