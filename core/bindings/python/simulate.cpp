// Sweeps of the simulator (XPBD). They change the caller's arrays in place.
#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <array>

#include "bindings/python/bindings.hpp"
#include "simulate/sheets.hpp"

namespace pdeanim::bindings {

namespace {

using namespace pdeanim::xpbd;

template <class... Shape> using Array = nb::ndarray<Shape..., nb::c_contig, nb::device::cpu>;
using Points = Array<const double, nb::shape<-1, 3>>;
using ChangedPoints = Array<double, nb::shape<-1, 3>>;
using ChangedNumbers = Array<double, nb::ndim<1>>;
using StateArrays = std::tuple<ChangedPoints, Points, Flat<double>>;
using ScalingNumbers = std::tuple<double, double, double>;

// View an array of numbers as `count` items of a structure.
template <class Item, class Array> std::span<Item> items(const Array &array, std::size_t count) {
    if (array.size() * sizeof(*array.data()) != count * sizeof(Item)) {
        throw nb::value_error("arrays do not fit each other");
    }
    return {reinterpret_cast<Item *>(array.data()), count};
}

Particles particles_of(const StateArrays &state) {
    const auto &[positions, previous, inverse_masses] = state;
    const std::size_t count = positions.shape(0);
    return {items<Point>(positions, count), items<const Point>(previous, count),
            items<const double>(inverse_masses, count)};
}

Scaling scaling_of(const ScalingNumbers &scaling) {
    return {std::get<0>(scaling), std::get<1>(scaling), std::get<2>(scaling)};
}

// View an array as the particles of constraints or triangles; IndexError if a particle does not exist.
template <std::size_t members, class Array>
std::span<const Members<members>> members_of(const Array &array, std::size_t particles) {
    u32 largest = 0;  // as unsigned, a negative number is larger than any index
    for (std::size_t i = 0; i < array.size(); ++i) largest = most(largest, static_cast<u32>(array.data()[i]));
    if (array.size() > 0 && largest >= particles) throw nb::index_error("a particle number is out of range");
    return items<const Members<members>>(array, array.size() / members);
}

void py_predict(const ChangedPoints &positions, const ChangedPoints &previous, const Flat<double> &inverse_masses,
                const Points &velocities, const Points &accelerations, double substep, double keep) {
    const std::size_t count = positions.shape(0);
    const auto moved = items<Point>(positions, count), noted = items<Point>(previous, count);
    const auto masses = items<const double>(inverse_masses, count);
    const auto speeds = items<const Point>(velocities, count), pulls = items<const Point>(accelerations, count);
    nb::gil_scoped_release release;
    predict(moved, noted, masses, speeds, pulls, substep, keep);
}

// The batches of a sheet keep pointers to the caller's arrays of multipliers.
void py_add_distances(Sheets &sheets, const Rows<i32, 2> &pairs, const Flat<double> &lengths,
                      const ChangedNumbers &multipliers, const ScalingNumbers &scaling) {
    const std::size_t count = pairs.shape(0);
    members_of<2>(pairs, sheets.particles());
    const auto rest = items<const double>(lengths, count);
    const auto forces = items<double>(multipliers, count);
    sheets.add(make_distances({pairs.data(), pairs.size()}, sheets.halves(), rest, forces, sheets.inverse_masses(),
                              scaling_of(scaling)));
}

void py_add_chains(Sheets &sheets, const Array<const i32, nb::ndim<2>> &chains,
                   const Array<const double, nb::ndim<2>> &lengths, const Array<double, nb::ndim<2>> &multipliers,
                   const ScalingNumbers &scaling) {
    if (chains.shape(1) < 2) throw nb::value_error("a chain must have at least two points");
    const std::size_t links = chains.shape(1) - 1;
    members_of<1>(chains, sheets.particles());
    const auto rest = items<const double>(lengths, chains.shape(0) * links);
    const auto forces = items<double>(multipliers, chains.shape(0) * links);
    sheets.add(make_chains(links, {chains.data(), chains.size()}, sheets.halves(), rest, forces, scaling_of(scaling)));
}

void py_add_bending(Sheets &sheets, const Rows<i32, 4> &stencils, const Rows<double, 4> &coefficients,
                    const ChangedPoints &multipliers, const ScalingNumbers &scaling) {
    const std::size_t count = stencils.shape(0);
    members_of<4>(stencils, sheets.particles());
    const auto weights = items<const double>(coefficients, 4 * count);
    const auto forces = items<double>(multipliers, 3 * count);
    sheets.add(make_bending({stencils.data(), stencils.size()}, sheets.halves(), weights, forces,
                            sheets.inverse_masses(), scaling_of(scaling)));
}

void py_solve_sheets(Sheets &sheets, const ChangedPoints &positions, const Points &previous, bool is_first) {
    const std::size_t count = sheets.particles();
    const auto moved = items<Point>(positions, count);
    const auto before = items<const Point>(previous, count);
    nb::gil_scoped_release release;
    sheets.solve(moved, before, is_first);
}

void py_advance_sheets(Sheets &sheets, const ChangedPoints &positions, const ChangedPoints &previous,
                       const ChangedPoints &velocities, const Points &accelerations, double substep, double keep,
                       i64 substeps, i64 iterations, int threads) {
    const std::size_t count = sheets.particles();
    const auto moved = items<Point>(positions, count), noted = items<Point>(previous, count);
    const auto speeds = items<Point>(velocities, count);
    const auto pulls = items<const Point>(accelerations, count);
    nb::gil_scoped_release release;
    sheets.advance(moved, noted, speeds, pulls, substep, keep, substeps, iterations, threads);
}

void py_solve_volumes(const StateArrays &state, const Rows<i32, 4> &tetrahedra, const Flat<double> &volumes,
                      const ChangedNumbers &multipliers, const ScalingNumbers &scaling) {
    const Particles particles = particles_of(state);
    const std::size_t count = tetrahedra.shape(0);
    const auto members = members_of<4>(tetrahedra, particles.positions.size());
    const auto rest = items<const double>(volumes, count);
    const auto forces = items<double>(multipliers, count);
    nb::gil_scoped_release release;
    solve_volumes(particles, members, rest, forces, scaling_of(scaling));
}

using Inverses = Array<const double, nb::shape<-1, 3, 3>>;

void py_solve_tetrahedra(const StateArrays &state, const Rows<i32, 4> &tetrahedra, const Inverses &inverse_rest,
                         const Flat<double> &volumes, const Array<double, nb::shape<-1, 2>> &multipliers, double shear,
                         double bulk, double damping, double substep) {
    const Particles particles = particles_of(state);
    const std::size_t count = tetrahedra.shape(0);
    const auto members = members_of<4>(tetrahedra, particles.positions.size());
    const auto inverses = items<const InverseRest>(inverse_rest, count);
    const auto rest = items<const double>(volumes, count);
    const auto forces = items<std::array<double, 2>>(multipliers, count);
    nb::gil_scoped_release release;
    solve_tetrahedra(particles, members, inverses, rest, forces, {shear, bulk, damping}, substep);
}

void py_project_tetrahedra(const StateArrays &state, const Rows<i32, 4> &tetrahedra, const Inverses &inverse_rest,
                           double stiffness) {
    const Particles particles = particles_of(state);
    const auto members = members_of<4>(tetrahedra, particles.positions.size());
    const auto inverses = items<const InverseRest>(inverse_rest, tetrahedra.shape(0));
    nb::gil_scoped_release release;
    project_tetrahedra(particles, members, inverses, stiffness);
}

void py_add_wind(const Points &positions, const Points &past, const Rows<i32, 3> &triangles, double pressure,
                 const ChangedPoints &forces) {
    const std::size_t count = positions.shape(0);
    const auto places = items<const Point>(positions, count), air = items<const Point>(past, count);
    const auto members = members_of<3>(triangles, count);
    const auto sums = items<Point>(forces, count);
    nb::gil_scoped_release release;
    add_wind(places, air, members, pressure, sums);
}

}  // namespace

// Arrays that are changed must not be converted: the change would be made in a copy.
void bind_simulate(nb::module_ &module) {
    const auto changed = [](const char *name) { return nb::arg(name).noconvert(); };
    module.def("predict", &py_predict, changed("positions"), changed("previous"), nb::arg("inverse_masses"),
               nb::arg("velocities"), nb::arg("accelerations"), nb::arg("substep"), nb::arg("keep"),
               "Apply Eq. 4 with velocities times `keep`; copy the old positions to `previous`.");
    nb::class_<Sheets>(module, "Sheets", "Batches of sheets that are solved in turn.")
        .def(
            "__init__",
            [](Sheets *self, const Flat<double> &inverse_masses, i32 middle) {
                const std::size_t particles = inverse_masses.shape(0);
                if (middle < 0 || static_cast<std::size_t>(middle) > particles) {
                    throw nb::value_error("the middle must be 0 to the number of particles");
                }
                new (self) Sheets(items<const double>(inverse_masses, particles), middle);
            },
            nb::arg("inverse_masses"), nb::arg("middle"), "`middle`: number of the first particle of the second half.")
        .def("add_distances", &py_add_distances, nb::arg("pairs"), nb::arg("lengths"), changed("multipliers"),
             nb::arg("scaling"), nb::keep_alive<1, 4>())
        .def("add_chains", &py_add_chains, nb::arg("chains"), nb::arg("lengths"), changed("multipliers"),
             nb::arg("scaling"), nb::keep_alive<1, 4>())
        .def("add_bending", &py_add_bending, nb::arg("stencils"), nb::arg("coefficients"), changed("multipliers"),
             nb::arg("scaling"), nb::keep_alive<1, 4>())
        .def("solve", &py_solve_sheets, changed("positions"), nb::arg("previous"), nb::arg("is_first"),
             "Do one iteration; the first one starts multipliers from 0.")
        .def("advance", &py_advance_sheets, changed("positions"), changed("previous"), changed("velocities"),
             nb::arg("accelerations"), nb::arg("substep"), nb::arg("keep"), nb::arg("substeps"), nb::arg("iterations"),
             nb::arg("threads"), "Do substeps of Algorithm 1 with only these batches.")
        .def("store", &Sheets::store, "Write multipliers back to their arrays.");
    module.def("solve_volumes", &py_solve_volumes, changed("state"), nb::arg("tetrahedra"), nb::arg("volumes"),
               changed("multipliers"), nb::arg("scaling"), "Do one sweep over tetrahedra that keep their volumes.");
    module.def("solve_tetrahedra", &py_solve_tetrahedra, changed("state"), nb::arg("tetrahedra"),
               nb::arg("inverse_rest"), nb::arg("volumes"), changed("multipliers"), nb::arg("shear"), nb::arg("bulk"),
               nb::arg("damping"), nb::arg("substep"), "Do one sweep over neo-Hookean tetrahedra.");
    module.def("project_tetrahedra", &py_project_tetrahedra, changed("state"), nb::arg("tetrahedra"),
               nb::arg("inverse_rest"), nb::arg("stiffness"), "Do one PBD sweep over tetrahedra.");
    module.def("add_wind", &py_add_wind, nb::arg("positions"), nb::arg("past"), nb::arg("triangles"),
               nb::arg("pressure"), changed("forces"), "Add forces of air that moves past the particles.");
}

}  // namespace pdeanim::bindings
