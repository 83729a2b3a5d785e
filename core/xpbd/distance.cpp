#include <cmath>

#include "xpbd/slots.hpp"

namespace pdeanim::xpbd {

namespace {

struct DistanceSlots {
    const i32 *members;
    const double *lengths;
    double *multipliers;
};

// What a function of the lane returns.
template <class Number> PDEANIM_INLINE Slot by_lane(const Number &number) {
    static_assert(slot_size == 8);
    return Slot{number(0), number(1), number(2), number(3), number(4), number(5), number(6), number(7)};
}

PDEANIM_INLINE Slot square_roots(const Slot &squares) {
    return by_lane([&](int lane) PDEANIM_INLINE_LAMBDA { return std::sqrt(squares[lane]); });
}

// Vectors of a slot's constraints, an axis after another.
struct Vectors {
    Slot axes[3];
};

PDEANIM_INLINE Slot dot(const Vectors &u, const Vectors &v) {
    return u.axes[0] * v.axes[0] + u.axes[1] * v.axes[1] + u.axes[2] * v.axes[2];
}

// Of a vector in each lane.
PDEANIM_INLINE Vectors vectors(const Register *each) {
    return {by_lane([&](int lane) PDEANIM_INLINE_LAMBDA { return each[lane][0]; }),
            by_lane([&](int lane) PDEANIM_INLINE_LAMBDA { return each[lane][1]; }),
            by_lane([&](int lane) PDEANIM_INLINE_LAMBDA { return each[lane][2]; })};
}

PDEANIM_INLINE Vectors vectors(const Place *places, const i32 *points) {
    return {by_lane([&](int lane) PDEANIM_INLINE_LAMBDA { return places[points[lane]].at[0]; }),
            by_lane([&](int lane) PDEANIM_INLINE_LAMBDA { return places[points[lane]].at[1]; }),
            by_lane([&](int lane) PDEANIM_INLINE_LAMBDA { return places[points[lane]].at[2]; })};
}

// Inverse ones.
PDEANIM_INLINE Slot masses(const Places &places, const i32 *points) {
    return by_lane([&](int lane) PDEANIM_INLINE_LAMBDA { return places.previous[points[lane]].at[3]; });
}

template <bool is_damped> PDEANIM_INLINE void solve_pairs(const Places &places, const DistanceSlots &slots,
                                                          std::size_t count, const Scaling &scaling) {
    const auto [compliance, damping, relaxation] = scaling;
    for (std::size_t slot = 0; slot < count; ++slot) {
        const i32 *members = slots.members + slot * 2 * slot_size;
        auto &multipliers = lanes_at<slot_size>(slots.multipliers + slot * slot_size);
        Register ways[slot_size], steps[slot_size];
        for (int lane = 0; lane < slot_size; ++lane) {
            const i32 a = members[lane], b = members[slot_size + lane];
            const auto &x_a = lanes_at<4>(places.positions[a].at), &x_b = lanes_at<4>(places.positions[b].at);
            ways[lane] = x_b - x_a;
            const Place &old_a = places.previous[a], &old_b = places.previous[b];
            if constexpr (is_damped) steps[lane] = x_b - lanes_at<4>(old_b.at) - x_a + lanes_at<4>(old_a.at);
        }
        const Vectors way = vectors(ways);
        const Slot weight_a = masses(places, members), weight_b = masses(places, members + slot_size);
        const Slot weight = weight_a + weight_b;
        const Slot length = square_roots(dot(way, way));
        const Slot inverse = 1.0 / length;
        Slot right = lanes_at<slot_size>(slots.lengths + slot * slot_size) - length - compliance * multipliers;
        if constexpr (is_damped) right -= damping * dot(way, vectors(steps)) * inverse;
        // Two held particles have nothing to give; two at one place have no direction to part in.
        Slot change = right / ((1.0 + damping) * weight + compliance);  // Eq. 6
        change = where_positive(weight, where_positive(length, change));
        multipliers += change;
        const Slot scale = where_positive(length, relaxation * change * inverse);
        const Slot share_a = weight_a * scale, share_b = weight_b * scale;
        for (int lane = 0; lane < slot_size; ++lane) {  // Eq. 7
            lanes_at<4>(places.positions[members[lane]].at) -= share_a[lane] * ways[lane];
            lanes_at<4>(places.positions[members[slot_size + lane]].at) += share_b[lane] * ways[lane];
        }
    }
}

PDEANIM_MULTIVERSION void solve_damped(const Places &places, const DistanceSlots &slots, std::size_t count,
                                       const Scaling &scaling) {
    solve_pairs<true>(places, slots, count, scaling);
}
PDEANIM_MULTIVERSION void solve_undamped(const Places &places, const DistanceSlots &slots, std::size_t count,
                                         const Scaling &scaling) {
    solve_pairs<false>(places, slots, count, scaling);
}

class Distances : public SlottedBatch {
public:
    Distances(std::span<const i32> pairs, i32 filler, std::span<const double> lengths, std::span<double> multipliers,
              const Scaling &scaling)
        : SlottedBatch(pairs, 2, filler, multipliers, 1, scaling), lengths_(slotted(lengths, 1, 0.0)) {}

