// The sections of one run of frames, usually all sections of a file: each is decoded on first use, and kept.
#pragma once

#include <atomic>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "decode/file.hpp"
#include "decode/groups_ahead.hpp"
#include "sections/attributes/attributes.hpp"
#include "sections/connectivity/connectivity.hpp"
#include "sections/spatial/space_basis.hpp"
#include "sections/temporal/closed_form.hpp"

namespace pdeanim {

// A call ended because another thread called `cancel`.
struct CancelledError : std::runtime_error {
    CancelledError() : std::runtime_error("cancelled") {}
};

// Threads that call functions of one animation take turns, and may cancel each other's calls.
class Turns {
public:
    // Count of cancellations, which several animations may share.
    using Cancels = std::shared_ptr<std::atomic<u64>>;

    // Make a new count if none is shared.
    explicit Turns(Cancels cancels) : cancels_(cancels ? std::move(cancels) : std::make_shared<std::atomic<u64>>(0)) {}

    // Exclude other callers.
    std::unique_lock<std::recursive_mutex> take() { return std::unique_lock(lock_); }

    // Like `take`, for a call that can be cancelled from now on.
    std::unique_lock<std::recursive_mutex> begin_call() {
        const u64 before = *cancels_;
        std::unique_lock guard(lock_);
        cancels_before_ = before;
        return guard;
    }

    // Raise CancelledError if the call that holds the lock was cancelled.
    void check_cancelled() const {
        if (*cancels_ != cancels_before_) throw CancelledError();
    }

    // Make running calls end with a CancelledError; later calls are not affected.
    void cancel() { ++*cancels_; }

private:
    std::recursive_mutex lock_;
    Cancels cancels_;
    u64 cancels_before_ = 0;  // count when the call that holds the lock began
};

// The reference frame on its grid; a vertex lies at origin + grid * step.
struct Reference {
    std::vector<GridPoint> grid;
    std::array<double, 3> origin{};  // [scene units]
    double step = 0.0;               // width of a grid cell [scene units]
    bool is_smoothed = false;
    std::vector<double> points;  // (vertices, 3) [scene units]
    std::vector<i32> ties;       // for each vertex, the first vertex that it is tied to; empty if no vertices are tied
};

// The sections of one run. Opening reads the times, the head of the connectivity, the table of groups and the model. On
// first use come connectivity, then the reference frame, then the space basis. Functions may be called from several
// threads, which take turns.
class RunSections {
public:
    // Read the headers of a run. CorruptError if it is damaged, LimitError if it needs more memory than the file has
    // left. threads: number of threads that decode in parallel. `turns` must outlive this object.
    RunSections(std::shared_ptr<const File> file, std::size_t run, int threads, Turns &turns);

    const File &file() const { return *file_; }
    const Container &container() const { return container_; }
    const GroupTable &table() const { return *table_; }
    const Model &model() const { return model_; }
    const std::vector<double> &times() const { return sequence_.times; }
    const std::vector<i64> &jumps() const { return sequence_.jumps; }
    i64 frames() const { return static_cast<i64>(sequence_.times.size()); }
    i64 vertices() const { return first_vertices_.back(); }
    i64 objects() const { return static_cast<i64>(first_vertices_.size()) - 1; }
    i64 first_vertex(i64 object) const { return first_vertices_[object]; }
    int threads() const { return threads_; }

    // Return the limit on memory for all decoded data of the run.
    MemoryLimit &memory() { return memory_; }

    // Return the last frame that is not later than a time inside the clip.
    i64 frame_at(double time) const;

    // Return the times of a group's frames [s].
    std::span<const double> times_of(const Group &group) const;
    ClosedForm closed_form(std::size_t group) const;

    // Return the flags of the reference frame without decoding it. Vertices may coincide even if the flags do not say
    // that vertices are welded.
    u8 reference_kind() const;

    // Parts that are decoded on first use.
    const std::vector<std::string> &names();
    const std::vector<Connectivity> &connectivity() { return *shared_connectivity(); }
    std::vector<ConnectivityView> views();  // the connectivity of each object
    // The connectivity that positions are predicted on: as decoded, with the sides that solids share after the faces.
    const std::vector<Connectivity> &predicted_on();
    const Reference &reference();
    std::vector<u8> still_vertices() const;  // whether each vertex stands still; empty if none does
    const std::vector<std::vector<Attribute>> &attributes() { return *shared_attributes(); }
    const std::vector<u8> &remarks();  // Return the bytes of section META as they are in the file.

    // Return the space basis. `ahead` starts decoding coefficients as soon as the layout is known.
    const SpaceBasis &space(GroupsAhead *ahead = nullptr);

    // Begin to decode groups while the space basis is built; null if it exists already or there is no thread for it.
    std::unique_ptr<GroupsAhead> begin_ahead(std::span<const std::size_t> groups);

    // Shared ownership: stays valid after the animation is closed.
    std::shared_ptr<const std::vector<Connectivity>> shared_connectivity();
    std::shared_ptr<const std::vector<std::vector<Attribute>>> shared_attributes();

private:
    struct EarlyPatches;

    void read_vertex_counts(std::size_t run);
    TakenMemory take_elements(const Patches &patches);
    std::shared_ptr<const SpaceLayout> layout_of(std::shared_ptr<const Patches> patches) const;
    std::shared_ptr<EarlyPatches> begin_early_patches(GroupsAhead *ahead);
    std::shared_ptr<const SpaceLayout> layout_of_patches(GroupsAhead *ahead);
    std::shared_ptr<const SpaceLayout> layout_of_curves();

    std::shared_ptr<const File> file_;
    Container container_;
    MemoryLimit memory_;
    int threads_;
    Turns &turns_;
    SequenceDescription sequence_;
    std::vector<u8> polygons_;            // rest of section CONN, after its head
    std::vector<i64> first_vertices_{0};  // number of the first vertex of each object, then the number of all vertices
    std::optional<GroupTable> table_;
    Model model_;

    std::optional<std::vector<std::string>> names_;
    std::shared_ptr<const std::vector<Connectivity>> connectivity_;
    std::optional<std::vector<Connectivity>> predicted_on_;  // if there are cells
    std::optional<Reference> reference_;
    std::shared_ptr<const std::vector<std::vector<Attribute>>> attributes_;
    TakenMemory of_attributes_;
    std::unique_ptr<SpaceBasis> space_;
    TakenMemory of_elements_;
    std::optional<std::vector<u8>> remarks_;
};

}  // namespace pdeanim
