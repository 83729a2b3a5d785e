// Positions, velocities and accelerations of the vertices, at any times; and what they are sums of.
#pragma once

#include <array>
#include <deque>
#include <optional>
#include <vector>

#include "decode/evaluate/spline.hpp"
#include "decode/group_cache.hpp"

namespace pdeanim {

enum class Quantity { positions, velocities, accelerations };

// What a vertex at a frame lacks, if it is not what the model decodes to.
struct Correction {
    i32 frame, vertex;
    std::array<float, 3> offset;  // [scene units]
};

// The residuals of one frame, and what raw vertices among them stand in place of.
struct FrameResiduals {
    const Residuals &group;
    i64 inside;                  // the frame's number in its group
    std::vector<Position> base;  // what the model alone decodes to; empty where there is no raw vertex
};

// Its public functions may be called from several threads, which take turns, but for the last two: whoever holds the turn
// calls these.
class Evaluator {
public:
    // All of them must outlive it.
    Evaluator(RunSections &run, GroupCache &groups, Turns &turns) : run_(run), groups_(groups), turns_(turns) {}

    // A quantity of all vertices, or of one object's, at times [s] in any order: out is (times, vertices, 3). Outside the
    // clip its first or last frame stands still. ArgumentError for a time that is not a number.
    void evaluate(Quantity quantity, std::span<const double> times, std::optional<i64> object, std::span<float> out);

    // Groups that count at a time: the first, and one behind the last. Nothing is decoded for it.
    std::pair<std::size_t, std::size_t> groups_at(Quantity quantity, double time);

    // What the functions of time of one group count: (time axes, functions).
    std::vector<double> weights(Quantity quantity, double time, std::size_t group);

    FrameResiduals residuals_at(i64 frame);
    ResidualScale residual_scale();

private:
    // Groups, and what their functions of time count at a time.
    using CountingGroups = std::vector<std::pair<std::size_t, std::vector<double>>>;
    struct Tile;

    template <class Real> const AnchoredReference<Real> &anchored();
    template <class Work> void with_motion(const DecodedGroup &own, const Work &work);
    int levels_of(i64 bytes, i64 positions) const;
    template <class Work> void in_parts(i64 bytes, const Work &work) const;
    template <class Real, class Out> void evaluate_once(const Motion<Real> &motion, std::span<const double> weights,
                                                        const AnchoredReference<Real> *reference, Out out) const;
    void evaluate_model(const DecodedGroup &own, i64 frame, std::span<float> out);
    FrameShares frame_shares(double time, int derivative);
    const std::vector<ClosedForm> &closed_forms();
    std::pair<std::size_t, std::size_t> counting_groups(double time, int derivative);
    std::vector<double> weights_of_group(std::size_t group, double time, int derivative);
    bool is_outside(Quantity quantity, double time) const;
    std::optional<i64> frame_of_positions(Quantity quantity, double time) const;
    template <class Real> void evaluate_in(const CountingGroups &counting, int derivative, std::span<float> out);
    void evaluate_groups(double time, int derivative, std::span<float> out);
    std::deque<Tile> tiles_of(i64 first, i64 count);
    void evaluate_part(Tile &tile, VertexShare share, const ResidualScale &scale, std::span<float> out);
    i64 evaluate_frames(i64 first, i64 count, std::span<float> out);
    void evaluate_between(double time, std::span<float> out);
    void evaluate_derivative(int derivative, double time, std::span<float> out);
    void evaluate_all(Quantity quantity, std::span<const double> sorted, std::span<float> out);

    RunSections &run_;
    GroupCache &groups_;
    Turns &turns_;
    std::optional<AnchoredReference<float>> anchored_single_;  // of the reference frame, for groups of either precision
    std::optional<AnchoredReference<double>> anchored_double_;
    std::optional<BrokenSpline> spline_;
    std::vector<ClosedForm> closed_forms_;
};

// For those who add up themselves what fields of space count (a GPU): a quantity at a time is, of all groups, the sum over
// functions of time of their weights (Evaluator::weights) times their fields; positions have the reference frame added,
// and what corrections there are.
class GroupFields {
public:
    GroupFields(RunSections &run, GroupCache &groups, Evaluator &evaluator, Turns &turns)
        : run_(run), groups_(groups), evaluator_(evaluator), turns_(turns) {}

    // Fields of one group [scene units]: out is (functions, vertices, axes), with 1 axis or 3.
    void fields(std::size_t group, std::span<float> out);

    // Coefficients of one group [scene units]: (functions of space, functions of time, axes).
    std::vector<double> coefficients(std::size_t group);

    // What the model lacks at the frames of one group, frame after frame. `taken`: memory that they take, from now on.
    std::vector<Correction> corrections(std::size_t group, TakenMemory &taken);

    // The element, a patch or a piece of a curve, that each vertex belongs to.
    std::vector<i32> elements();

private:
    RunSections &run_;
    GroupCache &groups_;
    Evaluator &evaluator_;
    Turns &turns_;
};

}  // namespace pdeanim
