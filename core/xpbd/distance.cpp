#include <cmath>
#include <vector>

#include "xpbd/sweeps.hpp"

namespace pdeanim::xpbd {

void solve_distances(const Particles &particles, std::span<const Members<2>> pairs, std::span<const double> lengths,
                     std::span<double> multipliers, const Scaling &scaling) {
    const auto &[positions, previous, inverse_masses] = particles;
    const auto [compliance, damping, relaxation] = scaling;
    for (std::size_t i = 0; i < pairs.size(); ++i) {
        const auto [a, b] = pairs[i];
        const double weight_a = inverse_masses[a], weight_b = inverse_masses[b];
        const double weight = weight_a + weight_b;
        const double x = positions[b][0] - positions[a][0];
        const double y = positions[b][1] - positions[a][1];
        const double z = positions[b][2] - positions[a][2];
        const double length = std::sqrt(x * x + y * y + z * z);
        // Two held particles have nothing to give; two at one place have no direction to part in.
        if (weight == 0.0 || length == 0.0) continue;
        const double inverse = 1.0 / length;
        double right = lengths[i] - length - compliance * multipliers[i];
        if (damping > 0.0) {
            double rate = x * (positions[b][0] - previous[b][0] - positions[a][0] + previous[a][0]);
            rate += y * (positions[b][1] - previous[b][1] - positions[a][1] + previous[a][1]);
            rate += z * (positions[b][2] - previous[b][2] - positions[a][2] + previous[a][2]);
            right -= damping * rate * inverse;
        }
        const double change = right / ((1.0 + damping) * weight + compliance);  // Eq. 6
        multipliers[i] += change;
        const double scale = relaxation * change * inverse;
        positions[a][0] -= weight_a * scale * x;  // Eq. 7
        positions[a][1] -= weight_a * scale * y;
        positions[a][2] -= weight_a * scale * z;
        positions[b][0] += weight_b * scale * x;
        positions[b][1] += weight_b * scale * y;
        positions[b][2] += weight_b * scale * z;
    }
}

// Eqs. 6 and 7 for chain after chain, by elimination without pivoting: the matrix is positive definite.
void solve_chains(const Particles &particles, std::size_t links, std::span<const i32> chains,
                  std::span<const double> lengths, std::span<double> multipliers, const Scaling &scaling) {
    // The share of the diagonal under which a pivot is rounding: a straight rigid chain that is held at both ends has
    // one link too many, and that link is left as it is.
    constexpr double smallest_pivot = 1e-12;
    struct Link {
        Point direction;
        double upper, right, change;  // upper: of the bidiagonal matrix that elimination leaves, its diagonal 1
    };
    const auto &[positions, previous, inverse_masses] = particles;
    const auto [compliance, damping, _] = scaling;
    std::vector<Link> row(links);
    for (std::size_t chain = 0; chain < chains.size() / (links + 1); ++chain) {
        const i32 *points = chains.data() + chain * (links + 1);
        const double *rest = lengths.data() + chain * links;
        double *multiplier = multipliers.data() + chain * links;
        double pivot = 0.0;
        for (std::size_t i = 0; i < links; ++i) {
            const i32 a = points[i], b = points[i + 1];
            Link &link = row[i];
            double square = 0.0, rate = 0.0, bend = 0.0;
            for (int axis = 0; axis < 3; ++axis) {
                link.direction[axis] = positions[b][axis] - positions[a][axis];
                square += link.direction[axis] * link.direction[axis];
            }
            const double length = std::sqrt(square);
            const double inverse = length > 0.0 ? 1.0 / length : 0.0;
            for (int axis = 0; axis < 3; ++axis) {
                link.direction[axis] *= inverse;
                const double moved = positions[b][axis] - previous[b][axis] - positions[a][axis] + previous[a][axis];
                rate += link.direction[axis] * moved;
                if (i > 0) bend += row[i - 1].direction[axis] * link.direction[axis];
            }
            link.right = rest[i] - length - compliance * multiplier[i] - damping * rate;
            const double directed = length > 0.0 ? 1.0 : 0.0;
            const double full = (1.0 + damping) * directed * (inverse_masses[a] + inverse_masses[b]) + compliance;
            double diagonal = full;
            if (i > 0) {
                const double coupling = -(1.0 + damping) * inverse_masses[a] * bend;
                row[i - 1].upper = coupling * pivot;
                diagonal -= coupling * row[i - 1].upper;
                link.right -= coupling * row[i - 1].right;
            }
            pivot = diagonal > smallest_pivot * full ? 1.0 / diagonal : 0.0;
            link.right *= pivot;
        }
        row[links - 1].change = row[links - 1].right;
        for (std::size_t i = links - 1; i-- > 0;) row[i].change = row[i].right - row[i].upper * row[i + 1].change;
        for (std::size_t i = 0; i < links; ++i) {
            multiplier[i] += row[i].change;  // Eq. 6
            const i32 a = points[i], b = points[i + 1];
            for (int axis = 0; axis < 3; ++axis) {
                const double step = row[i].direction[axis] * row[i].change;
                positions[a][axis] -= inverse_masses[a] * step;  // Eq. 7
                positions[b][axis] += inverse_masses[b] * step;
            }
        }
    }
}

}  // namespace pdeanim::xpbd
