#include "simulate/sheets.hpp"

#include <algorithm>
#include <atomic>
#include <thread>

#include "base/lanes.hpp"

namespace pdeanim::xpbd {

namespace {

// Fills slots of constraints: each constraint gets the first free place from its earliest slot on.
class Timetable {
public:
    // Return the first place in slot `earliest` or later that is still free.
    i32 enter(i32 earliest) {
        const i32 slot = open_from(earliest), place = slot * slot_size + taken_[slot]++;
        if (taken_[slot] == slot_size) next_[slot] = slot + 1;
        return place;
    }
    std::size_t slots() const { return next_.size(); }

private:
    i32 open_from(i32 slot) {
        while (true) {
            while (static_cast<i32>(next_.size()) <= slot) {
                next_.push_back(static_cast<i32>(next_.size()));
                taken_.push_back(0);
            }
            if (next_[slot] == slot) return slot;
            const i32 ahead = next_[slot];
            if (ahead < static_cast<i32>(next_.size())) next_[slot] = next_[ahead];
            slot = ahead;
        }
    }

    std::vector<i32> next_, taken_;  // next_: for each slot, itself if it has free places, else a later slot
};

Group group_of(std::span<const i32> particles, const Halves &halves) {
    const int half = halves.of(particles[0]);
    const bool is_within =
        std::all_of(particles.begin(), particles.end(), [&](i32 one) { return halves.of(one) == half; });
    return is_within ? within(half) : between;
}

// Order constraints in rounds: within a round no two constraints share a particle.
std::vector<std::size_t> in_rounds(std::vector<std::size_t> left, std::span<const i32> members, std::size_t each,
                                   const Halves &halves) {
    std::vector<std::size_t> order, later;
    std::vector<std::size_t> last_moved(static_cast<std::size_t>(halves.particles), 0);
    for (std::size_t round = 1; !left.empty(); ++round, left.swap(later), later.clear()) {
        for (const std::size_t i : left) {
            const auto own = members.subspan(i * each, each);
            const bool is_free =
                std::none_of(own.begin(), own.end(), [&](i32 one) { return last_moved[one] == round; });
            (is_free ? order : later).push_back(i);
            for (const i32 particle : own) {
                if (is_free) last_moved[particle] = round;
            }
        }
    }
    return order;
}

}  // namespace

Slots make_slots(std::span<const i32> members, std::size_t each, const Halves &halves) {
    std::array<std::vector<std::size_t>, group_count> groups;
    for (std::size_t i = 0; i < members.size() / each; ++i) {
        groups[group_of(members.subspan(i * each, each), halves)].push_back(i);
    }
    // Constraints across the middle are few and close together: in the given order, hardly any two could be solved side
    // by side.
    groups[between] = in_rounds(std::move(groups[between]), members, each, halves);
    Slots slots;
    std::vector<i32> free(static_cast<std::size_t>(halves.particles),
                          0);  // for each particle, the first slot after its constraints so far
    for (const Group group : {within_first, within_second, between}) {
        if (group == between) std::fill(free.begin(), free.end(), 0);
        Timetable table;
        std::vector<i32> places;
        for (const std::size_t i : groups[group]) {
            const auto own = members.subspan(i * each, each);
            i32 earliest = 0;
            for (const i32 particle : own) earliest = most(earliest, free[particle]);
            places.push_back(table.enter(earliest));
            for (const i32 particle : own) free[particle] = places.back() / slot_size + 1;
        }
        const std::size_t start = slots.items.size();
        slots.items.resize(start + table.slots() * slot_size, -1);
        for (std::size_t k = 0; k < places.size(); ++k)
            slots.items[start + places[k]] = static_cast<i32>(groups[group][k]);
        slots.starts[group + 1] = slots.items.size() / slot_size;
    }
    return slots;
}

namespace {

// Apply Eq. 4 with the velocities that the last substep left: x^n - x^(n-1) over the substep.
void predict_again(Place *positions, Place *previous, const Point *accelerations, std::size_t count, double substep,
                   double keep) {
    in_wide([&](auto) PDEANIM_INLINE_LAMBDA {
        for (std::size_t i = 0; i < count; ++i) {
            const double inverse_mass = previous[i].at[3];
            Register present = lanes_at<4>(positions[i].at);
            present[3] = 0.0;
            const Register velocity = (present - lanes_at<4>(previous[i].at)) / substep;
            Register acceleration{};
            for (int axis = 0; axis < 3; ++axis) acceleration[axis] = accelerations[i][axis];
            put_lanes(previous[i].at, present);
            previous[i].at[3] = inverse_mass;
            if (inverse_mass > 0.0) present += substep * (keep * velocity + substep * acceleration);
            put_lanes(positions[i].at, present);
        }
    });
}

// A barrier at which two threads meet repeatedly. Stages are short, so threads spin for a while before they sleep.
class Rendezvous {
public:
    void wait() {
        // Number of spins, some hundred microseconds: longer than one thread waits for the other, and than waking up
        // takes.
        constexpr int looks = 300'000;
        const int round = round_.load(std::memory_order_relaxed);
        if (arrived_.fetch_add(1, std::memory_order_acq_rel) == 1) {
            arrived_.store(0, std::memory_order_relaxed);
            round_.store(round + 1, std::memory_order_release);
            round_.notify_one();
            return;
        }
        for (int look = 0; look < looks; ++look) {
            if (round_.load(std::memory_order_acquire) != round) return;
        }
        round_.wait(round, std::memory_order_acquire);
    }

private:
    std::atomic<int> arrived_ = 0, round_ = 0;
};

}  // namespace

Sheets::Sheets(std::span<const double> inverse_masses, i32 middle)
    : inverse_masses_(inverse_masses.begin(), inverse_masses.end()),
      halves_{static_cast<i32>(inverse_masses.size()), middle}, positions_(halves_.places()),
      previous_(halves_.places()) {}

void Sheets::take(std::span<const Point> positions, std::span<const Point> previous) {
    for (std::size_t i = 0; i < positions.size(); ++i) {
        positions_[i] = {positions[i][0], positions[i][1], positions[i][2], 0.0};
        previous_[i] = {previous[i][0], previous[i][1], previous[i][2], inverse_masses_[i]};
    }
}

void Sheets::solve(std::span<Point> positions, std::span<const Point> previous, bool is_first) {
    take(positions, previous);
    for (const auto &batch : batches_) {
        for (int half = 0; half < 2 && is_first; ++half) batch->clear(half);
        for (int stage = 0; stage < batch->stages(); ++stage) {
            for (int half = 0; half < 2; ++half) batch->solve({positions_.data(), previous_.data()}, stage, half);
        }
    }
    for (std::size_t i = 0; i < positions.size(); ++i) std::copy_n(positions_[i].at, 3, positions[i].begin());
}

void Sheets::advance(std::span<Point> positions, std::span<Point> previous, std::span<Point> velocities,
                     std::span<const Point> accelerations, double substep, double keep, i64 substeps, i64 iterations,
                     int threads) {
    predict(positions, previous, inverse_masses_, velocities, accelerations, substep, keep);  // line 1
    take(positions, previous);
    // Do the work of the halves `first` to `last`. After `meet` returns, all work before it is done in both halves.
    const auto go_on = [&](int first, int last, const auto &meet) {
        for (i64 done = 0; done < substeps; ++done) {
            for (int half = first; half <= last; ++half) {
                const auto [begin, end] = halves_.range(half);
                if (done > 0) {
                    predict_again(&positions_[begin], &previous_[begin], &accelerations[begin], end - begin, substep,
                                  keep);
                }
                for (const auto &batch : batches_) batch->clear(half);
            }
            for (i64 iteration = 0; iteration < iterations; ++iteration) {  // line 2
                for (const auto &batch : batches_) {                        // lines 3 to 6
                    for (int stage = 0; stage < batch->stages(); ++stage) {
                        for (int half = first; half <= last; ++half) {
                            batch->solve({positions_.data(), previous_.data()}, stage, half);
                        }
                        meet();
                    }
                }
            }
        }
    };
    if (threads < 2 || halves_.middle == halves_.particles) {
        go_on(0, 1, [] {});
    } else {
        Rendezvous rendezvous;
        const std::jthread other([&] { go_on(1, 1, [&] { rendezvous.wait(); }); });
        go_on(0, 0, [&] { rendezvous.wait(); });
    }
    for (std::size_t i = 0; i < positions.size(); ++i) {
        for (int axis = 0; axis < 3; ++axis) {
            positions[i][axis] = positions_[i].at[axis];
            previous[i][axis] = previous_[i].at[axis];
            velocities[i][axis] = (positions[i][axis] - previous[i][axis]) / substep;  // line 9
        }
    }
}

void Sheets::store() {
    for (const auto &batch : batches_) batch->store();
}

}  // namespace pdeanim::xpbd
