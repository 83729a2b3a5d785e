// Batches of which sheets and ropes are made, swept with several constraints side by side.
//
// What comes out is what taking one constraint after another in the given order gives, to the last bit (slots.hpp).
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "evaluate/lanes.hpp"
#include "xpbd/sweeps.hpp"

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

class Batch {
public:
    virtual ~Batch() = default;
    virtual void solve(const Places &places) = 0;
    // Multipliers are what stands in the caller's array at first; they are set to 0, or written there.
    virtual void clear() = 0;
    virtual void store() const = 0;
};

// `filler` is the particle behind the last one: it has no mass to move.
std::unique_ptr<Batch> make_distances(std::span<const i32> pairs, i32 filler, std::span<const double> lengths,
                                      std::span<double> multipliers, const Scaling &scaling);

// Chains of `links` links each, all links of one chain at once; relaxation is not used.
std::unique_ptr<Batch> make_chains(std::size_t links, std::span<const i32> chains, i32 filler,
                                   std::span<const double> lengths, std::span<double> multipliers,
                                   const Scaling &scaling);

std::unique_ptr<Batch> make_bending(std::span<const i32> stencils, i32 filler, std::span<const double> coefficients,
                                    std::span<double> multipliers, std::span<const double> inverse_masses,
                                    const Scaling &scaling);

// Batches that are solved in turn.
class Sheets {
public:
    explicit Sheets(std::span<const double> inverse_masses);
    Sheets(const Sheets &) = delete;  // batches have one owner

    std::size_t particles() const { return inverse_masses_.size(); }
    std::span<const double> inverse_masses() const { return inverse_masses_; }
    void add(std::unique_ptr<Batch> batch) { batches_.push_back(std::move(batch)); }

    // One iteration over all batches; `is_first`: multipliers start from 0.
    void solve(std::span<Point> positions, std::span<const Point> previous, bool is_first);
    // So many substeps of Algorithm 1, one or more, with the share `keep` of the velocities in Eq. 4.
    void advance(std::span<Point> positions, std::span<Point> previous, std::span<Point> velocities,
                 std::span<const Point> accelerations, double substep, double keep, i64 substeps, i64 iterations);
    // Multipliers are written to the arrays that they came from.
    void store() const;

private:
    void take(std::span<const Point> positions, std::span<const Point> previous);

    std::vector<double> inverse_masses_;
    std::vector<Place> positions_, previous_;
    std::vector<std::unique_ptr<Batch>> batches_;
};

}  // namespace pdeanim::xpbd
