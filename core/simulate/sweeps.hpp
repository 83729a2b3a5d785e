// The simulator's loops: extended position-based dynamics (Fang et al. 2024, Algorithm 1).
//
// A sweep solves the constraints of one batch one after another, in the given order, and changes positions and
// multipliers in place (Eqs. 6 and 7). It runs on one thread and in the written order of operations, so the same scene
// gives the same bits. sheets.hpp solves several constraints at once, on one thread or two, with the same result.
// pdecodec/simulate describes the constraints. Callers have checked all indices.
#pragma once

#include <array>
#include <span>

#include "base/arithmetic.hpp"

namespace pdeanim::xpbd {

using Point = std::array<double, 3>;
template <std::size_t members> using Members = std::array<i32, members>;

struct Particles {
    std::span<Point> positions;              // x_j [m], changed by sweeps
    std::span<const Point> previous;         // x^n at the start of the substep [m]
    std::span<const double> inverse_masses;  // [1/kg]
};

// Material constants of one substep.
struct Scaling {
    double compliance;  // gamma / dt^2 of Eq. 5; 0 under PBD
    double damping;     // gamma of Eq. 26 in Macklin et al. 2016; 0 under PBD
    double relaxation;  // fraction of a correction that is applied
};

// A stable neo-Hookean material: mu and lambda [Pa], and the damping time divided by the substep.
struct Solid {
    double shear, bulk, damping;
};

// The inverse of the matrix whose columns are a tetrahedron's edges at rest [1/m], row by row.
using InverseRest = std::array<std::array<double, 3>, 3>;

// Line 1 of Algorithm 1: store previous positions, and move free particles with the fraction `keep` of their
// velocities.
void predict(std::span<Point> positions, std::span<Point> previous, std::span<const double> inverse_masses,
             std::span<const Point> velocities, std::span<const Point> accelerations, double substep, double keep);

void solve_volumes(const Particles &particles, std::span<const Members<4>> tetrahedra, std::span<const double> volumes,
                   std::span<double> multipliers, const Scaling &scaling);

void solve_tetrahedra(const Particles &particles, std::span<const Members<4>> tetrahedra,
                      std::span<const InverseRest> inverse_rest, std::span<const double> volumes,
                      std::span<std::array<double, 2>> multipliers, const Solid &material, double substep);

// Project tetrahedra one after another by PBD: first to sqrt(tr(F^T F)) = sqrt(3), then to det F = 1.
void project_tetrahedra(const Particles &particles, std::span<const Members<4>> tetrahedra,
                        std::span<const InverseRest> inverse_rest, double stiffness);

// Add the forces of wind [N]. past: the air's velocity relative to each particle [m/s]; pressure: half the air's
// density times the drag coefficient [kg/m^3].
void add_wind(std::span<const Point> positions, std::span<const Point> past, std::span<const Members<3>> triangles,
              double pressure, std::span<Point> forces);

}  // namespace pdeanim::xpbd
