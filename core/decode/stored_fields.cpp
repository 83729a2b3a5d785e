#include "decode/stored_fields.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "decode/fields.hpp"
#include "sections/fields/field_chunk.hpp"

namespace pdeanim {

namespace {

// Peak memory per number of a chunk while it is decoded: in a chunk of one frame, or of as many functions of time as
// frames, the coder keeps several arrays as large as the whole chunk.
constexpr u64 decode_bytes_per_number = 64;

template <class T> void store(std::span<u8> out, std::size_t index, T value) {
    std::memcpy(out.data() + index * sizeof(T), &value, sizeof(T));
}

// Return the bits of a float from an integer. These integers have the same order as the floats.
template <class Signed> Signed bits_of_ordered(Signed image) {
    return image >= 0 ? image : static_cast<Signed>(image ^ std::numeric_limits<Signed>::max());
}

// Kinds of values that are not finite, as chunks store them; 3 is minus infinity.
constexpr u8 not_a_number = 1, plus_infinity = 2;

template <class Real> Real real_of(i64 value, u8 kind, double unit) {
    if (kind == not_a_number) return std::numeric_limits<Real>::quiet_NaN();
    if (kind)
        return kind == plus_infinity ? std::numeric_limits<Real>::infinity() : -std::numeric_limits<Real>::infinity();
    return static_cast<Real>(static_cast<double>(value) * unit);
}

// Write the numbers of a chunk as values of a type.
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

const std::vector<FieldHeader> &StoredFields::headers() {
    const auto guard = turns_.take();
    if (!headers_) {
        headers_ = read_field_headers(run_);
        row_counts_.resize(headers_->size());
    }
    return *headers_;
}

// Call visit(index, connectivity) for each object that has a field.
template <class Visit> void StoredFields::for_each_owner(const FieldHeader &header, const Visit &visit) {
    i64 index = 0;
    for (const ConnectivityView &view : run_.views()) {
        if (header.objects.empty() || std::binary_search(header.objects.begin(), header.objects.end(), index)) {
            visit(index, view);
        }
        ++index;
    }
}

// Return the rows of a field and their neighbours; valid until another part of the cache is requested.
const FieldRows &StoredFields::rows_with_neighbours(const FieldHeader &header) {
    const DecodedCache::Key key{DecodedCache::field_rows, header.first_of_rows, 0};
    if (const DecodedCache::Part *known = cache_.find(key)) return std::get<FieldRows>(*known);
    std::vector<ConnectivityView> views;
    for_each_owner(header, [&](i64, const ConnectivityView &view) { views.push_back(view); });
    TakenMemory taken = cache_.take(FieldRows::building_bytes(header.domain, views), "rows of fields");
    FieldRows found(header.domain, views);
    taken.keep(found.bytes());
    const u64 bytes = taken.bytes();
    return std::get<FieldRows>(cache_.keep(key, std::move(found), bytes, std::move(taken)));
}

// Return the first row and the number of rows of one object in a field; without an object, of all objects.
std::pair<i64, i64> StoredFields::rows_of(std::size_t field, std::optional<i64> object) {
    const FieldHeader &header = headers()[field];
    if (!object && row_counts_[field]) return {0, *row_counts_[field]};
    i64 first = 0, rows = 0;
    for_each_owner(header, [&](i64 index, const ConnectivityView &view) {
        const i64 own = element_count(header.domain, view);
        if (object && index < *object) first += own;
        if (!object || index == *object) rows += own;
    });
    if (!object) row_counts_[field] = rows;
    return {first, rows};
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

// Return the values of a decoded group; valid until another group is requested.
const std::vector<u8> &StoredFields::group(std::size_t field, std::size_t index) {
    const DecodedCache::Key key{DecodedCache::field_group, field, index};
    if (const DecodedCache::Part *known = cache_.find(key)) return std::get<std::vector<u8>>(*known);
    turns_.check_cancelled();
    const FieldHeader &header = headers()[field];
    const FieldGroup &own = header.groups[index];
    const i64 rows = rows_of(field, std::nullopt).second;
    const i64 components = header.components * (own.code == FieldCode::halves ? 2 : 1);
    const u64 frame_values = static_cast<u64>(rows) * static_cast<u64>(header.components);
    const u64 size = static_cast<u64>(own.in_chunk) * frame_values * static_cast<u64>(size_of_type(header.type));
    const u64 numbers = static_cast<u64>(own.in_chunk) * static_cast<u64>(rows) * static_cast<u64>(components);
    const std::string what = "a group of field " + header.name;
    TakenMemory taken = cache_.take(size, what);
    const std::vector<u8> data = chunk(own);
    const TakenMemory at_work =
        cache_.take(decode_bytes_per_number * numbers + field_predictor_bytes(data, rows, components), what);
    std::vector<i64> values(numbers);
    std::vector<u8> kinds;
    decode_field_chunk(rows_with_neighbours(header), data, own.in_chunk, static_cast<int>(components), values, kinds);
    std::vector<u8> typed(size);
    to_type(header.type, own, values, kinds, typed);
    return std::get<std::vector<u8>>(cache_.keep(key, std::move(typed), size, std::move(taken)));
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
    const std::string what = "field " + header.name;
    const TakenMemory taken = cache_.take(count * sizeof(float), what);
    std::vector<float> found(count);
    if (!is_velocity || run_.frames() > 1) {
        evaluator_.evaluate_frame(is_velocity ? Quantity::velocities : Quantity::positions, wanted, found);
    }
    if (!is_velocity && first_positions_.empty()) {
        of_first_positions_ = cache_.take(count * sizeof(float), what);
        std::vector<float> positions(count);
        evaluator_.evaluate_frame(Quantity::positions, 0, positions);
        first_positions_ = std::move(positions);
    }
    for (std::size_t i = 0; i < count; ++i) {
        const double from = is_velocity ? 0.0 : static_cast<double>(first_positions_[i]);
        store(out, i, static_cast<Real>(static_cast<double>(found[i]) - from));
    }
}

// Return a frame of a group that has no chunk; valid until another frame is requested.
std::span<const u8> StoredFields::computed_frame(std::size_t field, const FieldGroup &group, i64 wanted) {
    const DecodedCache::Key key{DecodedCache::field_frame, field, static_cast<std::size_t>(wanted)};
    if (const DecodedCache::Part *known = cache_.find(key)) return std::get<std::vector<u8>>(*known);
    turns_.check_cancelled();
    const FieldHeader &header = headers()[field];
    const std::size_t width = static_cast<std::size_t>(header.components * size_of_type(header.type));
    const std::size_t size = static_cast<std::size_t>(rows_of(field, std::nullopt).second) * width;
    TakenMemory taken = cache_.take(size, "field " + header.name);
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
    return std::get<std::vector<u8>>(cache_.keep(key, std::move(values), size, std::move(taken)));
}

// Return the values at a frame; valid until another frame is requested.
std::span<const u8> StoredFields::frame(std::size_t field, i64 wanted) {
    try {
        return decoded_frame(field, wanted);
    } catch (const LimitError &) {
        // The motion needs memory that the cache could not count beforehand: empty the cache and try again.
        if (cache_.is_empty()) throw;
    }
    cache_.clear();
    return decoded_frame(field, wanted);
}

std::span<const u8> StoredFields::decoded_frame(std::size_t field, i64 wanted) {
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

// Write values between frames; the first `skip` numbers of each frame are left out.
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

void StoredFields::check(std::size_t field, std::size_t index, bool deep) {
    const auto guard = turns_.take();
    const FieldGroup &own = headers()[field].groups[index];
    if (is_computed(own.code)) {
        for (i64 k = 0; deep && k < own.frames; ++k) frame(field, own.first + k);
    } else if (deep) {
        group(field, index);
    } else {
        chunk(own);
    }
}

void StoredFields::verify() {
    const auto guard = turns_.take();
    for (std::size_t field = 0; field < headers().size(); ++field) {
        for (std::size_t index = 0; index < headers()[field].groups.size(); ++index) {
            // Computed groups have no bytes to check.
            if (!is_computed(headers()[field].groups[index].code)) group(field, index);
        }
    }
}

}  // namespace pdeanim
