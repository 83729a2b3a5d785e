#include "sections/residuals/added.hpp"

namespace pdeanim {

void add_residuals(const Residuals &residuals, i64 frame, const ResidualScale &scale, double weight,
                   std::span<const Position> base, std::span<Position> positions) {
    for (i64 k = residuals.frame_starts[frame]; k < residuals.frame_starts[frame + 1]; ++k) {
        Position &position = positions[scale.order[residuals.places[k]]];
        for (int axis = 0; axis < 3; ++axis) {
            const double offset = static_cast<double>(residuals.quantised[k][axis]) * scale.step;
            position[axis] = static_cast<float>(static_cast<double>(position[axis]) + weight * offset);
        }
    }
    for (i64 k = residuals.raw_frame_starts[frame]; k < residuals.raw_frame_starts[frame + 1]; ++k) {
        const i32 vertex = scale.order[residuals.raw_places[k]];
        const Position &raw = residuals.raw_positions[k];
        for (int axis = 0; axis < 3; ++axis) {
            float &coordinate = positions[vertex][axis];
            if (base.empty()) {
                coordinate = raw[axis];
            } else {
                const double offset = static_cast<double>(raw[axis]) - static_cast<double>(base[vertex][axis]);
                coordinate = static_cast<float>(static_cast<double>(coordinate) + weight * offset);
            }
        }
    }
}

void residual_displacements(const Residuals &residuals, i64 frame, const ResidualScale &scale,
                            std::span<const Position> base, std::span<std::array<double, 3>> displacements) {
    for (i64 k = residuals.frame_starts[frame]; k < residuals.frame_starts[frame + 1]; ++k) {
        auto &displacement = displacements[scale.order[residuals.places[k]]];
        for (int axis = 0; axis < 3; ++axis) {
            displacement[axis] = static_cast<double>(residuals.quantised[k][axis]) * scale.step;
        }
    }
    for (i64 k = residuals.raw_frame_starts[frame]; k < residuals.raw_frame_starts[frame + 1]; ++k) {
        const i32 vertex = scale.order[residuals.raw_places[k]];
        for (int axis = 0; axis < 3; ++axis) {
            displacements[vertex][axis] =
                static_cast<double>(residuals.raw_positions[k][axis]) - static_cast<double>(base[vertex][axis]);
        }
    }
}

}  // namespace pdeanim
