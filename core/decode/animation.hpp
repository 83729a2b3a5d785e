// A run of frames of an open file, mostly all of them: owns its parts, and decodes each when it is first needed.
//
// From the bytes to a position: container -> sequence, table of groups, model (opening); connectivity -> reference frame ->
// space basis -> groups -> evaluation. Every public function may be called from several threads; they take turns.
#pragma once

#include <atomic>
#include <deque>
#include <list>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include "decode/container.hpp"
#include "decode/decoded_group.hpp"
#include "decode/evaluate/broken_spline.hpp"
#include "decode/file.hpp"
#include "decode/group_table.hpp"
#include "decode/groups_ahead.hpp"
#include "decode/model.hpp"
#include "sections/attributes/attributes.hpp"
#include "sections/connectivity/connectivity.hpp"
#include "sections/residuals/residuals.hpp"
#include "sections/spatial/space_basis.hpp"
#include "sections/temporal/closed_form.hpp"

namespace pdeanim {

// A call ended because another thread called `cancel`.
struct CancelledError : std::runtime_error {
    CancelledError() : std::runtime_error("cancelled") {}
};

enum class Quantity { positions, velocities, accelerations };

// The reference frame on its grid; a vertex is at origin + grid * step.
struct Reference {
    std::vector<GridPoint> grid;
    std::array<double, 3> origin{};  // [scene units]
    double step = 0.0;               // [scene units]
    std::vector<double> points;      // (vertices, 3) [scene units]
};

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

class Animation {
public:
    static constexpr i64 usual_kept = i64{512} << 20;

    // How often `cancel` was called.
    using Cancels = std::shared_ptr<std::atomic<u64>>;

    struct Options {
        int threads = 0;              // 0: one a processor
        i64 kept_bytes = usual_kept;  // of decoded groups at most, where times go back to them
        Cancels cancels;              // of others that are cancelled together with it; its own where there are none
    };

    // Read the headers of a run. CorruptError or LimitError where it is not sound, or asks for more than the file leaves.
    Animation(std::shared_ptr<const File> file, std::size_t run, const Options &options);

    const Container &container() const { return container_; }
    const GroupTable &table() const { return *table_; }
    const Model &model() const { return model_; }
    const std::vector<double> &times() const { return sequence_.times; }
    double fps() const { return sequence_.fps; }
    const std::vector<i64> &jumps() const { return sequence_.jumps; }
    i64 frames() const { return static_cast<i64>(sequence_.times.size()); }
    i64 vertices() const { return first_vertices_.back(); }
    i64 objects() const { return static_cast<i64>(first_vertices_.size()) - 1; }
    i64 first_vertex(i64 object) const { return first_vertices_[object]; }

    // What is decoded when it is first asked for.
    const std::vector<std::string> &names();
    const std::vector<Connectivity> &connectivity() { return *shared_connectivity(); }
    const Reference &reference();
    const std::vector<std::vector<Attribute>> &attributes() { return *shared_attributes(); }
    const SpaceBasis &space() { return space(nullptr); }
    const std::vector<u8> &remarks();  // section META as it is

    // For those who look at them longer than the animation is open.
    std::shared_ptr<const std::vector<Connectivity>> shared_connectivity();
    std::shared_ptr<const std::vector<std::vector<Attribute>>> shared_attributes();

    // Coefficients of one group [scene units]: (functions of space, functions of time, axes).
    std::vector<double> coefficients(std::size_t group);

    // The functions of time of one group in closed form.
    ClosedForm closed_form(std::size_t group) const;

    // A quantity of all vertices, or of one object's, at times [s] in any order: out is (times, vertices, 3). Outside the
    // clip its first or last frame stands still. ArgumentError for a time that is not a number.
    void evaluate(Quantity quantity, std::span<const double> times, std::optional<i64> object, std::span<float> out);

    // For those who add up themselves what fields of space count (a GPU): a quantity at a time is, of all groups, the sum
    // over functions of time of their weights times their fields; positions have the reference frame added, and what
    // corrections there are. ArgumentError for a time that is not a number.
    //
    // Groups that count at a time: the first, and one behind the last. Nothing is decoded for it.
    std::pair<std::size_t, std::size_t> groups_at(Quantity quantity, double time);

    // What the functions of time of one group count: (time axes, functions).
    std::vector<double> weights(Quantity quantity, double time, std::size_t group);

    // Fields of one group [scene units]: out is (functions, vertices, axes), with 1 axis or 3.
    void fields(std::size_t group, std::span<float> out);

    // What the model lacks at the frames of one group, frame after frame. `taken`: memory that they take, from now on.
    std::vector<Correction> corrections(std::size_t group, TakenMemory &taken);

    // The element, a patch or a piece of a curve, that each vertex belongs to.
    std::vector<i32> elements();

    // Check every byte, and decode everything.
    void verify();

    // Hold other callers off, for what belongs together.
    std::unique_lock<std::recursive_mutex> locked() { return std::unique_lock(lock_); }

