#include "simulate/sweeps.hpp"

#include <cmath>

namespace pdeanim::xpbd {

void predict(std::span<Point> positions, std::span<Point> previous, std::span<const double> inverse_masses,
             std::span<const Point> velocities, std::span<const Point> accelerations, double substep, double keep) {
    for (std::size_t i = 0; i < positions.size(); ++i) {
        for (int axis = 0; axis < 3; ++axis) {
            previous[i][axis] = positions[i][axis];
            if (inverse_masses[i] > 0.0) {
                const double step = keep * velocities[i][axis] + substep * accelerations[i][axis];
                positions[i][axis] += substep * step;  // Eq. 4
            }
        }
    }
}

void add_wind(std::span<const Point> positions, std::span<const Point> past, std::span<const Members<3>> triangles,
              double pressure, std::span<Point> forces) {
    for (const auto &[a, b, c] : triangles) {
        Point across, speeds;
        for (int axis = 0; axis < 3; ++axis) {
            const int u = (axis + 1) % 3, v = (axis + 2) % 3;
            const double first = (positions[b][u] - positions[a][u]) * (positions[c][v] - positions[a][v]);
            across[axis] = first - (positions[b][v] - positions[a][v]) * (positions[c][u] - positions[a][u]);
            speeds[axis] = (past[a][axis] + past[b][axis] + past[c][axis]) * across[axis];
        }
        const double double_area = std::sqrt(across[0] * across[0] + across[1] * across[1] + across[2] * across[2]);
        if (!(double_area > 0.0)) continue;
        const double speed = (speeds[0] + speeds[1] + speeds[2]) / (3.0 * double_area);
        // Area times normal is half the cross product, and each corner gets a third of that.
        const double share = pressure * std::abs(speed) * speed / 6.0;
        for (int axis = 0; axis < 3; ++axis) {
            forces[a][axis] += share * across[axis];
            forces[b][axis] += share * across[axis];
            forces[c][axis] += share * across[axis];
        }
    }
}

namespace {

using Matrix = std::array<std::array<double, 3>, 3>;

// The two constraints of a neo-Hookean tetrahedron, linearised at the current positions.
struct Rows {
    double size, determinant;                      // sqrt(tr(F^T F)) and det F
    std::array<Point, 4> of_size, of_determinant;  // gradients of both at the four corners
};

// Return the gradients at the four corners of a function whose derivative by the deformation gradient is `slope`.
std::array<Point, 4> gradients(const Matrix &slope, const InverseRest &inverse, double scale) {
    std::array<Point, 4> found;
    for (int i = 0; i < 3; ++i) {
        found[0][i] = 0.0;
        for (int corner = 0; corner < 3; ++corner) {
            double entry = slope[i][0] * inverse[corner][0] + slope[i][1] * inverse[corner][1];
            entry = (entry + slope[i][2] * inverse[corner][2]) * scale;
            found[corner + 1][i] = entry;
            found[0][i] -= entry;
        }
    }
    return found;
}

Rows linearise(std::span<const Point> positions, const Members<4> &corners, const InverseRest &inverse) {
    Matrix deformation, cofactor;
    double square = 0.0;
    for (int i = 0; i < 3; ++i) {
        const double first = positions[corners[1]][i] - positions[corners[0]][i];
        const double second = positions[corners[2]][i] - positions[corners[0]][i];
        const double third = positions[corners[3]][i] - positions[corners[0]][i];
        for (int j = 0; j < 3; ++j) {
            const double entry = first * inverse[0][j] + second * inverse[1][j] + third * inverse[2][j];
            deformation[i][j] = entry;
            square += entry * entry;
        }
    }
    Rows rows;
    rows.size = std::sqrt(square);
    for (int i = 0; i < 3; ++i) {
        const int k = (i + 1) % 3, m = (i + 2) % 3;
        for (int j = 0; j < 3; ++j) {
            const int u = (j + 1) % 3, v = (j + 2) % 3;
            cofactor[i][j] = deformation[k][u] * deformation[m][v] - deformation[k][v] * deformation[m][u];
        }
    }
    rows.determinant = 0.0;
    for (int j = 0; j < 3; ++j) rows.determinant += deformation[0][j] * cofactor[0][j];
    rows.of_size = gradients(deformation, inverse, rows.size > 0.0 ? 1.0 / rows.size : 0.0);
    rows.of_determinant = gradients(cofactor, inverse, 1.0);
    return rows;
}

}  // namespace

void solve_volumes(const Particles &particles, std::span<const Members<4>> tetrahedra, std::span<const double> volumes,
                   std::span<double> multipliers, const Scaling &scaling) {
    const auto &[positions, previous, inverse_masses] = particles;
    const auto [compliance, damping, relaxation] = scaling;
    for (std::size_t i = 0; i < tetrahedra.size(); ++i) {
        const Members<4> &corners = tetrahedra[i];
        Matrix edges;
        std::array<Point, 4> gradient;
        for (int corner = 0; corner < 3; ++corner) {
            for (int axis = 0; axis < 3; ++axis) {
                edges[corner][axis] = positions[corners[corner + 1]][axis] - positions[corners[0]][axis];
            }
        }
        for (int corner = 0; corner < 3; ++corner) {
            const int u = (corner + 1) % 3, v = (corner + 2) % 3;
            for (int axis = 0; axis < 3; ++axis) {
                const int j = (axis + 1) % 3, k = (axis + 2) % 3;
                gradient[corner + 1][axis] = (edges[u][j] * edges[v][k] - edges[u][k] * edges[v][j]) / 6.0;
            }
        }
        double slope = 0.0, rate = 0.0, volume = 0.0;
        for (int axis = 0; axis < 3; ++axis) {
            gradient[0][axis] = -(gradient[1][axis] + gradient[2][axis] + gradient[3][axis]);
            volume += edges[0][axis] * gradient[1][axis];
            for (int corner = 0; corner < 4; ++corner) {
                const i32 particle = corners[corner];
                slope += inverse_masses[particle] * (gradient[corner][axis] * gradient[corner][axis]);
                rate += gradient[corner][axis] * (positions[particle][axis] - previous[particle][axis]);
            }
        }
        if (slope == 0.0) continue;
        const double right = volumes[i] - volume - compliance * multipliers[i] - damping * rate;
        double change = right / ((1.0 + damping) * slope + compliance);  // Eq. 6
        multipliers[i] += change;
        change *= relaxation;
        for (int corner = 0; corner < 4; ++corner) {
            const i32 particle = corners[corner];
            for (int axis = 0; axis < 3; ++axis) {
                positions[particle][axis] += inverse_masses[particle] * gradient[corner][axis] * change;  // Eq. 7
            }
        }
    }
}

void solve_tetrahedra(const Particles &particles, std::span<const Members<4>> tetrahedra,
                      std::span<const InverseRest> inverse_rest, std::span<const double> volumes,
                      std::span<std::array<double, 2>> multipliers, const Solid &material, double substep) {
    const auto &[positions, previous, inverse_masses] = particles;
    const auto [shear, bulk, damping] = material;
    const double target = 1.0 + shear / bulk;
    for (std::size_t i = 0; i < tetrahedra.size(); ++i) {
        const Members<4> &corners = tetrahedra[i];
        const Rows rows = linearise(positions, corners, inverse_rest[i]);
        // How many times over this substep would undo the tetrahedron's shear: stiffness over mass times the squared
        // substep.
        double spread = 0.0;
        for (int axis = 0; axis < 3; ++axis) {
            double total = 0.0;
            for (int corner = 0; corner < 3; ++corner) {
                const double entry = inverse_rest[i][corner][axis];
                spread += inverse_masses[corners[corner + 1]] * entry * entry;
                total += entry;
            }
            spread += inverse_masses[corners[0]] * total * total;
        }
        const double pressure = bulk * std::abs(rows.determinant - target) * rows.size / std::sqrt(3.0);
        const double once = most(substep * substep * volumes[i] * spread * (shear + pressure), 1.0);
        const double scaled_d = once / (shear * volumes[i] * substep * substep);  // Eq. 5
        const double scaled_h = once / (bulk * volumes[i] * substep * substep);
        double slope_dd = 0.0, slope_dh = 0.0, slope_hh = 0.0, rate_d = 0.0, rate_h = 0.0;
        for (int corner = 0; corner < 4; ++corner) {
            const i32 particle = corners[corner];
            const double weight = inverse_masses[particle];
            for (int axis = 0; axis < 3; ++axis) {
                const double d = rows.of_size[corner][axis], h = rows.of_determinant[corner][axis];
                const double moved = positions[particle][axis] - previous[particle][axis];
                slope_dd += weight * d * d;
                slope_dh += weight * d * h;
                slope_hh += weight * h * h;
                rate_d += d * moved;
                rate_h += h * moved;
            }
        }
        const double right_d = -rows.size - scaled_d * multipliers[i][0] - damping * rate_d;
        const double right_h = target - rows.determinant - scaled_h * multipliers[i][1] - damping * rate_h;
        // Eq. 6 with two rows, by Cramer's rule; the compliance on the diagonal keeps the matrix positive definite.
        const double own_d = (1.0 + damping) * slope_dd + scaled_d;
        const double own_h = (1.0 + damping) * slope_hh + scaled_h;
        const double both = (1.0 + damping) * slope_dh;
        const double inverse = 1.0 / (own_d * own_h - both * both);
        const double change_d = (right_d * own_h - right_h * both) * inverse;
        const double change_h = (right_h * own_d - right_d * both) * inverse;
        multipliers[i][0] += change_d;
        multipliers[i][1] += change_h;
        for (int corner = 0; corner < 4; ++corner) {
            const i32 particle = corners[corner];
            const double weight = inverse_masses[particle];
            for (int axis = 0; axis < 3; ++axis) {
                const double d = rows.of_size[corner][axis], h = rows.of_determinant[corner][axis];
                positions[particle][axis] += weight * (d * change_d + h * change_h);  // Eq. 7
            }
        }
    }
}

void project_tetrahedra(const Particles &particles, std::span<const Members<4>> tetrahedra,
                        std::span<const InverseRest> inverse_rest, double stiffness) {
    const auto &[positions, _, inverse_masses] = particles;
    for (std::size_t i = 0; i < tetrahedra.size(); ++i) {
        const Members<4> &corners = tetrahedra[i];
        for (int row = 0; row < 2; ++row) {
            const Rows rows = linearise(positions, corners, inverse_rest[i]);
            const std::array<Point, 4> &gradient = row == 0 ? rows.of_size : rows.of_determinant;
            const double violation = row == 0 ? rows.size - std::sqrt(3.0) : rows.determinant - 1.0;
            double slope = 0.0;
            for (int corner = 0; corner < 4; ++corner) {
                for (const double entry : gradient[corner]) slope += inverse_masses[corners[corner]] * (entry * entry);
            }
            if (slope == 0.0) continue;
            const double step = -stiffness * violation / slope;
            for (int corner = 0; corner < 4; ++corner) {
                const i32 particle = corners[corner];
                for (int axis = 0; axis < 3; ++axis) {
                    positions[particle][axis] += inverse_masses[particle] * gradient[corner][axis] * step;
                }
            }
        }
    }
}

}  // namespace pdeanim::xpbd
