#include "base/lanes.hpp"
#include "simulate/sheets.hpp"

namespace pdeanim::xpbd {

namespace {

struct PairSlots : DistanceSlots {
    const double *inverse_masses;  // inverse masses of both particles of each pair
};

template <bool is_damped, class Slot>
PDEANIM_INLINE void solve_pairs(Places places, PairSlots slots, std::size_t count, Scaling scaling) {
    const auto [compliance, damping, relaxation] = scaling;
    for (std::size_t slot = 0; slot < count; ++slot) {
        const i32 *members = slots.members + slot * 2 * slot_size;
        const Slot multipliers = Slot::at(slots.multipliers + slot * slot_size);
        Register ways[slot_size], steps[slot_size];
        for (int lane = 0; lane < slot_size; ++lane) {
            const i32 a = members[lane], b = members[slot_size + lane];
            const Register x_a = lanes_at<4>(places.positions[a].at), x_b = lanes_at<4>(places.positions[b].at);
            ways[lane] = x_b - x_a;
            if constexpr (is_damped) {
                const Place *const old = places.previous;
                steps[lane] = x_b - lanes_at<4>(old[b].at) - x_a + lanes_at<4>(old[a].at);
            }
        }
        const Vectors<Slot> way = vectors<Slot>(ways);
        const double *inverse_masses = slots.inverse_masses + slot * 2 * slot_size;
        const Slot weight_a = Slot::at(inverse_masses);
        const Slot weight_b = Slot::at(inverse_masses + slot_size);
        const Slot weight = weight_a + weight_b;
        const Slot length = square_roots(dot(way, way));
        const Slot inverse = 1.0 / length;
        Slot right = Slot::at(slots.lengths + slot * slot_size) - length - compliance * multipliers;
        if constexpr (is_damped) right -= damping * dot(way, vectors<Slot>(steps)) * inverse;
        // Two held particles cannot move; two particles at the same point have no direction to separate in.
        Slot change = right / ((1.0 + damping) * weight + compliance);  // Eq. 6
        change = where_positive(weight, where_positive(length, change));
        (multipliers + change).put(slots.multipliers + slot * slot_size);
        const Slot scale = where_positive(length, relaxation * change * inverse);
        const Slot share_a = weight_a * scale, share_b = weight_b * scale;
        for (int lane = 0; lane < slot_size; ++lane) {  // Eq. 7
            double *a = places.positions[members[lane]].at, *b = places.positions[members[slot_size + lane]].at;
            put_lanes(a, lanes_at<4>(a) - share_a[lane] * ways[lane]);
            put_lanes(b, lanes_at<4>(b) + share_b[lane] * ways[lane]);
        }
    }
}

void solve_all(const Places &places, const PairSlots &slots, std::size_t count, const Scaling &scaling) {
    in_wide([&](auto bytes) PDEANIM_INLINE_LAMBDA {
        if (scaling.damping > 0.0) {
            solve_pairs<true, Slot<bytes>>(places, slots, count, scaling);
        } else {
            solve_pairs<false, Slot<bytes>>(places, slots, count, scaling);
        }
    });
}

class Distances : public SlottedBatch {
public:
    // inverse_masses: inverse masses of both particles of each pair.
    Distances(std::span<const i32> pairs, const Halves &halves, std::span<const double> lengths,
              std::span<double> multipliers, std::span<const double> inverse_masses, const Scaling &scaling)
        : SlottedBatch(pairs, 2, halves, multipliers, 1, scaling), lengths_(slotted(lengths, 1, 0.0)),
          inverse_masses_(slotted(inverse_masses, 2, 0.0)) {}

protected:
    void solve_group(const Places &places, Group group) override {
        const PairSlots slots{
            {members_.data() + first_of(group, 2), lengths_.data() + first_of(group, 1), multipliers_of(group)},
            inverse_masses_.data() + first_of(group, 2)};
        solve_all(places, slots, count(group), scaling_);
    }

private:
    std::vector<double> lengths_, inverse_masses_;
};

}  // namespace

std::unique_ptr<Batch> make_distances(std::span<const i32> pairs, const Halves &halves, std::span<const double> lengths,
                                      std::span<double> multipliers, std::span<const double> inverse_masses,
                                      const Scaling &scaling) {
    std::vector<double> own;
    own.reserve(pairs.size());
    for (const i32 particle : pairs) own.push_back(inverse_masses[particle]);
    return std::make_unique<Distances>(pairs, halves, lengths, multipliers, own, scaling);
}

namespace {

struct BendingSlots {
    const i32 *members;
    const double *coefficients, *shares, *inverses;  // shares: inverse mass times coefficient of each particle
    double *multipliers;
};

// Solve one constraint after another, with the three axes side by side. The constraints of a slot are independent, so
// the processor can overlap them.
template <bool is_damped>
PDEANIM_INLINE void solve_bending(Places places, BendingSlots slots, std::size_t count, Scaling scaling) {
    const auto [compliance, damping, relaxation] = scaling;
    for (std::size_t slot = 0; slot < count; ++slot) {
        const i32 *members = slots.members + slot * 4 * slot_size;
        const double *coefficients = slots.coefficients + slot * 4 * slot_size;
        const double *shares = slots.shares + slot * 4 * slot_size;
        double *multipliers = slots.multipliers + slot * 4 * slot_size;
        for (int lane = 0; lane < slot_size; ++lane) {
            const i32 a = members[lane], b = members[slot_size + lane];
            const i32 c = members[2 * slot_size + lane], d = members[3 * slot_size + lane];
            const double of_a = coefficients[lane], of_b = coefficients[slot_size + lane];
            const double of_c = coefficients[2 * slot_size + lane], of_d = coefficients[3 * slot_size + lane];
            Place *const now = places.positions;
            const Register x_a = lanes_at<4>(now[a].at), x_b = lanes_at<4>(now[b].at);
            const Register x_c = lanes_at<4>(now[c].at), x_d = lanes_at<4>(now[d].at);
            const Register value = of_a * x_a + of_b * x_b + of_c * x_c + of_d * x_d;
            Register multiplier = lanes_at<4>(multipliers + 4 * lane);
            Register right = -value - compliance * multiplier;
            if constexpr (is_damped) {
                const Place *const old = places.previous;
                const Register before = of_a * lanes_at<4>(old[a].at) + of_b * lanes_at<4>(old[b].at) +
                                        of_c * lanes_at<4>(old[c].at) + of_d * lanes_at<4>(old[d].at);
                right -= damping * (value - before);
            }
            Register change = right * slots.inverses[slot * slot_size + lane];  // Eq. 6
            multiplier += change;
            put_lanes(multipliers + 4 * lane, multiplier);
            change = change * relaxation;
            put_lanes(now[a].at, x_a + shares[lane] * change);  // Eq. 7
            put_lanes(now[b].at, x_b + shares[slot_size + lane] * change);
            put_lanes(now[c].at, x_c + shares[2 * slot_size + lane] * change);
            put_lanes(now[d].at, x_d + shares[3 * slot_size + lane] * change);
        }
    }
}

void solve_all(const Places &places, const BendingSlots &slots, std::size_t count, const Scaling &scaling) {
    in_wide([&](auto) PDEANIM_INLINE_LAMBDA {
        if (scaling.damping > 0.0) {
            solve_bending<true>(places, slots, count, scaling);
        } else {
            solve_bending<false>(places, slots, count, scaling);
        }
    });
}

class Bending : public SlottedBatch {
public:
    Bending(std::span<const i32> stencils, const Halves &halves, std::span<const double> coefficients,
            std::span<const double> shares, std::span<double> multipliers, std::span<const double> inverses,
            const Scaling &scaling)
        : SlottedBatch(stencils, 4, halves, multipliers, 3, scaling, Multipliers::by_axes),
          coefficients_(slotted(coefficients, 4, 0.0)), shares_(slotted(shares, 4, 0.0)),
          inverses_(slotted(inverses, 1, 0.0)) {}

protected:
    void solve_group(const Places &places, Group group) override {
        const BendingSlots slots{members_.data() + first_of(group, 4), coefficients_.data() + first_of(group, 4),
                                 shares_.data() + first_of(group, 4), inverses_.data() + first_of(group, 1),
                                 multipliers_of(group)};
        solve_all(places, slots, count(group), scaling_);
    }

private:
    std::vector<double> coefficients_, shares_, inverses_;
};

}  // namespace

std::unique_ptr<Batch> make_bending(std::span<const i32> stencils, const Halves &halves,
                                    std::span<const double> coefficients, std::span<double> multipliers,
                                    std::span<const double> inverse_masses, const Scaling &scaling) {
    std::vector<double> inverses(stencils.size() / 4, 0.0), shares(stencils.size());
    for (std::size_t i = 0; i < inverses.size(); ++i) {
        double slope = 0.0;
        for (int k = 0; k < 4; ++k) {
            const double coefficient = coefficients[4 * i + k];
            const double inverse_mass = inverse_masses[stencils[4 * i + k]];
            shares[4 * i + k] = inverse_mass * coefficient;
            const double term = inverse_mass * coefficient * coefficient;
            slope = k == 0 ? term : slope + term;
        }
        // Held particles cannot move.
        if (slope != 0.0) inverses[i] = 1.0 / ((1.0 + scaling.damping) * slope + scaling.compliance);
    }
    return std::make_unique<Bending>(stencils, halves, coefficients, shares, multipliers, inverses, scaling);
}

}  // namespace pdeanim::xpbd
