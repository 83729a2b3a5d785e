#include "decode/stored_fields.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "decode/fields.hpp"
#include "entropy/text_model.hpp"
#include "sections/fields/field_chunk.hpp"

namespace pdeanim {

namespace {

constexpr i64 most_components = 1 << 16, longest_text = 1 << 16;

// Peak memory of a header or a group's row, most of it Python's.
constexpr u64 bytes_per_field = 4096, bytes_per_field_group = 256;

// Peak memory while a chunk is decoded, of each of its numbers: in a chunk of one frame, or with as many functions of
// time as frames, what the coder keeps of a frame is as large as all frames.
constexpr u64 bytes_at_work = 64;

// Computed frames that are kept: as many as a spline between two frames needs.
constexpr std::size_t most_computed = 64;

CorruptError wrong_header(const std::string &what) { return CorruptError(Section("FLDS"), what); }

std::string read_text(FieldReader &fields) {
    const i64 size = fields.count();
    if (size > longest_text) throw wrong_header("has a name of " + std::to_string(size) + " bytes");
    const std::span<const u8> bytes = fields.bytes(static_cast<std::size_t>(size));
    std::string text(bytes.begin(), bytes.end());
    if (!is_utf8(text)) throw wrong_header("has a name that is not UTF-8");
    return text;
}

FieldGroup read_field_group(FieldReader &fields, FieldType type, i64 left) {
    FieldGroup group;
    const u8 code = fields.integer<u8>();
    if (code >= field_codes) throw wrong_header("has a group of coding " + std::to_string(code) + ", which is unknown");
    group.code = FieldCode{code};
    group.frames = fields.count();
    if (group.frames < 1 || group.frames > left)
        throw wrong_header("has groups of more or fewer frames than there are");
    if (is_computed(group.code)) {
        if (has_source(group.code)) group.source = fields.count();
        if (group.code == FieldCode::copy) group.component = fields.count();
        return group;
    }
    group.skipped = fields.count();
    group.in_chunk = fields.count();
    if (group.in_chunk < 1 || group.in_chunk > limits::most_group_frames || group.skipped >= group.in_chunk) {
        throw wrong_header("has a chunk of " + std::to_string(group.in_chunk) + " frames, " +
                           std::to_string(group.skipped) + " of them skipped");
    }
    if (group.code == FieldCode::quantised) {
        group.unit = fields.real();
        if (!is_float(type) || !(group.unit > 0.0))
            throw wrong_header("has a unit that is not above 0, or of no float");
    }
    if (group.code == FieldCode::halves && size_of_type(type) != 8)
        throw wrong_header("has halves of a type of less than 64 bits");
    group.size = static_cast<u64>(fields.count());
    group.checksum = fields.integer<u32>();
    return group;
}

FieldHeader read_header(FieldReader &fields, i64 frames, i64 objects, i64 most_groups, u64 &at, u64 end) {
    FieldHeader header;
    header.name = read_text(fields);
    const u8 site = fields.integer<u8>(), type = fields.integer<u8>();
    if (site >= field_sites || type >= field_types) throw wrong_header("has a field of an unknown domain or type");
    header.site = FieldSite{site};
    header.type = FieldType{type};
    header.components = fields.count();
    if (header.components < 1 || header.components > most_components) {
        throw wrong_header("has a field of " + std::to_string(header.components) + " components");
    }
    header.unit = read_text(fields);
    const i64 owners = fields.count();
    if (owners > objects) throw wrong_header("has a field of more objects than there are");
    for (i64 k = 0, next = 0; k < owners; ++k) {
        const i64 step = fields.count();
        if (step >= objects - next) throw wrong_header("has a field of an object that does not exist");
        header.objects.push_back(next + step);
        next += step + 1;
    }
    header.smallest = fields.real();
    header.largest = fields.real();
    header.bound = fields.real();
    if (header.smallest > header.largest || header.bound < 0.0) throw wrong_header("has a range or a bound below 0");
    for (i64 first = 0; first < frames;) {
        if (static_cast<i64>(header.groups.size()) == most_groups) {
            throw LimitError("section FLDS has more groups of frames than the memory limit allows");
        }
        FieldGroup group = read_field_group(fields, header.type, frames - first);
        group.first = first;
        group.offset = at;
        if (group.size > end - at) throw CorruptError(Section("FDAT"), "is shorter than the fields say");
        at += group.size;
        first += group.frames;
        header.groups.push_back(group);
    }
    return header;
}

// Throw if a group of a field cannot be computed as it says.
void check_computed(const std::vector<FieldHeader> &headers, const FieldHeader &own, const FieldGroup &group) {
    if (!is_computed(group.code)) return;
    if (!has_source(group.code)) {
        if (!is_float(own.type) || own.site != FieldSite::vertex || own.components != 3 || !own.objects.empty())
            throw wrong_header("computes a field from the motion that is no vector of each vertex");
        return;
    }
    if (group.source >= static_cast<i64>(headers.size())) throw wrong_header("computes a field from none");
    const FieldHeader &source = headers[group.source];
    const bool is_copy = group.code == FieldCode::copy;
    const bool is_alike = source.site == own.site && source.objects == own.objects && source.type == own.type;
    const bool fits =
        is_copy ? group.component <= source.components - own.components : own.components == 1 && is_float(own.type);
    if (!is_alike || !fits) throw wrong_header("computes a field from one of another kind");
    for (const FieldGroup &other : source.groups) {
        if (has_source(other.code)) throw wrong_header("computes a field from one that is computed from a field");
    }
}

template <class T> void store(std::span<u8> out, std::size_t index, T value) {
    std::memcpy(out.data() + index * sizeof(T), &value, sizeof(T));
}

// The bits of a float whose ordered image is a whole number.
template <class Signed> Signed bits_of_ordered(Signed image) {
    return image >= 0 ? image : static_cast<Signed>(image ^ std::numeric_limits<Signed>::max());
}

// Kinds of values that are no numbers, as chunks have them; 3 is minus infinity.
constexpr u8 not_a_number = 1, plus_infinity = 2;

template <class Real> Real real_of(i64 value, u8 kind, double unit) {
    if (kind == not_a_number) return std::numeric_limits<Real>::quiet_NaN();
    if (kind)
        return kind == plus_infinity ? std::numeric_limits<Real>::infinity() : -std::numeric_limits<Real>::infinity();
    return static_cast<Real>(static_cast<double>(value) * unit);
}

// Write a chunk's numbers as values of a type.
void to_type(FieldType type, const FieldGroup &group, std::span<const i64> values, std::span<const u8> kinds,
             std::span<u8> out) {
    const std::size_t count = out.size() / static_cast<std::size_t>(size_of_type(type));
    const bool has_kinds = !kinds.empty();
    for (std::size_t i = 0; i < count; ++i) {
        i64 value = values[i];
        if (group.code == FieldCode::halves) {
            value = static_cast<i64>(static_cast<u64>(values[2 * i]) << 32 |
                                     (static_cast<u64>(values[2 * i + 1]) & 0xFFFFFFFFu));
        }
        const u8 kind = has_kinds ? kinds[i] : 0;
        switch (type) {
            case FieldType::f32:
                if (group.code == FieldCode::quantised) {
                    store(out, i, real_of<float>(value, kind, group.unit));
                } else {
                    store(out, i, bits_of_ordered(static_cast<i32>(value)));
                }
                break;
            case FieldType::f64:
                if (group.code == FieldCode::quantised) {
                    store(out, i, real_of<double>(value, kind, group.unit));
                } else {
                    store(out, i, bits_of_ordered(value));
                }
                break;
            case FieldType::i8:
            case FieldType::u8: store(out, i, static_cast<u8>(value)); break;
            case FieldType::i16:
            case FieldType::u16: store(out, i, static_cast<u16>(value)); break;
            case FieldType::i32:
            case FieldType::u32: store(out, i, static_cast<u32>(value)); break;
            case FieldType::i64:
            case FieldType::u64: store(out, i, value); break;
            case FieldType::boolean: store(out, i, static_cast<u8>(value != 0)); break;
        }
    }
}

}  // namespace

std::size_t FieldHeader::group_of(i64 frame) const {
    const auto after = std::upper_bound(groups.begin(), groups.end(), frame,
                                        [](i64 wanted, const FieldGroup &group) { return wanted < group.first; });
    return static_cast<std::size_t>(after - groups.begin()) - 1;
}

const std::vector<FieldHeader> &StoredFields::headers() {
    const auto guard = turns_.take();
    if (!headers_) {
        std::vector<FieldHeader> found;
        const std::vector<u8> data = run_.container().read_optional("FLDS");
        if (!data.empty()) {
            const SectionEntry &chunks = run_.container().entry("FDAT");
            FieldReader fields(data, "FLDS");
            u64 at = chunks.offset;
            const u64 end = chunks.offset + chunks.length;
            const i64 count = fields.count();
            for (i64 k = 0; k < count; ++k) {
                run_.memory().take(bytes_per_field + 8 * static_cast<u64>(run_.objects()), "fields");
                const i64 most = static_cast<i64>(run_.memory().left() / bytes_per_field_group);
                found.push_back(read_header(fields, run_.frames(), run_.objects(), most, at, end));
                run_.memory().take(bytes_per_field_group * found.back().groups.size(), "groups of frames of fields");
                for (std::size_t other = 0; other + 1 < found.size(); ++other) {
                    if (found[other].name == found.back().name) throw wrong_header("has two fields of one name");
                }
            }
            fields.finish();
            for (const FieldHeader &own : found) {
                for (const FieldGroup &group : own.groups) check_computed(found, own, group);
            }
            if (at != end) throw CorruptError(Section("FDAT"), "is longer than the fields say");
        }
        headers_ = std::move(found);
    }
    return *headers_;
}

const FieldDomain &StoredFields::domain(const FieldHeader &header) {
    const std::pair key(static_cast<int>(header.site), header.objects);
    auto found = domains_.find(key);
    if (found == domains_.end()) {
        std::vector<ConnectivityView> views;
        i64 next = 0;
        for (const ConnectivityView &view : run_.views()) {
            if (header.objects.empty() || std::binary_search(header.objects.begin(), header.objects.end(), next)) {
                views.push_back(view);
            }
            ++next;
        }
        found = domains_.emplace(key, FieldDomain(header.site, views)).first;
    }
    return found->second;
}

// Return the first row of an object in a field, and the number of its rows; without an object, the rows of all objects.
std::pair<i64, i64> StoredFields::rows_of(std::size_t field, std::optional<i64> object) {
    const FieldHeader &header = headers()[field];
    if (!object) return {0, domain(header).rows()};
    i64 first = 0, next = 0;
    for (const ConnectivityView &view : run_.views()) {
        const bool has_it =
            header.objects.empty() || std::binary_search(header.objects.begin(), header.objects.end(), next);
        const i64 sizes[field_sites] = {view.vertices, static_cast<i64>(view.face_sizes.size()),
                                        static_cast<i64>(view.face_indices.size()), 1};
        const i64 own = has_it ? sizes[static_cast<int>(header.site)] : 0;
        if (next++ == *object) return {first, own};
        first += own;
    }
    return {first, 0};
}

i64 StoredFields::rows(std::size_t field, std::optional<i64> object) {
    const auto guard = turns_.take();
    return rows_of(field, object).second;
}

std::vector<u8> StoredFields::chunk(const FieldGroup &group) {
    std::vector<u8> data;
    run_.container().read_range(group.offset, group.size, data);
    if (!is_checksum(crc32(data), group.checksum)) {
        throw CorruptError(Section("FDAT"),
                           "is damaged at frames " + std::to_string(group.first) + " to " +
                               std::to_string(group.first + group.frames - 1),
                           FaultCode::group_checksum, static_cast<i64>(group.offset));
    }
    return data;
}

// Return a part that is kept, which becomes the latest; none if it is not kept.
const std::vector<u8> *StoredFields::find(KeptParts &kept, std::size_t field, std::size_t part) {
    const auto place =
        std::find_if(kept.begin(), kept.end(), [&](const Kept &one) { return one.field == field && one.part == part; });
    if (place == kept.end()) return nullptr;
    kept.splice(kept.begin(), kept, place);
    return &kept.front().values;
}

// Return a decoded group; it stays until another one is requested.
const std::vector<u8> &StoredFields::group(std::size_t field, std::size_t index) {
    if (const std::vector<u8> *known = find(kept_, field, index)) return *known;
    turns_.check_cancelled();
    const FieldHeader &header = headers()[field];
    const FieldGroup &own = header.groups[index];
    const i64 rows = domain(header).rows(), numbers = own.code == FieldCode::halves ? 2 : 1;
    const u64 count = static_cast<u64>(own.in_chunk) * static_cast<u64>(rows) * static_cast<u64>(header.components);
    const u64 size = count * static_cast<u64>(size_of_type(header.type));
    const std::string what = "a group of field " + header.name;
    i64 kept_bytes = static_cast<i64>(size);
    for (const Kept &one : kept_) kept_bytes += static_cast<i64>(one.values.size());
    while (!kept_.empty() && kept_bytes > largest_budget_) {
        kept_bytes -= static_cast<i64>(kept_.back().values.size());
        kept_.pop_back();
    }
    TakenMemory taken(run_.memory(), size, what);
    const std::vector<u8> data = chunk(own);
    const TakenMemory at_work(run_.memory(),
                              bytes_at_work * count * static_cast<u64>(numbers) +
                                  field_predictor_bytes(data, rows, header.components * numbers),
                              what);
    std::vector<i64> values(count * static_cast<std::size_t>(numbers));
    std::vector<u8> kinds;
    decode_field_chunk(domain(header), data, own.in_chunk, static_cast<int>(header.components * numbers), values,
                       kinds);
    std::vector<u8> typed(size);
    to_type(header.type, own, values, kinds, typed);
    kept_.push_front({field, index, std::move(typed), std::move(taken)});
    return kept_.front().values;
}

// Compute one frame of a field of floats.
template <class Real>
void StoredFields::compute(const FieldHeader &header, const FieldGroup &group, i64 wanted, std::span<u8> out) {
    const std::size_t count = out.size() / sizeof(Real);
    if (group.code == FieldCode::magnitude) {
        const std::span<const u8> values = frame(group.source, wanted);
        const i64 columns = headers()[group.source].components;
        for (std::size_t i = 0; i < count; ++i) {
            double sum = 0.0;
            for (i64 k = 0; k < columns; ++k) {
                Real value;
                std::memcpy(&value, values.data() + (i * columns + k) * sizeof(Real), sizeof(Real));
                sum += static_cast<double>(value) * static_cast<double>(value);
            }
            store(out, i, static_cast<Real>(std::sqrt(sum)));
        }
        return;
    }
    const bool is_velocity = group.code == FieldCode::velocity;
    const TakenMemory taken(run_.memory(), count * sizeof(float), "field " + header.name);
    std::vector<float> found(count);
    if (!is_velocity || run_.frames() > 1) {
        evaluator_.evaluate_frame(is_velocity ? Quantity::velocities : Quantity::positions, wanted, found);
    }
    if (!is_velocity && first_positions_.empty()) {
        first_positions_.resize(count);
        evaluator_.evaluate_frame(Quantity::positions, 0, first_positions_);
    }
    for (std::size_t i = 0; i < count; ++i) {
        const double from = is_velocity ? 0.0 : static_cast<double>(first_positions_[i]);
        store(out, i, static_cast<Real>(static_cast<double>(found[i]) - from));
    }
}

// Return a frame of a group without a chunk; it stays until another one is requested.
std::span<const u8> StoredFields::computed_frame(std::size_t field, const FieldGroup &group, i64 wanted) {
    if (const std::vector<u8> *known = find(computed_, field, static_cast<std::size_t>(wanted))) return *known;
    turns_.check_cancelled();
    const FieldHeader &header = headers()[field];
    const std::size_t width = static_cast<std::size_t>(header.components * size_of_type(header.type));
    const std::size_t size = static_cast<std::size_t>(domain(header).rows()) * width;
    while (computed_.size() >= most_computed ||
           (!computed_.empty() && (computed_.size() + 1) * size > static_cast<u64>(largest_budget_))) {
        computed_.pop_back();
    }
    TakenMemory taken(run_.memory(), size, "field " + header.name);
    std::vector<u8> values(size);
    if (group.code == FieldCode::copy) {
        const std::span<const u8> from = frame(group.source, wanted);
        const std::size_t item = static_cast<std::size_t>(size_of_type(header.type));
        const std::size_t stride = static_cast<std::size_t>(headers()[group.source].components) * item;
        const std::size_t skip = static_cast<std::size_t>(group.component) * item;
        for (std::size_t at = 0, source = skip; at < size; at += width, source += stride) {
            std::memcpy(values.data() + at, from.data() + source, width);
        }
    } else if (header.type == FieldType::f32) {
        compute<float>(header, group, wanted, values);
    } else {
        compute<double>(header, group, wanted, values);
    }
    computed_.push_front({field, static_cast<std::size_t>(wanted), std::move(values), std::move(taken)});
    return computed_.front().values;
}

std::span<const u8> StoredFields::frame(std::size_t field, i64 wanted) {
    const FieldHeader &header = headers()[field];
    const std::size_t index = header.group_of(wanted);
    const FieldGroup &own = header.groups[index];
    if (is_computed(own.code)) return computed_frame(field, own, wanted);
    const std::vector<u8> &all = group(field, index);
    const std::size_t size = all.size() / static_cast<std::size_t>(own.in_chunk);
    const i64 inside = std::min(own.skipped + wanted - own.first, own.in_chunk - 1);
    return std::span(all).subspan(static_cast<std::size_t>(inside) * size, size);
}

void StoredFields::read(std::size_t field, i64 first, i64 frames, std::span<u8> out) {
    const auto guard = turns_.begin_call();
    for (i64 k = 0; k < frames; ++k) {
        const std::span<const u8> values = frame(field, first + k);
        std::copy(values.begin(), values.end(), out.begin() + k * static_cast<i64>(values.size()));
    }
}

// Write values between frames, from number `skip` of a frame on.
template <class Real>
void StoredFields::mix(std::size_t field, double time, int derivative, i64 skip, std::span<Real> out) {
    if (!spline_) spline_.emplace(run_.times(), run_.jumps());
    const FrameShares shares = spline_->shares(time, derivative);
    std::vector<double> sums(out.size(), 0.0);
    std::vector<Real> values(out.size());
    const auto load = [&](i64 wanted) {
        std::memcpy(values.data(), frame(field, wanted).data() + skip * sizeof(Real), out.size() * sizeof(Real));
    };
    for (std::size_t k = 0; k < shares.values.size(); ++k) {
        const double share = shares.values[k];
        if (share == 0.0) continue;
        load(shares.first + static_cast<i64>(k));
        for (std::size_t i = 0; i < sums.size(); ++i) sums[i] += share * static_cast<double>(values[i]);
    }
    load(run_.frame_at(time));
    for (std::size_t i = 0; i < sums.size(); ++i) {
        const bool is_number = std::isfinite(sums[i]);
        out[i] = is_number    ? static_cast<Real>(sums[i])
                 : derivative ? std::numeric_limits<Real>::quiet_NaN()
                              : values[i];
    }
}

void StoredFields::evaluate(std::size_t field, std::span<const double> times, int derivative, std::optional<i64> object,
                            std::span<u8> out) {
    const auto guard = turns_.begin_call();
    const FieldHeader &header = headers()[field];
    const auto [first, rows] = rows_of(field, object);
    const i64 skip = first * header.components, count = rows * header.components, size = size_of_type(header.type);
    const double start = run_.times().front(), end = run_.times().back();
    for (std::size_t k = 0; k < times.size(); ++k) {
        turns_.check_cancelled();
        if (std::isnan(times[k])) throw ArgumentError("a time is not a number");
        const double time = std::clamp(times[k], start, end);
        const bool is_still = times[k] != time || run_.frames() == 1;
        const i64 before = run_.frame_at(time);
        const std::span<u8> here =
            out.subspan(k * static_cast<std::size_t>(count * size), static_cast<std::size_t>(count * size));
        if (derivative && is_still) {
            std::fill(here.begin(), here.end(), u8{0});
        } else if (!derivative && (!is_float(header.type) || run_.times()[before] == time)) {
            const std::span<const u8> values =
                frame(field, before).subspan(static_cast<std::size_t>(skip * size), here.size());
            std::copy(values.begin(), values.end(), here.begin());
        } else if (header.type == FieldType::f32) {
            std::vector<float> found(static_cast<std::size_t>(count));
            mix<float>(field, time, derivative, skip, found);
            if (!found.empty()) std::memcpy(here.data(), found.data(), here.size());
        } else {
            std::vector<double> found(static_cast<std::size_t>(count));
            mix<double>(field, time, derivative, skip, found);
            if (!found.empty()) std::memcpy(here.data(), found.data(), here.size());
        }
    }
}

void StoredFields::check(std::size_t field, std::size_t index) {
    const auto guard = turns_.take();
    const FieldGroup &own = headers()[field].groups[index];
    if (is_computed(own.code)) {
        for (i64 k = 0; k < own.frames; ++k) frame(field, own.first + k);
    } else {
        chunk(own);
    }
}

void StoredFields::verify() {
    const auto guard = turns_.take();
    for (std::size_t field = 0; field < headers().size(); ++field) {
        for (std::size_t index = 0; index < headers()[field].groups.size(); ++index) {
            // Computed values have no bytes of their own.
            if (!is_computed(headers()[field].groups[index].code)) group(field, index);
        }
    }
}

}  // namespace pdeanim