    void solve(const Places &places) override {
        const DistanceSlots slots{members_.data(), lengths_.data(), multipliers_.data()};
        const auto take = scaling_.damping > 0.0 ? solve_damped : solve_undamped;
        take(places, slots, slot_count(), scaling_);
    }

private:
    std::vector<double> lengths_;
};

// A link of each chain of a slot. upper: of the bidiagonal matrix that elimination leaves, its diagonal 1.
struct alignas(64) Link {
    Vectors direction;
    Slot upper, right, mass;  // mass: the inverse one of its first point
};

// The same point of each chain of a slot.
struct Looked {
    Vectors now, before;
    Slot mass;
};

PDEANIM_INLINE Looked look(const Places &places, const i32 *points) {
    return {vectors(places.positions, points), vectors(places.previous, points), masses(places, points)};
}

// Eqs. 6 and 7 for chain after chain, by elimination without pivoting: the matrix is positive definite.
PDEANIM_MULTIVERSION void solve_chains(const Places &places, const DistanceSlots &slots, std::size_t links,
                                       std::size_t count, const Scaling &scaling, Link *row) {
    // The share of the diagonal under which a pivot is rounding: a straight rigid chain that is held at both ends has
    // one link too many, and that link is left as it is.
    constexpr double smallest_pivot = 1e-12;
    const auto [compliance, damping, _] = scaling;
    for (std::size_t slot = 0; slot < count; ++slot) {
        const i32 *points = slots.members + slot * (links + 1) * slot_size;
        const double *rest = slots.lengths + slot * links * slot_size;
        double *multipliers = slots.multipliers + slot * links * slot_size;
        Slot pivot{};
        Looked from = look(places, points);
        for (std::size_t i = 0; i < links; ++i) {
            Link &link = row[i];
            const Looked to = look(places, points + (i + 1) * slot_size);
            link.mass = from.mass;
            for (int axis = 0; axis < 3; ++axis) link.direction.axes[axis] = to.now.axes[axis] - from.now.axes[axis];
            const Slot length = square_roots(dot(link.direction, link.direction));
            const Slot inverse = where_positive(length, 1.0 / length);
            Vectors moved{};
            for (int axis = 0; axis < 3; ++axis) {
                link.direction.axes[axis] = link.direction.axes[axis] * inverse;
                moved.axes[axis] =
                    to.now.axes[axis] - to.before.axes[axis] - from.now.axes[axis] + from.before.axes[axis];
            }
            const auto &multiplier = lanes_at<slot_size>(multipliers + i * slot_size);
            link.right = lanes_at<slot_size>(rest + i * slot_size) - length - compliance * multiplier -
                         damping * dot(link.direction, moved);
            const Slot directed = where_positive(length, Slot{} + (1.0 + damping));
            const Slot full = directed * (from.mass + to.mass) + compliance;
            Slot diagonal = full;
            if (i > 0) {
                const Slot coupling = -(1.0 + damping) * from.mass * dot(row[i - 1].direction, link.direction);
                row[i - 1].upper = coupling * pivot;
                diagonal -= coupling * row[i - 1].upper;
                link.right -= coupling * row[i - 1].right;
            }
            pivot = where_positive(diagonal - smallest_pivot * full, 1.0 / diagonal);
            link.right = link.right * pivot;
            from = to;
        }
        Slot change{};
        for (std::size_t i = links; i-- > 0;) {
            row[i].right = i + 1 < links ? row[i].right - row[i].upper * change : row[i].right;
            change = row[i].right;
        }
        Vectors step{};
        for (std::size_t i = 0; i <= links; ++i) {  // Eq. 7, for each point the link before it first
            const i32 *particles = points + i * slot_size;
            Vectors at = vectors(places.positions, particles);
            const Slot inverse_mass = i < links ? row[i].mass : from.mass;
            if (i > 0) {
                for (int axis = 0; axis < 3; ++axis) at.axes[axis] += inverse_mass * step.axes[axis];
            }
            if (i < links) {
                lanes_at<slot_size>(multipliers + i * slot_size) += row[i].right;  // Eq. 6
                for (int axis = 0; axis < 3; ++axis) {
                    step.axes[axis] = row[i].direction.axes[axis] * row[i].right;
                    at.axes[axis] -= inverse_mass * step.axes[axis];
                }
            }
            for (int lane = 0; lane < slot_size; ++lane) {
                Place &place = places.positions[particles[lane]];
                for (int axis = 0; axis < 3; ++axis) place.at[axis] = at.axes[axis][lane];
            }
        }
    }
}

class Chains : public SlottedBatch {
public:
    Chains(std::size_t links, std::span<const i32> chains, i32 filler, std::span<const double> lengths,
           std::span<double> multipliers, const Scaling &scaling)
        : SlottedBatch(chains, links + 1, filler, multipliers, links, scaling), links_(links),
          lengths_(slotted(lengths, links, 0.0)), row_(links) {}

    void solve(const Places &places) override {
        const DistanceSlots slots{members_.data(), lengths_.data(), multipliers_.data()};
        solve_chains(places, slots, links_, slot_count(), scaling_, row_.data());
    }

private:
    std::size_t links_;
    std::vector<double> lengths_;
    std::vector<Link> row_;
};

}  // namespace

std::unique_ptr<Batch> make_distances(std::span<const i32> pairs, i32 filler, std::span<const double> lengths,
                                      std::span<double> multipliers, const Scaling &scaling) {
    return std::make_unique<Distances>(pairs, filler, lengths, multipliers, scaling);
}

std::unique_ptr<Batch> make_chains(std::size_t links, std::span<const i32> chains, i32 filler,
                                   std::span<const double> lengths, std::span<double> multipliers,
                                   const Scaling &scaling) {
    return std::make_unique<Chains>(links, chains, filler, lengths, multipliers, scaling);
}

}  // namespace pdeanim::xpbd
