// Python's view of section CORR: residuals as an object, and arrays that look into it.
#include "sections/residuals/residuals.hpp"

#include <nanobind/stl/optional.h>

#include <algorithm>

#include "base/errors.hpp"
#include "bindings/python/bindings.hpp"
#include "encode/quantise.hpp"

namespace pdeanim::bindings {

namespace {

template <class T> using Frames = nb::ndarray<T, nb::shape<-1, -1, 3>, nb::c_contig, nb::device::cpu>;

template <class T, class Array> std::span<const std::array<T, 3>> rows_of(const Array &array) {
    return {reinterpret_cast<const std::array<T, 3> *>(array.data()), array.size() / 3};
}

// Values of an object, as an array that keeps the object and cannot be written.
template <class T> nb::object look_into(const std::vector<T> &values, nb::handle owner) {
    return nb::cast(nb::ndarray<nb::numpy, const T, nb::ndim<1>>(values.data(), {values.size()}, owner));
}

template <class T> nb::object look_into(const std::vector<std::array<T, 3>> &values, nb::handle owner) {
    const T *first = reinterpret_cast<const T *>(values.data());
    return nb::cast(nb::ndarray<nb::numpy, const T, nb::ndim<2>>(first, {values.size(), 3}, owner));
}

template <class T> std::vector<T> copy_of(std::span<const T> values) { return {values.begin(), values.end()}; }

constexpr i64 most_vertices = i64{1} << 31;

void make(Residuals *residuals, const Flat<i64> &frame_starts, const Flat<i32> &places, const Rows<i64, 3> &quantised,
          const Flat<i64> &raw_frame_starts, const Flat<i32> &raw_places, const Rows<float, 3> &raw_positions) {
    Residuals found{copy_of(view(frame_starts)),     copy_of(view(places)),     copy_of(rows_of<i64>(quantised)),
                    copy_of(view(raw_frame_starts)), copy_of(view(raw_places)), copy_of(rows_of<float>(raw_positions))};
    check_residuals(found, most_vertices);
    new (residuals) Residuals(std::move(found));
}

std::span<const i64> patches_of(const Flat<i64> &starts) {
    const std::span<const i64> patches = view(starts);
    if (patches.empty() || patches.front() != 0 || !std::is_sorted(patches.begin(), patches.end()) ||
        patches.back() > most_vertices) {
        throw ArgumentError("patches must begin at 0, and ascend to the number of vertices");
    }
    return patches;
}

ResidualCoding coding_of(const Residuals &residuals, bool is_predicted, const Flat<i64> &distances) {
    const std::span<const i64> found = view(distances);
    bool is_sound = static_cast<i64>(found.size()) == residuals.frames();
    for (std::size_t frame = 0; is_sound && frame < found.size(); ++frame) {
        is_sound = found[frame] >= 1 && found[frame] <= most<i64>(static_cast<i64>(frame), 1);
    }
    if (!is_sound) throw ArgumentError("each frame's reference must be a frame before it");
    return {is_predicted, found};
}

double py_measure(const Residuals &residuals, const Flat<i64> &starts, bool is_predicted, const Flat<i64> &distances,
                  double copies) {
    nb::gil_scoped_release release;
    const std::span<const i64> patches = patches_of(starts);
    check_residuals(residuals, patches.back());
    return measure_residuals(residuals, patches, coding_of(residuals, is_predicted, distances), copies);
}

nb::bytes py_encode(const Residuals &residuals, const Flat<i64> &starts, bool is_predicted,
                    const Flat<i64> &distances) {
    std::vector<u8> data;
    {
        nb::gil_scoped_release release;
        const std::span<const i64> patches = patches_of(starts);
        check_residuals(residuals, patches.back());
        data = encode_residuals(residuals, patches, coding_of(residuals, is_predicted, distances));
    }
    return to_bytes(data);
}

nb::object py_reference_distances(const Residuals &residuals) {
    std::vector<i64> distances;
    {
        nb::gil_scoped_release release;
        distances = reference_distances(residuals);
    }
    return to_array(std::move(distances));
}

Residuals py_decode(const nb::bytes &data, i64 frames, const Flat<i64> &starts, i64 most_bytes) {
    if (frames < 0 || frames >= i64{1} << 31) throw ArgumentError("frames must be a number of frames");
    nb::gil_scoped_release release;
    MemoryLimit limit(static_cast<u64>(most_bytes));
    TakenMemory taken(limit);
    return decode_residuals(view(data), frames, patches_of(starts), taken);
}

Residuals py_quantise(const Frames<const float> &points, const Frames<const double> &base, const Flat<i32> &order,
                      const Flat<double> &margins, double bound, double step) {
    const std::size_t frames = points.shape(0), vertices = points.shape(1);
    if (base.shape(0) != frames || base.shape(1) != vertices || margins.size() != frames || order.size() != vertices) {
        throw ArgumentError("positions, margins and order must be of the same frames and vertices");
    }
    nb::gil_scoped_release release;
    for (const i32 vertex : view(order)) {
        if (vertex < 0 || static_cast<std::size_t>(vertex) >= vertices) {
            throw ArgumentError("an order must be of the vertices that there are");
        }
    }
    return quantise_residuals(rows_of<float>(points), rows_of<double>(base), view(order), view(margins), bound, step);
}

void check_frames(const Residuals &residuals, i64 first, std::size_t count, std::span<const i32> order,
                  std::size_t vertices) {
    if (first < 0 || first > residuals.frames() || residuals.frames() - first < static_cast<i64>(count)) {
        throw ArgumentError("residuals are of other frames");
    }
    const auto check = [&](const std::vector<i64> &starts, const std::vector<i32> &places) {
        for (i64 k = starts[first]; k < starts[first + count]; ++k) {
            const std::size_t place = places[k];
            if (place >= order.size() || order[place] < 0 || static_cast<std::size_t>(order[place]) >= vertices) {
                throw ArgumentError("residuals are of other vertices");
            }
        }
    };
    check(residuals.frame_starts, residuals.places);
    check(residuals.raw_frame_starts, residuals.raw_places);
}

using Base = std::optional<Rows<float, 3>>;

std::span<const Position> base_of(const Base &base, std::size_t vertices) {
    if (!base) return {};
    if (base->shape(0) != vertices) throw ArgumentError("base must be of as many vertices");
    return rows_of<float>(*base);
}

void py_add(const Residuals &residuals, i64 first, const Flat<i32> &order, double step, const Frames<float> &out,
            double weight, const Base &base) {
    const std::size_t frames = out.shape(0), vertices = out.shape(1);
    const std::span<const Position> of_model = base_of(base, vertices);
    if (base && frames != 1) throw ArgumentError("a base must be of one frame");
    nb::gil_scoped_release release;
    check_frames(residuals, first, frames, view(order), vertices);
    Position *positions = reinterpret_cast<Position *>(out.data());
    for (std::size_t frame = 0; frame < frames; ++frame) {
        add_residuals(residuals, first + static_cast<i64>(frame), {view(order), step}, weight, of_model,
                      {positions + frame * vertices, vertices});
    }
}

nb::object py_displacements(const Residuals &residuals, i64 frame, const Flat<i32> &order, double step,
                            const Base &base) {
    const std::size_t vertices = order.size();
    const std::span<const Position> of_model = base_of(base, vertices);
    std::vector<double> found(3 * vertices);
    {
        nb::gil_scoped_release release;
        check_frames(residuals, frame, 1, view(order), vertices);
        if (!base && residuals.raw_frame_starts[frame] < residuals.raw_frame_starts[frame + 1]) {
            throw ArgumentError("a base is needed where there are raw vertices");
        }
        residual_displacements(residuals, frame, {view(order), step}, of_model,
                               {reinterpret_cast<std::array<double, 3> *>(found.data()), vertices});
    }
    return to_rows(std::move(found), 3);
}

// A read-only property that looks into one of the vectors.
template <auto values> nb::object look(nb::handle self) {
    return look_into(nb::cast<const Residuals &>(self).*values, self);
}

}  // namespace

void bind_residuals(nb::module_ &module) {
    nb::class_<Residuals>(module, "Residuals", "Residuals and raw vertices of consecutive frames.")
        .def("__init__", &make, nb::arg("frame_starts"), nb::arg("places"), nb::arg("quantised"),
             nb::arg("raw_frame_starts"), nb::arg("raw_places"), nb::arg("raw_positions"))
        .def_prop_ro("frame_starts", &look<&Residuals::frame_starts>)
        .def_prop_ro("places", &look<&Residuals::places>)
        .def_prop_ro("quantised", &look<&Residuals::quantised>)
        .def_prop_ro("raw_frame_starts", &look<&Residuals::raw_frame_starts>)
        .def_prop_ro("raw_places", &look<&Residuals::raw_places>)
        .def_prop_ro("raw_positions", &look<&Residuals::raw_positions>)
        .def_prop_ro("frames", &Residuals::frames)
        .def_prop_ro("count", &Residuals::count)
        .def_prop_ro("nbytes", &Residuals::bytes);
    module.attr("BYTES_PER_RESIDUAL") = bytes_per_residual;
    module.attr("BYTES_PER_RAW_VERTEX") = bytes_per_raw_vertex;
    module.def("quantise_residuals", &py_quantise, nb::arg("points"), nb::arg("base"), nb::arg("order"),
               nb::arg("margins"), nb::arg("bound"), nb::arg("step"),
               "Residuals of the vertices that may miss the bound.");
    module.def("reference_distances", &py_reference_distances, nb::arg("residuals"), "(frames,) int64.");
    module.def("measure_residuals", &py_measure, nb::arg("residuals"), nb::arg("patches"), nb::arg("is_predicted"),
               nb::arg("distances"), nb::arg("copies") = 1.0,
               "What encode_residuals takes for so many times as many residuals that are like these [bits].");
    module.def("encode_residuals", &py_encode, nb::arg("residuals"), nb::arg("patches"), nb::arg("is_predicted"),
               nb::arg("distances"), "The chunk of CORR of a group of frames.");
    module.def("decode_residuals", &py_decode, nb::arg("data"), nb::arg("frames"), nb::arg("patches"),
               nb::arg("most_bytes"), "Undo encode_residuals.");
    module.def("add_residuals", &py_add, nb::arg("residuals"), nb::arg("first"), nb::arg("order"), nb::arg("step"),
               nb::arg("out").noconvert(), nb::arg("weight"), nb::arg("base").none(),
               "Add the residuals of consecutive frames to positions, (frames, vertices, 3) float32, in place.");
    module.def("residual_displacements", &py_displacements, nb::arg("residuals"), nb::arg("frame"), nb::arg("order"),
               nb::arg("step"), nb::arg("base").none(), "What a frame's residuals add, (vertices, 3) float64.");
}

}  // namespace pdeanim::bindings
