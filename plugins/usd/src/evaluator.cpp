#include "evaluator.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

#include "names.hpp"
#include "text.hpp"

namespace pdeanim_usd {

namespace {

// Part of a frame by which the last time may overshoot: sums of rounded steps do not meet it exactly.
constexpr double time_slack = 1e-9;

// Relative difference within which a time code is a whole number, or that of a sample.
constexpr double same_code = 1e-9;

constexpr double max_samples = 1 << 24;

// Half of the interval over which the velocity of a transform is measured [s].
constexpr double slope_seconds = 1e-4;

bool are_same(double code, double other) {
    return std::abs(code - other) <= same_code * std::max(1.0, std::abs(other));
}

double code_of(double time, double rate) {
    const double code = time * rate, whole = std::nearbyint(code);
    return are_same(code, whole) ? whole : code;
}

pdeanim_quantity library_quantity(Quantity quantity) {
    return quantity == Quantity::velocities      ? PDEANIM_VELOCITIES
           : quantity == Quantity::accelerations ? PDEANIM_ACCELERATIONS
                                                 : PDEANIM_POSITIONS;
}

VtVec3fArray extent_of(const VtVec3fArray &points) {
    if (points.empty()) return points;
    GfVec3f low = points.cfront(), high = low;
    for (const GfVec3f &point : points.AsConst()) {
        for (int axis = 0; axis < 3; ++axis) {
            low[axis] = std::min(low[axis], point[axis]);
            high[axis] = std::max(high[axis], point[axis]);
        }
    }
    return {low, high};
}

// Return rows of three float64, velocities of a field, in the type that USD has for them.
VtVec3fArray as_vec3f(const std::vector<char> &rows) {
    const GfVec3d *first = reinterpret_cast<const GfVec3d *>(rows.data());
    VtVec3fArray found;
    for (const GfVec3d *row = first; row < first + rows.size() / sizeof(GfVec3d); ++row) found.push_back(GfVec3f(*row));
    return found;
}

// Return how a field turns with the points: as "vector" or "normal"; empty if not at all.
std::string direction_role(const Field &field) {
    const std::string role = role_of(field.name);
    if (field.columns != 3 || field.type.kind != 'f') return "";
    return role == "vector" || role == "normal"                          ? role
           : field.name == "velocities" || field.name == "accelerations" ? "vector"
                                                                         : "";
}

// Interpolate rows of a time [s] and a matrix, number by number.
GfMatrix4d matrix_at(const std::vector<double> &rows, double time) {
    constexpr std::size_t columns = 17;
    const std::size_t count = rows.size() / columns;
    std::size_t after = 0;
    while (after < count && rows[after * columns] <= time) ++after;
    const double *high = rows.data() + std::min(after, count - 1) * columns;
    const double *low = rows.data() + (after ? after - 1 : 0) * columns;
    const double share = high == low ? 0 : (time - low[0]) / (high[0] - low[0]);
    GfMatrix4d found;
    for (int i = 0; i < 16; ++i) found[i / 4][i % 4] = low[1 + i] + share * (high[1 + i] - low[1 + i]);
    return found;
}

}  // namespace

Evaluator::Evaluator(std::shared_ptr<const Clip> clip, double fps, std::size_t max_kept, double rate)
    : clip_(std::move(clip)), metadata_(clip_->metadata()), max_kept_(max_kept) {
    const std::vector<double> &times = clip_->times();
    std::vector<double> sampled = times;
    if (fps > 0) {
        const double intervals = (times.back() - times.front()) * fps + time_slack;
        if (intervals >= max_samples) throw Failure("the argument 'fps' asks for too many samples; take a lower rate");
        sampled.resize(static_cast<std::size_t>(intervals) + 1);
        for (std::size_t i = 0; i < sampled.size(); ++i) sampled[i] = times.front() + static_cast<double>(i) / fps;
    }
    fps_ = fps > 0 ? fps : clip_->frame_rate();
    rate_ = fps_;
    if (rate > 0) {
        rate_ = rate;
    } else if (const auto found = metadata_.find("time_codes_per_second"); found != metadata_.end()) {
        rate_ = std::max(number_of(found->second).value_or(0), 0.0);
        if (!rate_) rate_ = fps_;
    }
    for (const double time : sampled) samples_.push_back({time, code_of(time, rate_), clip_->run_at(time)});
    std::map<ShapeKey, int> numbers;
    for (int index = 0; index < clip_->run_count(); ++index) {
        const std::shared_ptr<const Run> run = clip_->run(index);
        for (int object = 0; object < static_cast<int>(run->shapes().size()); ++object) {
            const Shape &shape = run->shapes()[object];
            if (changes() && !shape.vertex_count) continue;
            const auto [found, is_new] = numbers.try_emplace(shape.key, static_cast<int>(keys_.size()));
            if (is_new) {
                keys_.push_back(shape.key);
                objects_.emplace_back(clip_->run_count(), -1);
            }
            objects_[found->second][index] = object;
        }
    }
}

const Shape *Evaluator::shape(const Run &run, int run_index, int shape) const {
    const int object = objects_[shape][run_index];
    return object < 0 ? nullptr : &run.shapes()[object];
}

const Field *Evaluator::field(const Run &run, int run_index, int shape, const std::string &name) const {
    const int object = objects_[shape][run_index];
    if (object < 0) return nullptr;
    for (const Field &one : run.fields()) {
        if (one.name == name && one.is_of_object[object]) return &one;
    }
    return nullptr;
}

double Evaluator::time_of(double code) const {
    const auto after = std::lower_bound(samples_.begin(), samples_.end(), code,
                                        [](const Sample &one, double wanted) { return one.code < wanted; });
    if (after != samples_.end() && are_same(code, after->code)) return after->time;
    if (after != samples_.begin() && are_same(code, std::prev(after)->code)) return std::prev(after)->time;
    return code / rate_;
}

VtValue Evaluator::value(const Series &series, double code) const {
    const auto known = series.times.find(code);
    const double time = known == series.times.end() ? time_of(code) : known->second;
    const int index = changes() ? clip_->run_at(time) : 0;
    const std::shared_ptr<const Run> run = clip_->run(index);
    const Shape *shape = this->shape(*run, index, series.shape);
    if (!shape) return series.empty;
    const int object = objects_[series.shape][index];
    switch (series.quantity) {
        case Quantity::transform: return VtValue(matrix_at(shape->transform, time));
        case Quantity::constant:
            for (const Property &one : shape->properties) {
                if (one.name == series.name) return one.value;
            }
            for (const FaceSet &one : shape->face_sets) {
                if (one.role + ":" + one.label == series.name) return VtValue(one.members);
            }
            return series.empty;
        case Quantity::field:
        case Quantity::sampled: return field_at(series, *run, index, time, code);
        case Quantity::normals: {
            if (!shape->normals) return series.empty;
            const auto points = vectors(Quantity::points, *run, index, object, time);
            return VtValue(in_own_space(series, code, shape->normals->find(*points), Quantity::normals));
        }
        default: break;
    }
    const Quantity quantity = series.quantity == Quantity::extent ? Quantity::points : series.quantity;
    VtVec3fArray found = *vectors(quantity, *run, index, object, time);
    if (series.in_scene && series.in_scene->placement) {
        found =
            quantity == Quantity::velocities && !series.in_scene->placement->is_constant()
                ? velocities_in_own_space(series, code, found, *vectors(Quantity::points, *run, index, object, time))
                : in_own_space(series, code, found, quantity);
    }
    if (series.quantity == Quantity::extent) return VtValue(extent_of(found));
    if (shape->gather.empty() || (series.in_scene && !series.in_scene->is_gathered)) return VtValue(found);
    VtVec3fArray gathered;
    gathered.reserve(shape->gather.size());
    for (const int vertex : shape->gather) gathered.push_back(found[vertex]);
    return VtValue(gathered);
}

VtVec3fArray Evaluator::in_own_space(const Series &series, double code, VtVec3fArray found, Quantity quantity) const {
    if (!series.in_scene || !series.in_scene->placement) return found;
    const Placement &placement = *series.in_scene->placement;
    const GfMatrix4d own = placement.inverse(code);
    // Normals stay perpendicular to the surface.
    const GfMatrix4d of_normals = placement.matrix(code).GetTranspose();
    for (GfVec3f &one : found) {
        const GfVec3d old(one);
        if (quantity == Quantity::points) {
            one = GfVec3f(own.TransformAffine(old));
        } else if (quantity == Quantity::normals) {
            const GfVec3d turned = of_normals.TransformDir(old);
            const double length = turned.GetLength();
            one = length > 0 ? GfVec3f(turned * (old.GetLength() / length)) : one;
        } else {
            one = GfVec3f(own.TransformDir(old));
        }
    }
    return found;
}

// Return velocities without those of the space itself.
VtVec3fArray Evaluator::velocities_in_own_space(const Series &series, double code, VtVec3fArray found,
                                                const VtVec3fArray &points) const {
    const Placement &placement = *series.in_scene->placement;
    const double first = samples_.front().code, last = samples_.back().code, step = slope_seconds * rate_;
    const double before = std::clamp(code - step, first, last), after = std::clamp(code + step, first, last);
    const double seconds = std::max((after - before) / rate_, slope_seconds);
    const GfMatrix4d slope = (placement.matrix(after) - placement.matrix(before)) * (1 / seconds);
    const GfMatrix4d own = placement.inverse(code);
    for (std::size_t i = 0; i < found.size(); ++i) {
        const GfVec3d point = own.TransformAffine(GfVec3d(points[i]));
        found[i] =
            GfVec3f(own.TransformDir(GfVec3d(found[i]) - slope.TransformDir(point) - slope.ExtractTranslation()));
    }
    return found;
}

VtValue Evaluator::field_at(const Series &series, const Run &run, int run_index, double time, double code) const {
    const Field *field = this->field(run, run_index, series.shape, series.name);
    if (!field) return series.empty;
    const int object = objects_[series.shape][run_index];
    const Shape &shape = run.shapes()[object];
    const std::size_t row_bytes = field->columns * field->type.bytes;
    const auto rows = field_rows(run, run_index, *field, time);
    std::vector<char> own(rows->begin() + field->first_rows[object] * row_bytes,
                          rows->begin() + field->first_rows[object + 1] * row_bytes);
    std::vector<std::int32_t> order;
    if (field->interpolation == "vertex" && (!series.in_scene || series.in_scene->is_gathered)) order = shape.gather;
    if (field->interpolation == "faceVarying" && series.in_scene && series.in_scene->is_turned) {
        order = reversed_corners(shape.face_sizes);
    }
    if (!order.empty()) own = rows_in_order(own.data(), row_bytes, order);
    const std::string role = direction_role(*field);
    if (field->type.bytes == 8 && series.empty.IsHolding<VtVec3fArray>()) return VtValue(as_vec3f(own));
    VtValue found = field_value(*field, own);
    if (series.in_scene && !role.empty() && found.IsHolding<VtVec3fArray>()) {
        const Quantity quantity = role == "normal" ? Quantity::normals : Quantity::velocities;
        found = VtValue(in_own_space(series, code, found.UncheckedGet<VtVec3fArray>(), quantity));
    }
    return found;
}

template <class Made, class Make> std::shared_ptr<const Made> Evaluator::kept(const Key &key, const Make &make) const {
    {
        const std::lock_guard guard(lock_);
        if (const auto found = places_.find(key); found != places_.end()) {
            kept_.splice(kept_.begin(), kept_, found->second);
            return std::static_pointer_cast<const Made>(found->second->data);
        }
    }
    const auto made = std::make_shared<const Made>(make());
    const std::size_t bytes = sizeof(Kept) + made->size() * sizeof(typename Made::value_type);
    const std::lock_guard guard(lock_);
    if (places_.contains(key)) return made;  // another thread has made it, too
    kept_.push_front({key, made, bytes});
    places_[key] = kept_.begin();
    kept_bytes_ += bytes;
    while (kept_bytes_ > max_kept_ && kept_.size() > 1) {
        kept_bytes_ -= kept_.back().bytes;
        places_.erase(kept_.back().key);
        kept_.pop_back();
    }
    return made;
}

std::shared_ptr<const VtVec3fArray> Evaluator::vectors(Quantity quantity, const Run &run, int run_index, int object,
                                                       double time) const {
    return kept<VtVec3fArray>({quantity, run_index, object, std::bit_cast<std::uint64_t>(time)}, [&] {
        VtVec3fArray found(run.shapes()[object].vertex_count);
        pdeanim_error error;
        if (!found.empty()) {
            check(pdeanim_evaluate(run.handle(), library_quantity(quantity), &time, 1, object, found.data()->data(),
                                   &error),
                  error);
        }
        return found;
    });
}

std::shared_ptr<const std::vector<char>> Evaluator::field_rows(const Run &run, int run_index, const Field &field,
                                                               double time) const {
    return kept<std::vector<char>>({Quantity::field, run_index, field.index, std::bit_cast<std::uint64_t>(time)}, [&] {
        std::vector<char> found(field.rows * field.columns * field.type.bytes);
        pdeanim_error error;
        check(pdeanim_evaluate_field(run.handle(), field.index, &time, 1, 0, found.data(), found.size(), &error),
              error);
        return found;
    });
}

}  // namespace pdeanim_usd
