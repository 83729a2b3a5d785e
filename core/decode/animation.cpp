#include "decode/animation.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <thread>

#include "base/parallel.hpp"
#include "decode/fields.hpp"
#include "decode/limits.hpp"
#include "sections/reference/reference.hpp"

namespace pdeanim {

namespace {

// Peak memory of what a file declares: of a mesh for each vertex (curves, reference frame, positions between frames); of
// connectivity for each corner; of a group for each value of a function of time on three axes, and for each of its frames.
constexpr u64 bytes_per_vertex = 600, bytes_per_corner = 128;
constexpr u64 bytes_per_time_value = 120, bytes_per_group_frame = 16;

// What a coefficient takes mostly; it is counted when it is there.
constexpr u64 bytes_per_coefficient = 40;

// Of a group and of an object that hold nothing: a row of the table with the place that the table grows into, what is kept
// of a decoded group, and the numbers that Python makes of it; lists, a name and arrays, most of it Python's.
constexpr u64 bytes_per_group = 1536, bytes_per_object = 4096;

// Of a byte of a name: the place that a text grows into, and Python's four bytes of each character.
constexpr u64 bytes_per_name_byte = 6;

// Of a group: its bytes, functions of time, where its frames begin. Bounded: 4,096 frames, 3 functions a frame, 3 axes.
u64 known_bytes(const Group &group) {
    return group.bytes() + bytes_per_time_value * static_cast<u64>(group.frames * group.functions) +
           bytes_per_group_frame * static_cast<u64>(group.frames);
}

constexpr u8 predictors = 4;  // of the reference frame

// Groups that are decoded beside each other at most: they are unlike in size, and who is done with one takes the next.
constexpr int groups_a_thread = 16;

// Faces of all objects, then lines cut into pieces of two corners; vertices of all objects numbered through.
Polygons polygons_of(std::span<const Connectivity> parts) {
    Polygons mesh;
    std::size_t corners = 0, polygons = 0;  // at most
    for (const Connectivity &part : parts) {
        corners += part.face_indices.size() + 2 * part.line_indices.size();
        polygons += part.face_sizes.size() + part.line_indices.size();
    }
    mesh.vertex.reserve(corners);
    mesh.starts.reserve(polygons + 1);
    i64 shift = 0;
    for (const Connectivity &part : parts) {
        for (const i32 index : part.face_indices) mesh.vertex.push_back(static_cast<i32>(index + shift));
        for (const i32 size : part.face_sizes) mesh.starts.push_back(mesh.starts.back() + size);
        shift += part.vertices;
    }
    mesh.faces = static_cast<i64>(mesh.starts.size()) - 1;
    mesh.vertices = shift;
    shift = 0;
    for (const Connectivity &part : parts) {
        std::size_t at = 0;
        for (const i32 size : part.line_sizes) {
            for (i32 k = 0; k + 1 < size; ++k) {
                mesh.vertex.push_back(static_cast<i32>(part.line_indices[at + k] + shift));
                mesh.vertex.push_back(static_cast<i32>(part.line_indices[at + k + 1] + shift));
                mesh.starts.push_back(mesh.starts.back() + 2);
            }
            at += size;
        }
        shift += part.vertices;
    }
    return mesh;
}

}  // namespace

Animation::Animation(std::shared_ptr<const File> file, std::size_t run, const Options &options)
    : file_(std::move(file)), container_(file_->container_of(run)), memory_(file_->memory()),
      threads_(options.threads > 0 ? options.threads : static_cast<int>(most(std::thread::hardware_concurrency(), 1u))),
      kept_limit_(options.kept_bytes), most_kept_(kept_at_first()), sequence_(file_->sequence_of(run)),
      cancels_(options.cancels ? options.cancels : std::make_shared<std::atomic<u64>>(0)) {
    polygons_ = container_.read("CONN");
    FieldReader fields(polygons_, "CONN");
    const i64 count = fields.count(), most_objects = static_cast<i64>(memory_.left() / bytes_per_object);
    for (i64 object = 0; object < count; ++object) {
        if (object == most_objects) memory_.take(memory_.left() + 1, "so many objects");
        const i64 own = fields.count(), before = first_vertices_.back();
        first_vertices_.push_back(own > Run::most_vertices - before ? Run::most_vertices + 1 : before + own);
    }
    if (vertices() < 1 || vertices() > Run::most_vertices) {
        throw CorruptError("section CONN declares too few vertices or too many, 1 to " +
                           std::to_string(Run::most_vertices) + " can be");
    }
    const i64 declared = file_->runs()[run].vertices;
    if (declared >= 0 && vertices() != declared) {
        throw CorruptError("section CONN declares " + std::to_string(vertices()) + " vertices, section RUNS " +
                           std::to_string(declared));
    }
    const std::span<const u8> rest = fields.rest();
    polygons_ = std::vector<u8>(rest.begin(), rest.end());
    memory_.take(bytes_per_vertex * vertices(), std::to_string(vertices()) + " vertices");
    memory_.take(bytes_per_object * objects(), std::to_string(objects()) + " objects");
    table_.emplace(container_, frames(), static_cast<i64>(memory_.left() / bytes_per_group));
    memory_.take(bytes_per_group * table_->groups().size(),
                 std::to_string(table_->groups().size()) + " groups of frames");
    has_been_kept_.resize(table_->groups().size());
    model_ = Model::of_bytes(container_.read("MODL"));
}

// Take the lock for a call that can be cancelled, from now on.
std::unique_lock<std::recursive_mutex> Animation::begin_call() {
    const u64 before = *cancels_;
    std::unique_lock guard(lock_);
    cancels_before_ = before;
    return guard;
}

void Animation::check_cancelled() const {
    if (*cancels_ != cancels_before_) throw CancelledError();
}

const std::vector<std::string> &Animation::names() {
    const std::lock_guard guard(lock_);
    if (!names_) {
        names_ = sequence_.names(objects(), [&](i64 size) {
            memory_.take(bytes_per_name_byte * static_cast<u64>(size), "names of objects");
        });
    }
    return *names_;
}

std::shared_ptr<const std::vector<Connectivity>> Animation::shared_connectivity() {
    const std::lock_guard guard(lock_);
    if (!connectivity_) {
        std::vector<i64> counts;
        for (i64 object = 0; object < objects(); ++object)
            counts.push_back(first_vertex(object + 1) - first_vertex(object));
        const std::vector<u8> orders = container_.read_optional("ORDR");
        const i64 most = static_cast<i64>(memory_.left() / bytes_per_corner);
        std::vector<Connectivity> found = decode_connectivity(polygons_, orders, counts, most);
        for (const Connectivity &part : found) {
            memory_.take(bytes_per_corner * (part.face_indices.size() + part.line_indices.size()), "corners of faces");
        }
        connectivity_ = std::make_shared<const std::vector<Connectivity>>(std::move(found));
    }
    return connectivity_;
}

std::vector<ConnectivityView> Animation::views() {
    std::vector<ConnectivityView> found;
    for (const Connectivity &part : connectivity()) {
        found.push_back({part.vertices, part.face_sizes, part.face_indices, part.line_sizes, part.line_indices});
    }
    return found;
}

const Reference &Animation::reference() {
    const std::lock_guard guard(lock_);
    if (!reference_) {
        const std::vector<u8> data = container_.read("REST");
        FieldReader fields(data, "REST");
        Reference found;
        found.step = fields.real();
        for (double &coordinate : found.origin) coordinate = fields.real();
        const u8 predictor = fields.integer<u8>();
        if (predictor >= predictors) {
            throw CorruptError("section REST names predictor " + std::to_string(predictor) +
                               ", this decoder has 0 to " + std::to_string(predictors - 1));
        }
        bool is_sound = found.step > 0.0 && found.step <= limits::largest_step;
        for (const double coordinate : found.origin)
            is_sound = is_sound && std::abs(coordinate) <= limits::largest_step;
        if (!is_sound) throw CorruptError("section REST has a quantisation step or an origin out of range");
        found.grid = decode_reference(polygons_of(connectivity()), predictor, fields.rest());
        found.points.reserve(3 * found.grid.size());
        for (const GridPoint &point : found.grid) {
            for (int axis = 0; axis < 3; ++axis) {
                found.points.push_back(found.origin[axis] + static_cast<double>(point[axis]) * found.step);
            }
        }
        reference_ = std::move(found);
    }
    return *reference_;
}

std::shared_ptr<const std::vector<std::vector<Attribute>>> Animation::shared_attributes() {
    const std::lock_guard guard(lock_);
    if (!attributes_) {
        const std::vector<u8> data = container_.read_optional("ATTR");
        std::vector<std::vector<Attribute>> found(objects());
        if (!data.empty()) {
            const std::vector<GridPoint> &grid = reference().grid;
            TakenMemory taken(memory_);
            found = decode_attributes(data, views(), grid, taken);
            of_attributes_ = std::move(taken);
        }
        attributes_ = std::make_shared<const std::vector<std::vector<Attribute>>>(std::move(found));
    }
    return attributes_;
}

// Take what of a group is known before any of it is decoded.
TakenMemory Animation::begin_group(std::size_t index) {
    return TakenMemory(memory_, known_bytes(table_->groups()[index]), "functions of time of a group of frames");
}

// What it mostly takes to decode a group.
u64 Animation::expected_bytes(std::size_t index) const {
    const Group &own = table_->groups()[index];
    return known_bytes(own) + bytes_per_coefficient * static_cast<u64>(vertices() * (own.channels() + 1));
}

const std::vector<u8> &Animation::remarks() {
    const std::lock_guard guard(lock_);
    if (!remarks_) remarks_ = file_->container().read_optional("META");
    return *remarks_;
}

std::vector<double> Animation::coefficients(std::size_t group) {
    const std::lock_guard guard(lock_);
    const SpaceBasis &basis = space();
    const Group &own = table_->groups()[group];
    const TakenMemory taken(memory_,
                            own.bytes() + sizeof(double) * static_cast<u64>(basis.functions() * own.channels()),
                            "coefficients of a group of frames");
    return group_coefficients(own, table_->chunks(container_, group)[1], basis, taken.another());
}

ClosedForm Animation::closed_form(std::size_t index) const {
    const Group &group = table_->groups()[index];
    const std::span<const double> own(times().data() + group.first, static_cast<std::size_t>(group.frames));
    return ClosedForm(own, group.alpha, group.functions);
}

// Decode a group, the k-th of those that are begun ahead. `taken`: of `begin_group`.
DecodedGroup Animation::decode(std::size_t index, TakenMemory taken, std::size_t k, GroupsAhead &ahead,
                               int threads) const {
    const Group &group = table_->groups()[index];
    try {
        const std::span<const double> own(times().data() + group.first, static_cast<std::size_t>(group.frames));
        Chunks read;
        const Chunks *chunks = ahead.chunks(k);
        if (!chunks) {
            read = table_->chunks(container_, index);
            chunks = &read;
        }
        const auto values = [&] {
            std::optional<std::vector<double>> found = ahead.values(k);
            return found ? std::move(*found) : decode_group_times(group, (*chunks)[0]);
        };
        return decode_group(group, *chunks, *space_, own, std::move(taken), threads, {values, ahead.coefficients(k)});
    } catch (const CorruptError &error) {
        if (error.frame >= 0) throw;
        throw CorruptError(error.what(), error.offset, group.first);
    }
}

void Animation::keep(std::size_t index, DecodedGroup group) {
    if (has_been_kept_[index]) most_kept_ = least(2 * most_kept_, kept_limit_);
    has_been_kept_[index] = true;
    kept_bytes_ += group.bytes();
    kept_.emplace_front(index, std::move(group));
    kept_places_[index] = kept_.begin();
    while (kept_bytes_ > most_kept_ && kept_.size() > 1) give_up_oldest();
}

void Animation::give_up_oldest() {
    kept_bytes_ -= kept_.back().second.bytes();
    kept_places_.erase(kept_.back().first);
    kept_.pop_back();
}

// Give up decoded groups until so much of the memory is left, as far as that goes.
void Animation::make_room(u64 bytes) {
    while (memory_.left() < bytes && !kept_.empty()) give_up_oldest();
}

// Begin with groups beside the space basis, if it is not there yet and there is a thread for it.
std::unique_ptr<GroupsAhead> Animation::begin_ahead(std::span<const std::size_t> groups) {
    if (space_ || threads_ < 2) return std::make_unique<GroupsAhead>();
    return std::make_unique<GroupsAhead>(container_, *table_, groups);
}

const DecodedGroup &Animation::group(std::size_t index) {
    const auto found = kept_places_.find(index);
    if (found != kept_places_.end()) {
        kept_.splice(kept_.begin(), kept_, found->second);
        return kept_.front().second;
    }
    u64 room = expected_bytes(index);
    while (true) {
        check_cancelled();
        make_room(room);
        try {
            TakenMemory taken = begin_group(index);
            const std::unique_ptr<GroupsAhead> ahead = begin_ahead({&index, 1});
            space(ahead.get());
            keep(index, decode(index, std::move(taken), 0, *ahead, threads_));
            return kept_.front().second;
        } catch (const LimitError &) {
            // There may be room when no other one is kept.
            if (kept_.empty()) throw;
            room = std::numeric_limits<u64>::max();
        }
    }
}

bool Animation::is_kept(std::size_t index) const { return kept_places_.contains(index); }

// Decode the groups that frames at increasing times need first, beside each other; fewer where they would not be kept
// together. Those that there is no room for beside the others are left.
void Animation::decode_ahead(std::span<const double> sorted) {
    std::vector<std::size_t> wanted;
    i64 kept_bytes = 0;  // about, of those that are wanted
    u64 bytes_at_once = 0;
    const u64 most_at_once = memory_.left() + static_cast<u64>(kept_bytes_);
    for (const double time : sorted) {
        if (time > times().back() || static_cast<int>(wanted.size()) == groups_a_thread * threads_) break;
        const std::size_t index = table_->group_of(frame_at(most(time, times().front())));
        if (!wanted.empty() && wanted.back() == index) continue;
        const Group &own = table_->groups()[index];
        kept_bytes += own.channels() * vertices() * static_cast<i64>(own.is_single ? sizeof(float) : sizeof(double));
        if (is_kept(index)) break;
        bytes_at_once += expected_bytes(index);
        // One that is not kept until its frames are evaluated would be decoded twice.
        if (bytes_at_once > most_at_once || (!wanted.empty() && kept_bytes > most_kept_ - most_kept_ / 4)) break;
        wanted.push_back(index);
    }
    if (wanted.size() < 2) return;
    make_room(bytes_at_once);
    // Whoever came to the largest one last would be waited for.
    const auto bytes_of = [&](std::size_t index) { return table_->groups()[index].sizes[1]; };
    std::stable_sort(wanted.begin(), wanted.end(), [&](auto a, auto b) { return bytes_of(a) > bytes_of(b); });
    std::vector<TakenMemory> taken;
    for (const std::size_t index : wanted) taken.push_back(begin_group(index));
    const std::unique_ptr<GroupsAhead> ahead = begin_ahead(wanted);
    space(ahead.get());
    std::vector<std::optional<DecodedGroup>> found(wanted.size());
    const auto decode_some = [&](i64 first, i64 end) {
        for (i64 k = first; k < end; ++k) {
            check_cancelled();
            try {
                found[k].emplace(decode(wanted[k], std::move(taken[k]), k, *ahead, 1));
            } catch (const LimitError &) {
                // Whoever needs it decodes it alone.
            }
        }
    };
    in_shares(static_cast<i64>(wanted.size()), threads_, decode_some, groups_a_thread);
    for (std::size_t k = wanted.size(); k-- > 0;) {
        if (found[k]) keep(wanted[k], std::move(*found[k]));
    }
}

void Animation::verify() {
    const auto guard = begin_call();
    for (const SectionEntry &entry : container_.entries()) {
        check_cancelled();
        container_.check(entry);
    }
    names();
    reference();
    check_cancelled();
    attributes();
    remarks();
    for (std::size_t index = 0; index < table_->groups().size(); ++index) group(index);
}

}  // namespace pdeanim