    // Make calls that are under way end with a CancelledError; later ones go on as if nothing had been.
    void cancel() { ++*cancels_; }

private:
    // Groups, and what their functions of time count at a time.
    using CountingGroups = std::vector<std::pair<std::size_t, std::vector<double>>>;

    std::unique_lock<std::recursive_mutex> begin_call();
    void check_cancelled() const;
    std::vector<ConnectivityView> views();
    TakenMemory begin_group(std::size_t index);
    u64 expected_bytes(std::size_t index) const;
    void make_room(u64 bytes);
    void give_up_oldest();
    void decode_ahead(std::span<const double> sorted);
    bool is_kept(std::size_t index) const;

    // Who goes through a clip once needs few decoded groups at a time. What they may take is this at first, and twice as
    // much whenever one is decoded again that was given up, up to the limit: scrubbing comes to have all that it needs.
    i64 kept_at_first() const { return kept_limit_ / 8; }
    const DecodedGroup &group(std::size_t index);
    struct Early;
    bool says_welds() const;
    TakenMemory take_elements(const Patches &patches);
    std::shared_ptr<const SpaceLayout> layout_of(std::shared_ptr<const Patches> patches) const;
    std::shared_ptr<Early> begin_early(GroupsAhead *ahead);
    const SpaceBasis &space(GroupsAhead *ahead);
    std::unique_ptr<GroupsAhead> begin_ahead(std::span<const std::size_t> groups);
    DecodedGroup decode(std::size_t index, TakenMemory taken, std::size_t k, GroupsAhead &ahead, int threads) const;
    void keep(std::size_t index, DecodedGroup group);
    ResidualScale residual_scale();
    template <class Real> const AnchoredReference<Real> &anchored();
    template <class Work> void with_motion(const DecodedGroup &own, const Work &work);
    int levels_of(i64 bytes, i64 positions) const;
    template <class Work> void in_parts(i64 bytes, const Work &work) const;
    template <class Real, class Out> void evaluate_once(const Motion<Real> &motion, std::span<const double> weights,
                                                        const AnchoredReference<Real> *reference, Out out) const;
    void evaluate_model(const DecodedGroup &own, i64 frame, std::span<float> out);
    FrameResiduals residuals_at(i64 frame);
    FrameShares frame_shares(double time, int derivative);
    const std::vector<ClosedForm> &closed_forms();
    std::pair<std::size_t, std::size_t> counting_groups(double time, int derivative);
    std::vector<double> weights_of_group(std::size_t group, double time, int derivative);
    bool is_outside(Quantity quantity, double time) const;
    std::optional<i64> frame_of_positions(Quantity quantity, double time) const;
    template <class Real> void evaluate_in(const CountingGroups &counting, int derivative, std::span<float> out);
    void evaluate_groups(double time, int derivative, std::span<float> out);
    struct Tile;
    std::deque<Tile> tiles_of(i64 first, i64 count);
    void evaluate_part(Tile &tile, VertexShare share, const ResidualScale &scale, std::span<float> out);
    i64 evaluate_frames(i64 first, i64 count, std::span<float> out);
    void evaluate_between(double time, std::span<float> out);
    void evaluate_derivative(int derivative, double time, std::span<float> out);
    void evaluate_all(Quantity quantity, std::span<const double> sorted, std::span<float> out);
    i64 frame_at(double time) const;

    std::shared_ptr<const File> file_;
    Container container_;
    MemoryLimit memory_;
    int threads_;
    i64 kept_limit_, most_kept_;  // at most ever, and for now
    SequenceDescription sequence_;
    std::vector<u8> polygons_;            // section CONN behind its head
    std::vector<i64> first_vertices_{0};  // of each object, and the number of all
    std::optional<GroupTable> table_;
    Model model_;
    std::recursive_mutex lock_;
    Cancels cancels_;
    u64 cancels_before_ = 0;  // before the call that holds the lock began

    std::optional<std::vector<std::string>> names_;
    std::shared_ptr<const std::vector<Connectivity>> connectivity_;
    std::optional<Reference> reference_;
    std::shared_ptr<const std::vector<std::vector<Attribute>>> attributes_;
    TakenMemory of_attributes_;
    std::unique_ptr<SpaceBasis> space_;
    TakenMemory of_elements_;
    std::optional<AnchoredReference<float>> anchored_single_;  // of the reference frame, for groups of either precision
    std::optional<AnchoredReference<double>> anchored_double_;
    std::optional<std::vector<u8>> remarks_;
    std::optional<BrokenSpline> spline_;
    std::vector<ClosedForm> closed_forms_;

    // Decoded groups, the latest first.
    std::list<std::pair<std::size_t, DecodedGroup>> kept_;
    std::unordered_map<std::size_t, std::list<std::pair<std::size_t, DecodedGroup>>::iterator> kept_places_;
    i64 kept_bytes_ = 0;
    std::vector<bool> has_been_kept_;  // of each group
};

}  // namespace pdeanim
