// Batches of which sheets and ropes are made, swept with several constraints side by side.
//
// What comes out is what taking one constraint after another gives, to the last bit (slots.hpp): in the given order, but
// of a sheet in two halves those within the halves come first in each batch, and then those across its middle. So
// two threads can take a half each, whose particles stay in their caches, and meet only around what is in between. The
// order is that of the halves, not of the threads: one alone gives the same bits.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "base/lanes.hpp"
#include "simulate/sweeps.hpp"

namespace pdeanim::xpbd {

// A point in a vector register. The fourth number of a present position means nothing; that of a previous one is the
// particle's inverse mass.
struct alignas(32) Place {
    double at[4];
};

using Register = Lanes<double, 4>;

struct Places {
    Place *positions;
    const Place *previous;
};

// Which particles are of which half: those before the middle are of the first, 0, the others of the second. What is whole
// has its middle at its end.
struct Halves {
    i32 particles, middle;

    int of(i32 particle) const { return particle >= middle ? 1 : 0; }
    // A particle behind the last one, without mass to move; that of each half is in a cache line of its own.
    i32 filler(int half) const { return particles + 2 * half; }
    std::array<std::size_t, 2> range(int half) const {
        const auto start = static_cast<std::size_t>(half == 0 ? 0 : middle);
        return {start, static_cast<std::size_t>(half == 0 ? middle : particles)};
    }
    std::size_t places() const { return static_cast<std::size_t>(particles) + 4; }
};

class Batch {
public:
    virtual ~Batch() = default;
    // A batch is solved in stages. Halves may be taken at the same time in each; none begins before both have ended the
    // one before.
    virtual int stages() const = 0;
    virtual void solve(const Places &places, int stage, int half) = 0;
    // Multipliers are what stands in the caller's array at first; they are set to 0, or written there.
    virtual void clear(int half) = 0;
    virtual void store() = 0;
};

std::unique_ptr<Batch> make_distances(std::span<const i32> pairs, const Halves &halves, std::span<const double> lengths,
                                      std::span<double> multipliers, std::span<const double> inverse_masses,
                                      const Scaling &scaling);

// Chains of `links` links each, all links of one chain at once; relaxation is not used. Those that lie in both halves
// cross the middle once, from the first half, all at the same link; else std::invalid_argument.
std::unique_ptr<Batch> make_chains(std::size_t links, std::span<const i32> chains, const Halves &halves,
                                   std::span<const double> lengths, std::span<double> multipliers,
                                   const Scaling &scaling);

std::unique_ptr<Batch> make_bending(std::span<const i32> stencils, const Halves &halves,
                                    std::span<const double> coefficients, std::span<double> multipliers,
                                    std::span<const double> inverse_masses, const Scaling &scaling);

// Batches that are solved in turn.
class Sheets {
public:
    // `middle`: the first particle of the second half.
    Sheets(std::span<const double> inverse_masses, i32 middle);
    Sheets(const Sheets &) = delete;  // batches have one owner

    std::size_t particles() const { return inverse_masses_.size(); }
    const Halves &halves() const { return halves_; }
    std::span<const double> inverse_masses() const { return inverse_masses_; }
    void add(std::unique_ptr<Batch> batch) { batches_.push_back(std::move(batch)); }

    // One iteration over all batches; `is_first`: multipliers start from 0.
    void solve(std::span<Point> positions, std::span<const Point> previous, bool is_first);
    // So many substeps of Algorithm 1, one or more, with the share `keep` of the velocities in Eq. 4.
    void advance(std::span<Point> positions, std::span<Point> previous, std::span<Point> velocities,
                 std::span<const Point> accelerations, double substep, double keep, i64 substeps, i64 iterations,
                 int threads);
    // Multipliers are written to the arrays that they came from.
    void store();

private:
    void take(std::span<const Point> positions, std::span<const Point> previous);

    std::vector<double> inverse_masses_;
    Halves halves_;
    std::vector<Place> positions_, previous_;
    std::vector<std::unique_ptr<Batch>> batches_;
};

}  // namespace pdeanim::xpbd
