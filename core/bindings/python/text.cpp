// OBJ text for Python: reading it, and writing rows of numbers; and normals of meshes for writers.
#include "base/parallel.hpp"
#include "bindings/python/bindings.hpp"
#include "text/normals.hpp"
#include "text/obj.hpp"

namespace pdeanim::bindings {

namespace {

using namespace pdeanim::text;

std::span<const u8> lines_of(const nb::bytes &text) {
    const std::span<const u8> lines = view(text);
    if (!lines.empty() && lines.back() != '\n') throw nb::value_error("text must end with a line feed");
    return lines;
}

// View numbers as rows of an array; the array takes ownership of the vector.
template <int columns, class T> auto rows_of(std::vector<T> &numbers) {
    return nb::ndarray<nb::numpy, T, nb::shape<-1, columns>>(numbers.data(), {numbers.size() / columns, columns});
}

template <class T> auto flat(std::vector<T> &numbers) {
    return nb::ndarray<nb::numpy, T, nb::ndim<1>>(numbers.data(), {numbers.size()});
}

nb::object unread_rows(const std::vector<UnreadNumber> &unread) {
    std::vector<i64> rows;
    for (const UnreadNumber &number : unread) rows.insert(rows.end(), {number.array, number.place, number.byte});
    return to_rows(std::move(rows), 3);
}

void new_scan(ObjScan *place, const nb::bytes &text) {
    const std::span<const u8> lines = lines_of(text);
    nb::gil_scoped_release release;
    new (place) ObjScan(lines);
}

void new_structure(ObjStructure *place, const nb::bytes &text) {
    const std::span<const u8> lines = lines_of(text);
    nb::gil_scoped_release release;
    new (place) ObjStructure(lines);
}

using Positions = nb::ndarray<float, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;

nb::object py_read_positions(const ObjStructure &structure, const nb::bytes &text, const Positions &positions) {
    const std::span<const u8> lines = lines_of(text);
    std::vector<UnreadNumber> unread;
    std::optional<u32> changed;
    {
        nb::gil_scoped_release release;
        changed = structure.read_positions(lines, {positions.data(), positions.size()}, unread);
    }
    return changed ? nb::object(nb::make_tuple(unread_rows(unread), *changed)) : nb::none();
}

nb::object py_write_rows(const nb::ndarray<const float, nb::ndim<2>, nb::c_contig, nb::device::cpu> &rows,
                         const char *word) {
    std::optional<std::vector<u8>> lines;
    {
        nb::gil_scoped_release release;
        lines = write_rows({rows.data(), rows.size()}, rows.shape(1), word);
    }
    return lines ? nb::object(to_bytes(*lines)) : nb::none();
}

void py_corner_normals(const nb::ndarray<const float, nb::shape<-1, -1, 3>, nb::c_contig, nb::device::cpu> &points,
                       const Flat<i32> &face_sizes, const Flat<i32> &vertices, const Flat<i32> &rows,
                       const nb::ndarray<float, nb::shape<-1, -1, 3>, nb::c_contig, nb::device::cpu> &normals,
                       int threads) {
    const i64 frames = static_cast<i64>(points.shape(0)), points_a_frame = static_cast<i64>(points.shape(1));
    const i64 sums = static_cast<i64>(normals.shape(1));
    i64 corners = 0;
    bool fits = static_cast<i64>(normals.shape(0)) == frames && rows.size() == vertices.size();
    for (const i32 size : view(face_sizes)) {
        fits = fits && size >= 3;
        corners += size;
    }
    for (const i32 vertex : view(vertices)) fits = fits && vertex >= 0 && vertex < points_a_frame;
    for (const i32 row : view(rows)) fits = fits && row >= 0 && row < sums;
    require(fits && corners == static_cast<i64>(vertices.size()),
            "faces, corners, positions and normals do not fit together");
    nb::gil_scoped_release release;
    const CornerNormals found(view(face_sizes), view(vertices), view(rows), sums);
    in_shares(frames, threads, [&](i64 first, i64 end) {
        for (i64 frame = first; frame < end; ++frame) {
            found.find(points.data() + 3 * points_a_frame * frame, normals.data() + 3 * sums * frame);
        }
    });
}

}  // namespace

void bind_text(nb::module_ &module) {
    nb::enum_<ObjFault>(module, "ObjFault")
        .value("NONE", ObjFault::none)
        .value("BAD_INDEX", ObjFault::bad_index)
        .value("ZERO_INDEX", ObjFault::zero_index)
        .value("INDEX_OUTSIDE", ObjFault::index_outside)
        .value("TEXTURE_OUTSIDE", ObjFault::texture_outside)
        .value("TOO_FEW_CORNERS", ObjFault::too_few_corners)
        .value("BAD_COORDINATES", ObjFault::bad_coordinates);

    constexpr auto inside = nb::rv_policy::reference_internal;
    nb::class_<ObjScan>(module, "ObjScan", "What stands in one OBJ file, in the file's order.")
        .def("__init__", &new_scan, nb::arg("text"))
        .def_ro("fault", &ObjScan::fault)
        .def_ro("fault_byte", &ObjScan::fault_byte)
        .def_ro("vertex_count", &ObjScan::vertex_count)
        .def_ro("texture_count", &ObjScan::texture_count)
        .def_ro("texture_size", &ObjScan::texture_size)
        .def_prop_ro(
            "positions", [](ObjScan &scan) { return rows_of<3>(scan.positions); }, inside)
        .def_prop_ro(
            "vertex_extras", [](ObjScan &scan) { return rows_of<4>(scan.vertex_extras); }, inside)
        .def_prop_ro(
            "textures", [](ObjScan &scan) { return rows_of<3>(scan.textures); }, inside)
        .def_prop_ro(
            "normals", [](ObjScan &scan) { return rows_of<3>(scan.normals); }, inside)
        .def_prop_ro(
            "vertex_sizes", [](ObjScan &scan) { return flat(scan.vertex_sizes); }, inside)
        .def_prop_ro(
            "is_face", [](ObjScan &scan) { return flat(scan.is_face); }, inside)
        .def_prop_ro(
            "element_sizes", [](ObjScan &scan) { return flat(scan.element_sizes); }, inside)
        .def_prop_ro(
            "corners", [](ObjScan &scan) { return rows_of<3>(scan.corners); }, inside)
        .def_prop_ro(
            "others", [](ObjScan &scan) { return rows_of<3>(scan.others); }, inside)
        .def_prop_ro("unread", [](ObjScan &scan) { return unread_rows(scan.unread); });

    nb::class_<ObjStructure>(module, "ObjStructure", "What must be the same in every frame of OBJ files.")
        .def("__init__", &new_structure, nb::arg("text"))
        .def("read_positions", &py_read_positions, nb::arg("text"), nb::arg("positions").noconvert(),
             "Fill positions, (vertices, 3) float32, of another frame; numbers that are left to read, and which data "
             "differ as bits: ends of v lines, vt lines, mtllib. None where the structure differs.");
    module.def(
        "corner_normals", &py_corner_normals, nb::arg("points"), nb::arg("face_sizes"), nb::arg("vertices"),
        nb::arg("rows"), nb::arg("normals").noconvert(), nb::arg("threads"),
        "Fill unit normals (frames, sums, 3) float32 at positions (frames, vertices, 3): those of faces, weighted by "
        "the angles of corners, each of which has a vertex and a sum.");
    module.def("write_rows", &py_write_rows, nb::arg("rows"), nb::arg("word"),
               "Lines of a word and a row's numbers, (rows, columns) float32; None where nine digits are too few.");
}

}  // namespace pdeanim::bindings
