#include "simulate/sheets.hpp"

#include <algorithm>
#include <atomic>
#include <thread>

#include "base/lanes.hpp"

namespace pdeanim::xpbd {

namespace {

// Eq. 4, from the velocities that the last substep leaves: x^n - x^(n-1) over its length.
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

// Where two threads wait for each other, again and again: stages are short, so that they look for a while before they
// sleep.
class Rendezvous {
public:
    void wait() {
        // Some hundred microseconds: longer than stages of one differ from the other's, and than it takes to wake up.
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
    // What is done for the halves from `first` to `last`; what comes after `meet` needs what all have done before it.
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
