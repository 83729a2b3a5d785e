#include "decoder/animation.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <thread>

#include "decoder/fields.hpp"
#include "decoder/limits.hpp"
#include "evaluate/motion.hpp"
#include "mesh/curves.hpp"
#include "parallel.hpp"
#include "reference/reference.hpp"

namespace pdeanim {

namespace {

// Peak memory of what a file declares: of a mesh for each vertex (curves, reference frame, and twelve functions each,
// twice); of connectivity for each corner; of a group for each coefficient (quantised, its value, its share of the affine functions, and the value
// on a vertex) and for each value of a function of time.
constexpr u64 bytes_per_vertex = 600, bytes_per_corner = 128;
constexpr u64 bytes_per_coefficient = 40, bytes_per_time_value = 120;

// Of a group and of an object that hold nothing: a row of the table with the place that the table grows into, what is kept
// of a decoded group, and the numbers that Python makes of it; lists, a name and arrays, most of it Python's.
constexpr u64 bytes_per_group = 1536, bytes_per_object = 4096;

// Of a byte of a name: the place that a text grows into, and Python's four bytes of each character.
constexpr u64 bytes_per_name_byte = 6;

constexpr u8 predictors = 4;  // of the reference frame
// From so many bytes on that a frame is made of it pays to begin a thread for a part of it: what is saved is more than the
// 30 us that a thread takes to begin. So many parts are made, as a power of two.
constexpr i64 bytes_worth_a_thread = i64{1} << 21, bytes_of_a_position = 24;
constexpr int part_levels = 3;
// Groups that are decoded beside each other: they are unlike in size, and who is done with one takes the next.
constexpr int groups_a_thread = 2;

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

std::span<Position> as_positions(std::span<float> out) {
    return {reinterpret_cast<Position *>(out.data()), out.size() / 3};
}

}  // namespace

Animation::Animation(std::shared_ptr<const File> file, std::size_t run, const Options &options)
    : file_(std::move(file)), container_(file_->container_of(run)), max_memory_(file_->max_memory()),
      left_(file_->memory_left()),
      threads_(options.threads > 0 ? options.threads : static_cast<int>(most(std::thread::hardware_concurrency(), 1u))),
      most_kept_(options.kept_bytes), sequence_(file_->sequence_of(run)) {
    polygons_ = container_.read("CONN");
    FieldReader fields(polygons_, "CONN");
    const i64 count = fields.count(), most_objects = static_cast<i64>(left_ / bytes_per_object);
    for (i64 object = 0; object < count; ++object) {
        if (object == most_objects) take(left_ + 1, "more than " + std::to_string(most_objects) + " objects");
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
    take(bytes_per_vertex * vertices(), std::to_string(vertices()) + " vertices");
    take(bytes_per_object * objects(), std::to_string(objects()) + " objects");
    table_.emplace(container_, frames(), static_cast<i64>(left_ / bytes_per_group));
    take(bytes_per_group * table_->groups().size(), std::to_string(table_->groups().size()) + " groups of frames");
    model_ = Model::of_bytes(container_.read("MODL"));
}

void Animation::take(u64 bytes, const std::string &what) {
    if (bytes > left_) refuse_memory(what, bytes + max_memory_ - left_, max_memory_);
    left_ -= bytes;
}

// Take the lock for a call that can be cancelled, from now on.
std::unique_lock<std::recursive_mutex> Animation::begin_call() {
    const u64 before = cancels_;
    std::unique_lock guard(lock_);
    cancels_before_ = before;
    return guard;
}

void Animation::check_cancelled() const {
    if (cancels_ != cancels_before_) throw CancelledError();
}

const std::vector<std::string> &Animation::names() {
    const std::lock_guard guard(lock_);
    if (!names_) {
        names_ = sequence_.names(
            objects(), [&](i64 size) { take(bytes_per_name_byte * static_cast<u64>(size), "names of objects"); });
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
        const i64 most = static_cast<i64>(left_ / bytes_per_corner);
        std::vector<Connectivity> found = decode_connectivity(polygons_, orders, counts, most);
        for (const Connectivity &part : found)
            left_ -= bytes_per_corner * (part.face_indices.size() + part.line_indices.size());
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
            found = decode_attributes(data, views(), grid, static_cast<i64>(least<u64>(left_, INT64_MAX)));
        }
        attributes_ = std::make_shared<const std::vector<std::vector<Attribute>>>(std::move(found));
    }
    return attributes_;
}

const SpaceBasis &Animation::space() {
    const std::lock_guard guard(lock_);
    if (!space_) {
        take_motion();
        const SpaceForm &form = model_.form;
        const std::vector<ConnectivityView> parts = views();
        std::shared_ptr<const Patches> patches;
        if (form.kind == SpaceKind::patch) {
            // The patches of most meshes follow from connectivity alone: they are made while the reference is decoded.
            std::optional<Patches> early;
            std::exception_ptr failure;
            {
                const auto make = [&] {
                    try {
                        early = early_patches(parts, form.points);
                    } catch (...) {
                        failure = std::current_exception();
                    }
                };
                const std::jthread other = threads_ > 1 && !reference_ ? std::jthread(make) : std::jthread();
                reference();
            }
            if (failure) std::rethrow_exception(failure);
            patches = std::make_shared<const Patches>(
                build_patches(parts, reference().grid, form.points, early ? &*early : nullptr));
        } else {
            Curves curves = extract_curves(parts, reference().grid);
            patches = std::make_shared<const Patches>(cut_curves(std::move(curves.order), curves.starts, form.points));
        }
        space_ =
            std::make_unique<SpaceBasis>(form, patches, reference().grid, std::span<const u8>(model_.masks), threads_);
    }
    return *space_;
}

// What it takes at most to decode so many coefficients of a function of space, and values of functions of time. Both are
// bounded: 4,096 frames a group, 3 functions a frame, 3 axes.
u64 Animation::motion_bytes(u64 channels, u64 time_values) const {
    return bytes_per_coefficient * vertices() * channels + bytes_per_time_value * time_values;
}

// The memory that the largest group needs must be there before any is decoded.
void Animation::take_motion() {
    if (has_motion_memory_) return;
    u64 widest = 0, longest = 0;
    for (const Group &group : table_->groups()) {
        widest = most(widest, static_cast<u64>(group.channels()));
        longest = most(longest, static_cast<u64>(group.frames * group.functions));
    }
    take(motion_bytes(widest, longest),
         std::to_string(widest) + " functions of time on " + std::to_string(vertices()) + " vertices");
    has_motion_memory_ = true;
}

const std::vector<u8> &Animation::remarks() {
    const std::lock_guard guard(lock_);
    if (!remarks_) remarks_ = file_->container().read_optional("META");
    return *remarks_;
}

std::vector<double> Animation::coefficients(std::size_t group) {
    const std::lock_guard guard(lock_);
    const SpaceBasis &basis = space();
    return group_coefficients(table_->groups()[group], table_->chunks(container_, group)[1], basis);
}

ClosedForm Animation::closed_form(std::size_t index) const {
    const Group &group = table_->groups()[index];
    const std::span<const double> own(times().data() + group.first, static_cast<std::size_t>(group.frames));
    return ClosedForm(own, group.alpha, group.functions);
}

// Decode the k-th of some groups that are decoded at once.
DecodedGroup Animation::decode(std::span<const std::size_t> groups, std::size_t k, GroupsAhead &ahead,
                               int threads) const {
    const Group &group = table_->groups()[groups[k]];
    try {
        const std::span<const double> own(times().data() + group.first, static_cast<std::size_t>(group.frames));
        Chunks read;
        const Chunks *chunks = ahead.chunks(k);
        if (!chunks) {
            read = table_->chunks(container_, groups[k]);
            chunks = &read;
        }
        const auto values = [&] {
            std::optional<std::vector<double>> found = ahead.values(k);
            return found ? std::move(*found) : decode_group_times(group, (*chunks)[0]);
        };
        return decode_group(group, *chunks, *space_, own,
                            static_cast<i64>(least<u64>(left_ / groups.size(), INT64_MAX)), threads, values);
    } catch (const CorruptError &error) {
        if (error.frame >= 0) throw;
        throw CorruptError(error.what(), error.offset, group.first);
    }
}

void Animation::keep(std::size_t index, DecodedGroup group) {
    kept_bytes_ += group.bytes();
    kept_.emplace_front(index, std::move(group));
    kept_places_[index] = kept_.begin();
    const i64 most_bytes = static_cast<i64>(least(static_cast<u64>(most_kept_), left_));
    while (kept_bytes_ > most_bytes && kept_.size() > 1) {
        kept_bytes_ -= kept_.back().second.bytes();
        kept_places_.erase(kept_.back().first);
        kept_.pop_back();
    }
}

// Begin with groups beside the space basis, if it is not there yet and there is a thread for it.
std::unique_ptr<GroupsAhead> Animation::begin_ahead(std::span<const std::size_t> groups) {
    if (space_ || threads_ < 2) return std::make_unique<GroupsAhead>();
    take_motion();
    return std::make_unique<GroupsAhead>(container_, *table_, groups);
}

const DecodedGroup &Animation::group(std::size_t index) {
    const auto found = kept_places_.find(index);
    if (found != kept_places_.end()) {
        kept_.splice(kept_.begin(), kept_, found->second);
        return kept_.front().second;
    }
    check_cancelled();
    const std::span<const std::size_t> wanted(&index, 1);
    const std::unique_ptr<GroupsAhead> ahead = begin_ahead(wanted);
    space();
    keep(index, decode(wanted, 0, *ahead, threads_));
    return kept_.front().second;
}

bool Animation::is_kept(std::size_t index) const { return kept_places_.contains(index); }

// Decode the groups that frames at increasing times need first, beside each other; fewer where they would not be kept
// together, or the memory limit has no room for all at once.
void Animation::decode_ahead(std::span<const double> sorted) {
    std::vector<std::size_t> wanted;
    i64 expected_bytes = 0;
    u64 bytes_at_once = 0;
    for (const double time : sorted) {
        if (time > times().back() || static_cast<int>(wanted.size()) == groups_a_thread * threads_) break;
        const std::size_t index = table_->group_of(frame_at(most(time, times().front())));
        if (!wanted.empty() && wanted.back() == index) continue;
        const Group &own = table_->groups()[index];
        expected_bytes +=
            own.channels() * vertices() * static_cast<i64>(own.is_single ? sizeof(float) : sizeof(double));
        if (is_kept(index)) break;
        if (!wanted.empty()) {  // the first one has the memory that the largest group needs
            bytes_at_once +=
                motion_bytes(static_cast<u64>(own.channels()), static_cast<u64>(own.frames * own.functions));
            if (expected_bytes > most_kept_ || bytes_at_once > left_) break;
        }
        wanted.push_back(index);
    }
    if (wanted.size() < 2) return;
    const std::unique_ptr<GroupsAhead> ahead = begin_ahead(wanted);
    space();
    std::vector<std::optional<DecodedGroup>> found(wanted.size());
    in_shares(static_cast<i64>(wanted.size()), threads_, [&](i64 first, i64 end) {
        for (i64 k = first; k < end; ++k) found[k] = decode(wanted, k, *ahead, 1);
    });
    for (std::size_t k = wanted.size(); k-- > 0;) keep(wanted[k], std::move(*found[k]));
}

ResidualScale Animation::residual_scale() { return {space().elements().patches->order, model_.residual_step}; }

template <class Real> const AnchoredReference<Real> &Animation::anchored() {
    auto &found = [&]() -> std::optional<AnchoredReference<Real>> & {
        if constexpr (std::is_same_v<Real, float>) {
            return anchored_single_;
        } else {
            return anchored_double_;
        }
    }();
    if (!found) found.emplace(*space().elements().patches, reference().points);
    return *found;
}

// Work with a group's motion and the reference frame in its precision.
template <class Work> void Animation::with_motion(const DecodedGroup &own, const Work &work) {
    std::visit([&]<class Real>(const Motion<Real> &motion) { work(motion, anchored<Real>()); }, own.motion);
}

// Call work(share) for shares of the vertices that cover each once, from several threads where so much is read that it is
// worth it.
template <class Work> void Animation::in_parts(i64 bytes, const Work &work) const {
    const bool is_worth_it = bytes + bytes_of_a_position * vertices() >= bytes_worth_a_thread;
    const int levels = is_worth_it && threads_ > 1 ? part_levels : 0;
    in_shares(i64{1} << levels, threads_, [&](i64 first, i64 end) {
        for (i64 part = first; part < end; ++part) work(VertexShare{levels, part});
    });
}

// Positions, or displacements without a reference frame, at one time; `weights`: what functions of time count there.
template <class Real, class Out>
void Animation::evaluate_once(const Motion<Real> &motion, std::span<const double> weights,
                              const AnchoredReference<Real> *reference, Out out) const {
    in_parts(motion.bytes(),
             [&](const VertexShare &share) { pdeanim::evaluate(motion, weights, reference, out, share); });
}

// Positions at one frame, by the model alone.
void Animation::evaluate_model(const DecodedGroup &own, i64 frame, std::span<float> out) {
    with_motion(own, [&](const auto &motion, const auto &anchored) {
        const i64 row = motion.time_axes() * motion.functions;
        evaluate_once(motion, std::span(own.time).subspan((frame - own.group.first) * row, row), &anchored, out);
    });
}

FrameResiduals Animation::residuals_at(i64 frame) {
    const DecodedGroup &own = group(table_->group_of(frame));
    FrameResiduals found{own.residuals, frame - own.group.first, {}};
    const std::vector<i64> &starts = own.residuals.raw_frame_starts;
    if (starts[found.inside] < starts[found.inside + 1]) {
        found.base.resize(vertices());
        evaluate_model(own, frame, {found.base[0].data(), 3 * found.base.size()});
    }
    return found;
}

// Positions at frames of one group in a row.
void Animation::evaluate_frames_of_group(i64 first, i64 count, std::span<float> out) {
    const DecodedGroup &own = group(table_->group_of(first));
    const ResidualScale scale = residual_scale();
    const std::size_t size = 3 * vertices();
    if (count == 1) {
        evaluate_model(own, first, out);
        add_residuals(own.residuals, first - own.group.first, scale, 1.0, {}, as_positions(out));
        return;
    }
    with_motion(own, [&](const auto &motion, const auto &anchored) {
        const i64 row = motion.time_axes() * motion.functions;
        in_shares((count + frames_at_once - 1) / frames_at_once, threads_, [&](i64 tile, i64 end) {
            for (; tile < end; ++tile) {
                check_cancelled();
                const i64 begin = tile * frames_at_once, frames = least(frames_at_once, count - begin);
                const i64 inside = first + begin - own.group.first;
                const std::span<float> part = out.subspan(begin * size, frames * size);
                pdeanim::evaluate(motion, std::span(own.time).subspan(inside * row, frames * row), &anchored, part);
                for (i64 k = 0; k < frames; ++k) {
                    add_residuals(own.residuals, inside + k, scale, 1.0, {},
                                  as_positions(part.subspan(k * size, size)));
                }
            }
        });
    });
}

// Groups whose functions count at a time inside the clip, by the closed form or by the spline: the first, and one behind the
// last.
std::pair<std::size_t, std::size_t> Animation::counting_groups(double time, int derivative) {
    if (table_->groups()[0].basis == TimeBasis::closed_form) {
        const std::vector<GroupWeights> found = closed_form_weights(closed_forms(), time, derivative);
        return {found.front().group, found.back().group + 1};
    }
    const FrameShares shares = frame_shares(time, derivative);
    return {table_->group_of(shares.first), table_->group_of(shares.end() - 1) + 1};
}

// What functions of time of a group count at a time inside the clip: (time axes, functions); nothing where none counts.
std::vector<double> Animation::weights_of_group(std::size_t index, double time, int derivative) {
    const Group &own = table_->groups()[index];
    std::vector<double> weights;
    if (own.basis == TimeBasis::closed_form) {
        for (const GroupWeights &found : closed_form_weights(closed_forms(), time, derivative)) {
            if (found.group != index) continue;
            weights.assign(found.weights.begin(), found.weights.begin() + own.functions);
        }
        return weights;
    }
    const FrameShares shares = frame_shares(time, derivative);
    const i64 low = most(own.first, shares.first), high = least(own.first + own.frames, shares.end());
    for (i64 frame = low; frame < high; ++frame) {
        const double share = shares.values[frame - shares.first];
        if (share == 0.0) continue;
        weights.resize(own.time_axes() * own.functions);
        const double *row = group(index).time.data() + (frame - own.first) * weights.size();
        for (std::size_t k = 0; k < weights.size(); ++k) weights[k] += share * row[k];
    }
    return weights;
}

const std::vector<ClosedForm> &Animation::closed_forms() {
    if (closed_forms_.empty()) {
        closed_forms_.reserve(table_->groups().size());
        for (std::size_t k = 0; k < table_->groups().size(); ++k) closed_forms_.push_back(closed_form(k));
    }
    return closed_forms_;
}

// What frames count at a time inside the clip, by the spline.
FrameShares Animation::frame_shares(double time, int derivative) {
    if (!spline_) spline_.emplace(times(), jumps());
    return spline_->shares(time, derivative);
}

// Positions or a derivative of them as groups of one precision say together; as many at once as are kept.
template <class Real>
void Animation::evaluate_in(const CountingGroups &counting, int derivative, std::span<float> out) {
    const AnchoredReference<Real> *reference = derivative == 0 ? &anchored<Real>() : nullptr;
    std::optional<AnchoredReference<Real>> moved;
    if (counting.size() > 1) {
        moved = reference ? *reference : AnchoredReference<Real>(*space().elements().patches);
        reference = &*moved;
    }
    for (std::size_t next = 0; next < counting.size();) {
        std::vector<const Motion<Real> *> motions;
        i64 bytes = 0;
        const std::size_t first = next;
        do {
            motions.push_back(&std::get<Motion<Real>>(group(counting[next].first).motion));
            bytes += motions.back()->bytes();
        } while (++next < counting.size() && is_kept(counting[next].first));
        in_parts(bytes, [&](const VertexShare &share) {
            for (std::size_t k = first; k < next; ++k) {
                const Motion<Real> &own = *motions[k - first];
                const std::vector<double> &weights = counting[k].second;
                if (k + 1 < counting.size()) {
                    displace(own, weights, *moved, share);
                } else {
                    pdeanim::evaluate(own, weights, reference, out, share);
                }
            }
        });
    }
}

// Positions at a time inside the clip by the model alone, or a derivative of them.
void Animation::evaluate_groups(double time, int derivative, std::span<float> out) {
    CountingGroups counting;
    const auto [first, end] = counting_groups(time, derivative);
    for (std::size_t index = first; index < end; ++index) {
        std::vector<double> weights = weights_of_group(index, time, derivative);
        if (!weights.empty()) counting.emplace_back(index, std::move(weights));
    }
    const auto is_single = [&](const auto &own) { return table_->groups()[own.first].is_single; };
    const auto singles = std::count_if(counting.begin(), counting.end(), is_single);
    if (singles == 0 && !counting.empty()) {
        evaluate_in<double>(counting, derivative, out);
        return;
    }
    if (singles == static_cast<i64>(counting.size()) && !counting.empty()) {
        evaluate_in<float>(counting, derivative, out);
        return;
    }
    // What groups of either precision say is added up before it is rounded. Nothing may count, too.
    std::vector<double> all(out.size()), part(out.size());
    if (derivative == 0) all = reference().points;
    for (const auto &counted : counting) {
        std::visit(
            [&]<class Real>(const Motion<Real> &motion) {
                evaluate_once<Real>(motion, counted.second, nullptr, std::span<double>(part));
            },
            group(counted.first).motion);
        for (std::size_t i = 0; i < all.size(); ++i) all[i] += part[i];
    }
    std::transform(all.begin(), all.end(), out.begin(), [](double value) { return static_cast<float>(value); });
}

// Positions between two frames, whose residuals fade by a hat function.
void Animation::evaluate_between(double time, std::span<float> out) {
    evaluate_groups(time, 0, out);
    const i64 left = frame_at(time);
    const double share = (time - times()[left]) / (times()[left + 1] - times()[left]);
    const ResidualScale scale = residual_scale();
    for (const i64 frame : {left, left + 1}) {
        const FrameResiduals own = residuals_at(frame);
        const double weight = frame == left ? 1.0 - share : share;
        add_residuals(own.group, own.inside, scale, weight, own.base, as_positions(out));
    }
}

// Velocity or acceleration at a time inside the clip: residuals change at constant speed from one frame to the next; at a
// frame the speed to the next one counts.
void Animation::evaluate_derivative(int derivative, double time, std::span<float> out) {
    if (frames() == 1) {
        std::fill(out.begin(), out.end(), 0.0f);
        return;
    }
    evaluate_groups(time, derivative, out);
    if (derivative != 1) return;
    const i64 after = least(frame_at(time) + 1, frames() - 1);
    const double step = times()[after] - times()[after - 1];
    const ResidualScale scale = residual_scale();
    std::vector<std::array<double, 3>> added[2];
    for (int k = 0; k < 2; ++k) {
        const FrameResiduals own = residuals_at(after - 1 + k);
        added[k].resize(vertices());
        residual_displacements(own.group, own.inside, scale, own.base, added[k]);
    }
    for (i64 v = 0; v < vertices(); ++v) {
        for (int axis = 0; axis < 3; ++axis) {
            float &speed = out[3 * v + axis];
            speed = static_cast<float>(speed + (added[1][v][axis] - added[0][v][axis]) / step);
        }
    }
}

// The last frame that is not after a time inside the clip.
i64 Animation::frame_at(double time) const {
    return std::upper_bound(times().begin(), times().end(), time) - times().begin() - 1;
}

// All vertices, at increasing times.
void Animation::evaluate_all(Quantity quantity, std::span<const double> sorted, std::span<float> out) {
    const std::size_t size = 3 * vertices();
    const double first = times().front(), last = times().back();
    std::size_t row = 0;
    while (row < sorted.size()) {
        check_cancelled();
        const std::span<float> here = out.subspan(row * size, size);
        const double time = clamp(sorted[row], first, last);
        if (quantity != Quantity::positions) {
            if (sorted[row] < first || sorted[row] > last) {
                std::fill(here.begin(), here.end(), 0.0f);
            } else {
                evaluate_derivative(quantity == Quantity::velocities ? 1 : 2, time, here);
            }
            ++row;
            continue;
        }
        const i64 frame = frame_at(time);
        if (times()[frame] != time) {
            evaluate_between(time, here);
            ++row;
            continue;
        }
        if (!is_kept(table_->group_of(frame))) decode_ahead(sorted.subspan(row));
        // Frames of one group that follow one another are evaluated together.
        const Group &own = table_->groups()[table_->group_of(frame)];
        const i64 most_here = own.first + own.frames - frame;
        i64 count = 1;
        while (count < most_here && row + count < sorted.size() && sorted[row + count] == times()[frame + count])
            ++count;
        evaluate_frames_of_group(frame, count, out.subspan(row * size, count * size));
        row += count;
    }
}

void Animation::evaluate(Quantity quantity, std::span<const double> asked, std::optional<i64> object,
                         std::span<float> out) {
    const i64 begin = object ? first_vertex(*object) : 0, end = object ? first_vertex(*object + 1) : vertices();
    const std::size_t size = 3 * (end - begin), whole = 3 * vertices();
    if (out.size() != asked.size() * size) throw ArgumentError("the array to write to has another size");
    for (const double time : asked) {
        if (std::isnan(time)) throw ArgumentError("times must be numbers");
    }
    const auto guard = begin_call();
    std::vector<std::size_t> order(asked.size());
    std::iota(order.begin(), order.end(), 0);
    std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return asked[a] < asked[b]; });
    const bool is_in_order = std::is_sorted(order.begin(), order.end());
    if (is_in_order && !object) {
        evaluate_all(quantity, asked, out);
        return;
    }
    // As many times at once as fit in the memory that groups are kept in.
    const std::size_t at_once = most<std::size_t>(most_kept_ / (sizeof(float) * whole), 1);
    std::vector<float> rows;
    for (std::size_t first = 0; first < order.size(); first += at_once) {
        const std::size_t count = least(at_once, order.size() - first);
        std::vector<double> sorted;
        for (std::size_t k = 0; k < count; ++k) sorted.push_back(asked[order[first + k]]);
        rows.resize(count * whole);
        evaluate_all(quantity, sorted, rows);
        for (std::size_t k = 0; k < count; ++k) {
            const auto from = rows.begin() + static_cast<std::ptrdiff_t>(k * whole + 3 * begin);
            std::copy_n(from, size, out.begin() + static_cast<std::ptrdiff_t>(order[first + k] * size));
        }
    }
}

void Animation::verify() {
    const auto guard = begin_call();
    container_.verify();
    names();
    attributes();
    remarks();
    for (std::size_t index = 0; index < table_->groups().size(); ++index) group(index);
}

}  // namespace pdeanim
