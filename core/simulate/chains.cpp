#include <stdexcept>

#include "base/lanes.hpp"
#include "simulate/sheets.hpp"

namespace pdeanim::xpbd {

namespace {

// One link of each of a slot's chains: its equation, in a matrix that is eliminated from both ends of the chain.
struct Link {
    StoredSlot direction[3];
    // coupling: during elimination, the entry that couples this link to the next one towards the meeting point, divided
    // by the pivot; after substitution, the change of the multiplier (Eq. 6). right: right-hand side of the equation so
    // far.
    StoredSlot coupling, right, mass;  // mass: inverse mass of its first point
};

// Where elimination from both ends meets: the diagonal of the last link that the first end has eliminated, before and
// after, and the inverse pivot of the link beyond it, which the other end has reached.
struct Meeting {
    StoredSlot full, diagonal, beyond;
};

template <class Slot> PDEANIM_INLINE Vectors<Slot> direction_of(const Link &link) {
    return {link.direction[0], link.direction[1], link.direction[2]};
}

// Position, previous position and inverse mass of one point in each of a slot's chains.
template <class Slot> struct Looked {
    Vectors<Slot> now, before;
    Slot mass;
};

// The chains of a slot, or their part in one half: a number of links, and one point more than links.
struct ChainSlot {
    const i32 *points;
    const double *lengths;
    double *multipliers;
    std::size_t links;
};

// A pivot below this fraction of the diagonal is only rounding error. A straight rigid chain that is held at both ends
// has one link too many; that link is left unchanged.
constexpr double smallest_pivot = 1e-12;

template <class Slot> PDEANIM_INLINE Slot inverse_pivot(const Slot &diagonal, const Slot &full) {
    return where_positive(diagonal - smallest_pivot * full, 1.0 / diagonal);
}

template <class Slot> PDEANIM_INLINE Looked<Slot> look(const Places &places, const i32 *points) {
    return {vectors<Slot>(places.positions, points), vectors<Slot>(places.previous, points),
            masses<Slot>(places, points)};
}

// The equation of a link before elimination; `full` is its diagonal.
template <class Slot> struct Measured {
    Vectors<Slot> direction;
    Slot right, mass, full;
};

template <class Slot> PDEANIM_INLINE Measured<Slot> measure(const Looked<Slot> &from, const Looked<Slot> &to,
                                                            const ChainSlot &chain, std::size_t i,
                                                            const Scaling &scaling) {
    Vectors<Slot> direction{}, moved{};
    for (int axis = 0; axis < 3; ++axis) direction.axes[axis] = to.now.axes[axis] - from.now.axes[axis];
    const Slot length = square_roots(dot(direction, direction));
    const Slot inverse = where_positive(length, 1.0 / length);
    for (int axis = 0; axis < 3; ++axis) {
        direction.axes[axis] = direction.axes[axis] * inverse;
        moved.axes[axis] = to.now.axes[axis] - to.before.axes[axis] - from.now.axes[axis] + from.before.axes[axis];
    }
    const Slot multiplier = Slot::at(chain.multipliers + i * slot_size);
    const Slot right = Slot::at(chain.lengths + i * slot_size) - length - scaling.compliance * multiplier -
                       scaling.damping * dot(direction, moved);
    const Slot directed = where_positive(length, Slot::all(1.0 + scaling.damping));
    return {direction, right, from.mass, directed * (from.mass + to.mass) + scaling.compliance};
}

template <class Slot> PDEANIM_INLINE void store(Link &link, const Measured<Slot> &own) {
    for (int axis = 0; axis < 3; ++axis) link.direction[axis] = own.direction.axes[axis];
    link.right = own.right;
    link.mass = own.mass;
}

// Return the matrix entry of two consecutive links; `mass` is the inverse mass of the point between them.
template <class Slot> PDEANIM_INLINE Slot coupling_of(const Vectors<Slot> &direction, const Vectors<Slot> &next,
                                                      const Slot &mass, const Scaling &scaling) {
    return -(1.0 + scaling.damping) * mass * dot(direction, next);
}

// Eliminate from the first link to the last, whose pivot waits for the elimination from the other end.
template <class Slot> PDEANIM_INLINE void eliminate_forwards(const Places &places, const ChainSlot &chain,
                                                             const Scaling &scaling, Link *row, Meeting &meeting) {
    Slot pivot{};
    Measured<Slot> before{};
    Looked from = look<Slot>(places, chain.points);
    for (std::size_t i = 0; i < chain.links; ++i) {
        const Looked to = look<Slot>(places, chain.points + (i + 1) * slot_size);
        Measured<Slot> own = measure(from, to, chain, i, scaling);
        Slot diagonal = own.full;
        if (i > 0) {
            const Slot coupling = coupling_of(before.direction, own.direction, own.mass, scaling);
            const Slot share = coupling * pivot;
            row[i - 1].coupling = share;
            diagonal -= coupling * share;
            own.right -= coupling * before.right;
        }
        if (i + 1 < chain.links) {
            pivot = inverse_pivot(diagonal, own.full);
            own.right = own.right * pivot;
        } else {
            meeting.full = own.full;
            meeting.diagonal = diagonal;
        }
        store(row[i], own);
        before = own;
        from = to;
    }
}

// Eliminate from the last link to the first.
template <class Slot> PDEANIM_INLINE void eliminate_backwards(const Places &places, const ChainSlot &chain,
                                                              const Scaling &scaling, Link *row, Meeting &meeting) {
    Slot pivot{};
    Measured<Slot> behind{};
    Looked to = look<Slot>(places, chain.points + chain.links * slot_size);
    for (std::size_t i = chain.links; i-- > 0;) {
        const Looked from = look<Slot>(places, chain.points + i * slot_size);
        Measured<Slot> own = measure(from, to, chain, i, scaling);
        Slot diagonal = own.full;
        if (i + 1 < chain.links) {
            const Slot coupling = coupling_of(own.direction, behind.direction, behind.mass, scaling);
            const Slot share = coupling * pivot;
            row[i + 1].coupling = share;
            diagonal -= coupling * share;
            own.right -= coupling * behind.right;
        }
        pivot = inverse_pivot(diagonal, own.full);
        own.right = own.right * pivot;
        store(row[i], own);
        behind = own;
        to = from;
    }
    meeting.beyond = pivot;
}

template <class Slot> struct Met {
    Slot change, coupling;  // change of the last link's multiplier, and the coupling of that link to the link beyond it
};

// Solve for the link where elimination from both ends meets. beyond: the link after `link`, which the other end has
// reached; null if there is none.
template <class Slot>
PDEANIM_INLINE Met<Slot> meet(const Link &link, const Link *beyond, const Scaling &scaling, const Meeting &meeting) {
    Slot diagonal = meeting.diagonal, right = link.right, share{};
    if (beyond) {
        const Slot coupling =
            coupling_of<Slot>(direction_of<Slot>(link), direction_of<Slot>(*beyond), beyond->mass, scaling);
        share = coupling * meeting.beyond;
        diagonal -= coupling * share;
        right -= coupling * beyond->right;
    }
    return {right * inverse_pivot<Slot>(diagonal, meeting.full), share};
}

// Move the points before `end` (Eq. 7), each by the links before and after it, and change the multipliers of the links
// after them (Eq. 6). step: the motion that the link before the first point causes.
template <class Slot> PDEANIM_INLINE void move_points(const Places &places, const ChainSlot &chain, std::size_t end,
                                                      const Link *row, Vectors<Slot> step) {
    for (std::size_t i = 0; i < end; ++i) {
        const i32 *particles = chain.points + i * slot_size;
        Vectors<Slot> at = vectors<Slot>(places.positions, particles);
        const Slot inverse_mass = i < chain.links ? Slot(row[i].mass) : masses<Slot>(places, particles);
        for (int axis = 0; axis < 3; ++axis) at.axes[axis] += inverse_mass * step.axes[axis];
        if (i < chain.links) {
            double *const multipliers = chain.multipliers + i * slot_size;
            const Slot change = row[i].coupling;
            (Slot::at(multipliers) + change).put(multipliers);  // Eq. 6
            const Vectors<Slot> direction = direction_of<Slot>(row[i]);
            for (int axis = 0; axis < 3; ++axis) {
                step.axes[axis] = direction.axes[axis] * change;
                at.axes[axis] -= inverse_mass * step.axes[axis];
            }
        }
        for (int lane = 0; lane < slot_size; ++lane) {
            Place &place = places.positions[particles[lane]];
            for (int axis = 0; axis < 3; ++axis) place.at[axis] = at.axes[axis][lane];
        }
    }
}

// Compute the changes of links from the last to the first, and move the points before `end`.
template <class Slot> PDEANIM_INLINE void substitute_backwards(const Places &places, const ChainSlot &chain,
                                                               std::size_t end, Link *row, const Met<Slot> &met) {
    Slot change = met.change;
    row[chain.links - 1].coupling = change;
    for (std::size_t i = chain.links - 1; i-- > 0;) {
        change = row[i].right - change * row[i].coupling;
        row[i].coupling = change;
    }
    move_points<Slot>(places, chain, end, row, {});
}

// Compute the changes of the links after `link`, and move the points after it. Data that the other half reads stay
// unchanged.
template <class Slot> PDEANIM_INLINE void substitute_forwards(const Places &places, const ChainSlot &chain,
                                                              const Link &link, Link *row, const Met<Slot> &met) {
    Slot change = met.change;
    for (std::size_t i = 0; i < chain.links; ++i) {
        const Slot coupling = i == 0 ? met.coupling : Slot(row[i].coupling);
        change = row[i].right - coupling * change;
        row[i].coupling = change;
    }
    Vectors<Slot> step = direction_of<Slot>(link);
    for (Slot &axis : step.axes) axis = axis * met.change;
    move_points(places, chain, chain.links + 1, row, step);
}

// Apply Eqs. 6 and 7 to all links of a chain at once, for one slot of chains after another. Elimination needs no
// pivoting: the matrix is positive definite.
void solve_chains(const Places &places, const DistanceSlots &slots, std::size_t links, std::size_t count,
                  const Scaling &scaling, Link *row) {
    in_wide([&](auto bytes) PDEANIM_INLINE_LAMBDA {
        using Slot = xpbd::Slot<bytes>;
        for (std::size_t slot = 0; slot < count; ++slot) {
            const ChainSlot chain{slots.members + slot * (links + 1) * slot_size,
                                  slots.lengths + slot * links * slot_size,
                                  slots.multipliers + slot * links * slot_size, links};
            Meeting meeting{};
            eliminate_forwards<Slot>(places, chain, scaling, row, meeting);
            substitute_backwards<Slot>(places, chain, links + 1, row,
                                       meet<Slot>(row[links - 1], nullptr, scaling, meeting));
        }
    });
}

// Chains that lie in both halves; `last` is the link across the middle, which belongs to the first half. Data that the
// two threads write are kept apart, because processors prefetch neighbouring memory and would take it from each other.
struct Divided {
    struct Half {
        std::size_t links;
        std::vector<double> multipliers;
        std::vector<Link> rows;
    };

