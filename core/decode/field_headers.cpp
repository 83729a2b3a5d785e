#include "decode/field_headers.hpp"

#include <algorithm>
#include <set>
#include <tuple>

#include "decode/fields.hpp"
#include "entropy/text_model.hpp"

namespace pdeanim {

namespace {

constexpr i64 most_components = 1 << 16, longest_text = 1 << 16;

// Peak memory of a field's header, and of one of its groups, most of it in Python.
constexpr u64 bytes_per_field = 4096, bytes_per_field_group = 256;

CorruptError header_error(const std::string &what) { return CorruptError(Section("FLDS"), what); }

std::string read_text(FieldReader &fields) {
    const i64 size = fields.count();
    if (size > longest_text) throw header_error("has a name of " + std::to_string(size) + " bytes");
    const std::span<const u8> bytes = fields.bytes(static_cast<std::size_t>(size));
    std::string text(bytes.begin(), bytes.end());
    if (!is_utf8(text)) throw header_error("has a name that is not UTF-8");
    return text;
}

// Read the next group of a field. before: number of frames in the field's earlier groups; frames: number of frames of
// the clip.
FieldGroup read_field_group(FieldReader &fields, FieldType type, i64 before, i64 frames) {
    FieldGroup group;
    const u8 code = fields.integer<u8>();
    if (code >= field_codes) throw header_error("has a group of coding " + std::to_string(code) + ", which is unknown");
    group.code = FieldCode{code};
    group.frames = fields.count();
    if (group.frames < 1 || group.frames > frames - before) {
        throw header_error("has groups of frames that do not add up to the " + std::to_string(frames) +
                           " frames: one of " + std::to_string(group.frames) + " after " + std::to_string(before));
    }
    if (is_computed(group.code)) {
        if (has_source(group.code)) group.source = fields.count();
        if (group.code == FieldCode::copy) group.component = fields.count();
        return group;
    }
    group.skipped = fields.count();
    group.in_chunk = fields.count();
    if (group.in_chunk < 1 || group.in_chunk > limits::most_group_frames || group.skipped >= group.in_chunk) {
        throw header_error("has a chunk of " + std::to_string(group.in_chunk) + " frames, " +
                           std::to_string(group.skipped) + " of them skipped");
    }
    if (group.code == FieldCode::quantised) {
        group.unit = fields.real();
        if (!is_float(type) || !(group.unit > 0.0))
            throw header_error("has a step that is not positive, or a step for a type that is not float");
    }
    if (group.code == FieldCode::halves && size_of_type(type) != 8)
        throw header_error("has 32-bit halves for a type shorter than 64 bits");
    group.size = static_cast<u64>(fields.count());
    group.checksum = fields.integer<u32>();
    return group;
}

FieldHeader read_header(FieldReader &fields, i64 frames, i64 objects, i64 most_groups, u64 &at, u64 end) {
    FieldHeader header;
    header.name = read_text(fields);
    const u8 domain = fields.integer<u8>(), type = fields.integer<u8>();
    if (domain >= domain_count || type >= field_types) throw header_error("has a field of an unknown domain or type");
    header.domain = Domain{domain};
    header.type = FieldType{type};
    header.components = fields.count();
    if (header.components < 1 || header.components > most_components) {
        throw header_error("has a field of " + std::to_string(header.components) + " components");
    }
    header.unit = read_text(fields);
    const i64 owners = fields.count();
    if (owners > objects) throw header_error("has a field of more objects than there are");
    for (i64 k = 0, next = 0; k < owners; ++k) {
        const i64 step = fields.count();
        if (step >= objects - next) throw header_error("has a field of an object that does not exist");
        header.objects.push_back(next + step);
        next += step + 1;
    }
    header.smallest = fields.real();
    header.largest = fields.real();
    header.bound = fields.real();
    if (header.smallest > header.largest || header.bound < 0.0)
        throw header_error("has an inverted range or a negative bound");
    for (i64 first = 0; first < frames;) {
        if (static_cast<i64>(header.groups.size()) == most_groups) {
            throw LimitError("section FLDS has more groups of frames than the memory limit allows");
        }
        FieldGroup group = read_field_group(fields, header.type, first, frames);
        header.computes_from_field |= has_source(group.code);
        group.first = first;
        group.offset = at;
        if (group.size > end - at) throw CorruptError(Section("FDAT"), "is shorter than the fields say");
        at += group.size;
        first += group.frames;
        header.groups.push_back(group);
    }
    return header;
}

// Raise CorruptError if a group is computed from a source that does not exist or does not fit.
void check_computed(const std::vector<FieldHeader> &headers, const FieldHeader &own, const FieldGroup &group) {
    if (!is_computed(group.code)) return;
    if (!has_source(group.code)) {
        if (!is_float(own.type) || own.domain != Domain::vertex || own.components != 3 || !own.objects.empty())
            throw header_error("has a field computed from the motion; it must have 3 components per vertex");
        return;
    }
    if (group.source >= static_cast<i64>(headers.size()))
        throw header_error("has a field computed from a missing field");
    const FieldHeader &source = headers[group.source];
    const bool is_copy = group.code == FieldCode::copy;
    const bool is_alike = source.first_of_rows == own.first_of_rows && source.type == own.type;
    const bool fits =
        is_copy ? group.component <= source.components - own.components : own.components == 1 && is_float(own.type);
    if (!is_alike) throw header_error("has a field that differs from its source in domain, type or objects");
    if (!fits) throw header_error("has a field of components or a type that its source does not give");
    if (source.computes_from_field) throw header_error("has a field computed from one that is computed from a field");
}

}  // namespace

std::size_t FieldHeader::group_of(i64 frame) const {
    const auto after = std::upper_bound(groups.begin(), groups.end(), frame,
                                        [](i64 wanted, const FieldGroup &group) { return wanted < group.first; });
    return static_cast<std::size_t>(after - groups.begin()) - 1;
}

std::vector<FieldHeader> read_field_headers(RunSections &run) {
    std::vector<FieldHeader> found;
    const std::vector<u8> data = run.container().read_optional("FLDS");
    if (data.empty()) return found;
    const SectionEntry &chunks = run.container().entry("FDAT");
    FieldReader fields(data, "FLDS");
    std::set<std::string> names;
    u64 at = chunks.offset;
    const u64 end = chunks.offset + chunks.length;
    const i64 count = fields.count();
    for (i64 k = 0; k < count; ++k) {
        run.memory().take(bytes_per_field + 8 * static_cast<u64>(run.objects()), "fields");
        const i64 most = static_cast<i64>(run.memory().left() / bytes_per_field_group);
        found.push_back(read_header(fields, run.frames(), run.objects(), most, at, end));
        run.memory().take(bytes_per_field_group * found.back().groups.size(), "groups of frames of fields");
        if (!names.insert(found.back().name).second) throw header_error("has two fields of one name");
    }
    fields.finish();
    // Find the first field that has the same domain and objects.
    const auto is_before = [&](std::size_t a, std::size_t b) {
        return std::tie(found[a].domain, found[a].objects) < std::tie(found[b].domain, found[b].objects);
    };
    std::set<std::size_t, decltype(is_before)> first_fields(is_before);
    for (std::size_t k = 0; k < found.size(); ++k) found[k].first_of_rows = *first_fields.insert(k).first;
    for (const FieldHeader &own : found) {
        for (const FieldGroup &group : own.groups) check_computed(found, own, group);
    }
    if (at != end) throw CorruptError(Section("FDAT"), "is longer than the fields say");
    return found;
}

}  // namespace pdeanim
