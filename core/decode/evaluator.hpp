// Positions, velocities and accelerations of the vertices at any times, and the terms that add up to them.
#pragma once

#include <array>
#include <deque>
#include <optional>
#include <vector>

#include "decode/evaluate/spline.hpp"
#include "decode/group_cache.hpp"

namespace pdeanim {

enum class Quantity { positions, velocities, accelerations };

// A correction of a vertex at a frame: the decoded position minus the model's.
struct Correction {
    i32 frame, vertex;
    std::array<float, 3> offset;  // [scene units]
};

// The residuals of one frame, and the model's positions that its raw vertices replace.
struct FrameResiduals {
    const Residuals &group;
    i64 inside;                  // index of the frame in its group
    std::vector<Position> base;  // positions by the model alone; empty if no vertex is raw
};

// Public functions may be called from several threads, which take turns. The last four are exceptions: their caller
// holds the turn.
class Evaluator {
public:
    // The arguments must outlive this object.
    Evaluator(RunSections &run, GroupCache &groups, Turns &turns) : run_(run), groups_(groups), turns_(turns) {}

    // Evaluate a quantity of all vertices, or of the vertices of one object, at times [s] in any order: out is (times,
    // vertices, 3). Before the first frame and after the last one the mesh stands still. ArgumentError if a time is
    // NaN.
    void evaluate(Quantity quantity, std::span<const double> times, std::optional<i64> object, std::span<float> out);

    // Return the first and the end index of the groups that contribute at a time. Decodes nothing.
    std::pair<std::size_t, std::size_t> groups_at(Quantity quantity, double time);

    // Return the weights of one group's functions of time: (time axes, functions).
    std::vector<double> weights(Quantity quantity, double time, std::size_t group);

    // Evaluate a quantity of all vertices at a frame: out is (vertices, 3).
    void evaluate_frame(Quantity quantity, i64 frame, std::span<float> out) {
        evaluate_all(quantity, {&run_.times()[frame], 1}, out);
    }
    FrameResiduals residuals_at(i64 frame);
    ResidualScale residual_scale();
    const Patches &patches();

private:
    // Indices of groups, each with the weights of its functions of time at a time.
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
    void evaluate_part(Tile &tile, VertexShare share, const ResidualScale &scale, const Patches &patches,
                       std::span<float> out);
    i64 evaluate_frames(i64 first, i64 count, std::span<float> out);
    void evaluate_between(double time, std::span<float> out);
    void evaluate_derivative(int derivative, double time, std::span<float> out);
    void add_residual_velocities(double time, std::span<float> out);
    void evaluate_all(Quantity quantity, std::span<const double> sorted, std::span<float> out);

    RunSections &run_;
    GroupCache &groups_;
    Turns &turns_;
    std::optional<AnchoredReference<float>>
        anchored_single_;  // the reference frame in both precisions, which groups may need
    std::optional<AnchoredReference<double>> anchored_double_;
    std::optional<BrokenSpline> spline_;
    std::vector<ClosedForm> closed_forms_;
};

inline std::span<Position> as_positions(std::span<float> out) {
    return {reinterpret_cast<Position *>(out.data()), out.size() / 3};
}

// For callers that add up fields themselves (on a GPU). A quantity at a time is the sum, over all groups and functions
// of time, of weights (Evaluator::weights) times fields. For positions, the reference frame and corrections are added.
class GroupFields {
public:
    GroupFields(RunSections &run, GroupCache &groups, Evaluator &evaluator, Turns &turns)
        : run_(run), groups_(groups), evaluator_(evaluator), turns_(turns) {}

    // Write the fields of one group [scene units]: out is (functions, vertices, axes), with 1 axis or 3.
    void fields(std::size_t group, std::span<float> out);

    // Return the coefficients of one group [scene units]: (functions of space, functions of time, axes).
    std::vector<double> coefficients(std::size_t group);

    // Return the corrections at the frames of one group, frame by frame. Their memory is counted in `taken`.
    std::vector<Correction> corrections(std::size_t group, TakenMemory &taken);

    // Return the element, a patch or a piece of a curve, of each vertex.
    std::vector<i32> elements();

private:
    RunSections &run_;
    GroupCache &groups_;
    Evaluator &evaluator_;
    Turns &turns_;
};

}  // namespace pdeanim