    Divided(std::size_t links, std::size_t last, std::size_t slots) : links(links), last(last), meetings(slots) {
        const std::array<std::size_t, 2> own{last + 1, links - last - 1};
        for (int half = 0; half < 2; ++half) {
            halves[half] = {own[half], std::vector<double>(slots * own[half] * slot_size),
                            std::vector<Link>(slots * own[half])};
        }
    }

    // Return the multiplier of a link of the slot's first chain; those of the other chains follow it.
    double &multiplier(std::size_t slot, std::size_t link) {
        Half &half = halves[link > last ? 1 : 0];
        return half.multipliers[(slot * half.links + (link > last ? link - last - 1 : link)) * slot_size];
    }

    std::size_t links, last;
    std::array<Half, 2> halves;
    std::vector<Meeting> meetings;
};

PDEANIM_INLINE ChainSlot chain_of(Divided &divided, const DistanceSlots &slots, std::size_t slot, int half) {
    Divided::Half &own = divided.halves[half];
    const std::size_t first = half == 0 ? 0 : divided.last + 1;
    return {slots.members + (slot * (divided.links + 1) + first) * slot_size,
            slots.lengths + (slot * divided.links + first) * slot_size,
            own.multipliers.data() + slot * own.links * slot_size, own.links};
}

// Eliminate one half of the chains that lie in both halves.
void eliminate_half(const Places &places, const DistanceSlots &slots, Divided &divided, const Scaling &scaling,
                    int half) {
    in_wide([&](auto bytes) PDEANIM_INLINE_LAMBDA {
        using Slot = xpbd::Slot<bytes>;
        Link *row = divided.halves[half].rows.data();
        for (std::size_t slot = 0; slot < divided.meetings.size(); ++slot) {
            const ChainSlot chain = chain_of(divided, slots, slot, half);
            if (half == 0) {
                eliminate_forwards<Slot>(places, chain, scaling, row, divided.meetings[slot]);
            } else {
                eliminate_backwards<Slot>(places, chain, scaling, row, divided.meetings[slot]);
            }
            row += chain.links;
        }
    });
}

// Substitute in one half, once `eliminate_half` is done for both halves.
void substitute_half(const Places &places, const DistanceSlots &slots, Divided &divided, const Scaling &scaling,
                     int half) {
    in_wide([&](auto bytes) PDEANIM_INLINE_LAMBDA {
        using Slot = xpbd::Slot<bytes>;
        auto &[first, second] = divided.halves;
        for (std::size_t slot = 0; slot < divided.meetings.size(); ++slot) {
            const ChainSlot chain = chain_of(divided, slots, slot, half);
            Link *before = first.rows.data() + slot * first.links, *behind = second.rows.data() + slot * second.links;
            const Link &link = before[divided.last];
            const Met met = meet<Slot>(link, second.links > 0 ? behind : nullptr, scaling, divided.meetings[slot]);
            if (half == 0) {
                substitute_backwards<Slot>(places, chain, chain.links, before, met);
            } else {
                substitute_forwards(places, chain, link, behind, met);
            }
        }
    });
}

// Return the link at which all chains that lie in both halves cross from the first half to the second.
std::size_t crossing(std::span<const i32> chains, std::size_t points, const Halves &halves) {
    std::size_t found = 0;
    for (std::size_t start = 0; start < chains.size(); start += points) {
        const auto chain = chains.subspan(start, points);
        const auto is_first = [&](i32 particle) { return halves.of(particle) == 0; };
        const auto end = std::find_if_not(chain.begin(), chain.end(), is_first);
        if (end == chain.end() || std::none_of(chain.begin(), chain.end(), is_first)) continue;
        const std::size_t before = static_cast<std::size_t>(end - chain.begin());
        if (before == 0 || std::any_of(end, chain.end(), is_first) || (found > 0 && before != found)) {
            throw std::invalid_argument("all chains must cross the middle of a sheet once, at the same link");
        }
        found = before;
    }
    return found > 0 ? found - 1 : 0;
}

class Chains : public SlottedBatch {
public:
    Chains(std::size_t links, std::span<const i32> chains, const Halves &halves, std::span<const double> lengths,
           std::span<double> multipliers, const Scaling &scaling)
        : SlottedBatch(chains, links + 1, halves, multipliers, links, scaling), links_(links),
          lengths_(slotted(lengths, links, 0.0)), divided_(links, crossing(chains, links + 1, halves), count(between)) {
        for (auto &row : rows_) row.resize(links);
        for (std::size_t slot = 0; slot < count(between); ++slot) {
            i32 *points = members_.data() + first_of(between, links + 1) + slot * (links + 1) * slot_size;
            std::replace(points + (divided_.last + 1) * slot_size, points + (links + 1) * slot_size, halves.filler(0),
                         halves.filler(1));
        }
        exchange([](double &own, double &common) { own = common; });
    }

