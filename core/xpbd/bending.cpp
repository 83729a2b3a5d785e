#include "xpbd/sweeps.hpp"

namespace pdeanim::xpbd {

void solve_bending(const Particles &particles, std::span<const Members<4>> stencils,
                   std::span<const std::array<double, 4>> coefficients, std::span<Point> multipliers,
                   const Scaling &scaling) {
    const auto &[x, old, weights] = particles;
    const auto [compliance, damping, relaxation] = scaling;
    for (std::size_t i = 0; i < stencils.size(); ++i) {
        const auto [a, b, c, d] = stencils[i];
        const auto [of_a, of_b, of_c, of_d] = coefficients[i];
        const double step_a = weights[a] * of_a, step_b = weights[b] * of_b;
        const double step_c = weights[c] * of_c, step_d = weights[d] * of_d;
        const double slope = step_a * of_a + step_b * of_b + step_c * of_c + step_d * of_d;
        if (slope == 0.0) continue;
        const double inverse = 1.0 / ((1.0 + damping) * slope + compliance);
        for (int axis = 0; axis < 3; ++axis) {
            const double value = of_a * x[a][axis] + of_b * x[b][axis] + of_c * x[c][axis] + of_d * x[d][axis];
            double right = -value - compliance * multipliers[i][axis];
            if (damping > 0.0) {
                const double before =
                    of_a * old[a][axis] + of_b * old[b][axis] + of_c * old[c][axis] + of_d * old[d][axis];
                right -= damping * (value - before);
            }
            double change = right * inverse;  // Eq. 6
            multipliers[i][axis] += change;
            change *= relaxation;
            x[a][axis] += step_a * change;  // Eq. 7
            x[b][axis] += step_b * change;
            x[c][axis] += step_c * change;
            x[d][axis] += step_d * change;
        }
    }
}

}  // namespace pdeanim::xpbd
