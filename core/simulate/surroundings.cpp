#include <cmath>

#include "simulate/sweeps.hpp"

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
        // Area times normal is half of what is across; each corner takes a third.
        const double share = pressure * std::abs(speed) * speed / 6.0;
        for (int axis = 0; axis < 3; ++axis) {
            forces[a][axis] += share * across[axis];
            forces[b][axis] += share * across[axis];
            forces[c][axis] += share * across[axis];
        }
    }
}

}  // namespace pdeanim::xpbd