    int stages() const override { return whole_stages() + (count(between) > 0 ? 2 : 0); }
    void solve(const Places &places, int stage, int half) override {
        if (stage < whole_stages()) {
            solve_group(places, within(half));
        } else if (stage == whole_stages()) {
            eliminate_half(places, slots_of(between), divided_, scaling_, half);
        } else {
            substitute_half(places, slots_of(between), divided_, scaling_, half);
        }
    }
    void clear(int half) override {
        clear_group(within(half));
        std::ranges::fill(divided_.halves[half].multipliers, 0.0);
    }
    void store() override {
        exchange([](double &own, double &common) { common = own; });
        SlottedBatch::store();
    }

protected:
    void solve_group(const Places &places, Group group) override {
        Link *row = rows_[group == within_first ? 0 : 1].data();
        solve_chains(places, slots_of(group), links_, count(group), scaling_, row);
    }

private:
    int whole_stages() const { return count(within_first) + count(within_second) > 0 ? 1 : 0; }
    DistanceSlots slots_of(Group group) {
        return {members_.data() + first_of(group, links_ + 1), lengths_.data() + first_of(group, links_),
                multipliers_of(group)};
    }
    // Call give(multiplier, index of this multiplier among those of all chains) for each link of the chains in both
    // halves.
    void exchange(const auto &give) {
        double *common = slots_of(between).multipliers;
        for (std::size_t slot = 0; slot < count(between); ++slot) {
            for (std::size_t link = 0; link < links_; ++link) {
                double *own = &divided_.multiplier(slot, link);
                for (int lane = 0; lane < slot_size; ++lane) give(*own++, *common++);
            }
        }
    }

    std::size_t links_;
    std::vector<double> lengths_;
    Divided divided_;
    std::array<std::vector<Link>, 2> rows_;
};

}  // namespace

std::unique_ptr<Batch> make_chains(std::size_t links, std::span<const i32> chains, const Halves &halves,
                                   std::span<const double> lengths, std::span<double> multipliers,
                                   const Scaling &scaling) {
    return std::make_unique<Chains>(links, chains, halves, lengths, multipliers, scaling);
}

}  // namespace pdeanim::xpbd
