#include "base/lanes.hpp"
#include "simulate/slots.hpp"

namespace pdeanim::xpbd {

namespace {

struct PairSlots : DistanceSlots {
    const double *inverse_masses;  // of both particles of each pair
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
        // Two held particles have nothing to give; two at one place have no direction to part in.
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

void solve_damped(const Places &places, const PairSlots &slots, std::size_t count, const Scaling &scaling) {
    in_wide([&](auto bytes) PDEANIM_INLINE_LAMBDA { solve_pairs<true, Slot<bytes>>(places, slots, count, scaling); });
}
void solve_undamped(const Places &places, const PairSlots &slots, std::size_t count, const Scaling &scaling) {
    in_wide([&](auto bytes) PDEANIM_INLINE_LAMBDA { solve_pairs<false, Slot<bytes>>(places, slots, count, scaling); });
}

class Distances : public SlottedBatch {
public:
    // inverse_masses: of both particles of each pair.
    Distances(std::span<const i32> pairs, const Halves &halves, std::span<const double> lengths,
              std::span<double> multipliers, std::span<const double> inverse_masses, const Scaling &scaling)
        : SlottedBatch(pairs, 2, halves, multipliers, 1, scaling), lengths_(slotted(lengths, 1, 0.0)),
          inverse_masses_(slotted(inverse_masses, 2, 0.0)) {}

protected:
    void solve_group(const Places &places, Group group) override {
        const PairSlots slots{
            {members_.data() + first_of(group, 2), lengths_.data() + first_of(group, 1), multipliers_of(group)},
            inverse_masses_.data() + first_of(group, 2)};
        const auto take = scaling_.damping > 0.0 ? solve_damped : solve_undamped;
        take(places, slots, count(group), scaling_);
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

}  // namespace pdeanim::xpbd
