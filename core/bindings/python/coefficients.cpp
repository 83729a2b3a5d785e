// Python's view of section COEF.
#include "sections/coefficients/coefficients.hpp"

#include <nanobind/stl/optional.h>

#include "bindings/python/bindings.hpp"

namespace pdeanim::bindings {

namespace {

template <class T> using Grid = nb::ndarray<T, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

template <class T> CoefficientLayout layout_of(const Grid<T> &coefficients, const Flat<i64> &starts,
                                               const Flat<i64> &kinds, const Flat<i64> &parents, int axes) {
    return {.subbands = {view(starts), view(kinds), view(parents)},
            .rows = static_cast<i64>(coefficients.shape(0)),
            .channels = static_cast<i64>(coefficients.shape(1)),
            .axes = axes};
}

nb::bytes py_encode_coefficients(const Grid<const i64> &coefficients, const Flat<i64> &starts, const Flat<i64> &kinds,
                                 const Flat<i64> &parents, int axes) {
    std::vector<u8> data;
    {
        nb::gil_scoped_release release;
        data = encode_coefficients(layout_of(coefficients, starts, kinds, parents, axes),
                                   {coefficients.data(), coefficients.size()});
    }
    return to_bytes(data);
}

double py_measure_coefficients(const Grid<const i64> &coefficients, const Flat<i64> &starts, const Flat<i64> &kinds,
                               const Flat<i64> &parents, int axes, const std::optional<Flat<double>> &copies) {
    nb::gil_scoped_release release;
    return measure_coefficients(layout_of(coefficients, starts, kinds, parents, axes),
                                {coefficients.data(), coefficients.size()},
                                copies ? view(*copies) : std::span<const double>());
}

// The decoder with what it looks at, and an array that it fills.
class PyCoefficientDecoder {
public:
    PyCoefficientDecoder(nb::bytes data, Grid<i64> coefficients, Flat<i64> starts, Flat<i64> kinds, Flat<i64> parents,
                         int axes)
        : data_(std::move(data)), coefficients_(std::move(coefficients)), starts_(std::move(starts)),
          kinds_(std::move(kinds)), parents_(std::move(parents)),
          decoder_(layout_of(coefficients_, starts_, kinds_, parents_, axes), view(data_)) {}

    void decode(i64 end) {
        decoder_.decode(end);
        i64 *to = coefficients_.data();
        for (const std::span<const i64> row : decoder_.rows()) {
            std::copy(row.begin(), row.end(), to);
            to += coefficients_.shape(1);
        }
    }

    void finish() const { decoder_.finish(); }

private:
    nb::bytes data_;
    Grid<i64> coefficients_;
    Flat<i64> starts_, kinds_, parents_;
    CoefficientDecoder decoder_;
};

}  // namespace

void bind_coefficients(nb::module_ &module) {
    module.def("encode_coefficients", &py_encode_coefficients, nb::arg("coefficients"), nb::arg("starts"),
               nb::arg("kinds"), nb::arg("parents"), nb::arg("axes"),
               "Quantised coefficients, (functions, channels) int64 of subbands, as bytes; none where all are zero.");
    module.def("measure_coefficients", &py_measure_coefficients, nb::arg("coefficients"), nb::arg("starts"),
               nb::arg("kinds"), nb::arg("parents"), nb::arg("axes"), nb::arg("copies") = nb::none(),
               "Bits that encode_coefficients would take with so many copies of each subband.");
    nb::class_<PyCoefficientDecoder>(module, "CoefficientDecoder",
                                     "Writes quantised coefficients into an array of zeros, some subbands at a time.")
        .def(nb::init<nb::bytes, Grid<i64>, Flat<i64>, Flat<i64>, Flat<i64>, int>(), nb::arg("data"),
             nb::arg("coefficients").noconvert(), nb::arg("starts"), nb::arg("kinds"), nb::arg("parents"),
             nb::arg("axes"))
        .def("decode", &PyCoefficientDecoder::decode, nb::arg("end"), nb::call_guard<nb::gil_scoped_release>(),
             "Decode the subbands up to `end` - 1 that have not been decoded yet.")
        .def("finish", &PyCoefficientDecoder::finish, "CorruptError unless the bytes end where the coefficients do.");
}

}  // namespace pdeanim::bindings
