#include "decode/container.hpp"

#include <algorithm>
#include <array>

#include "decode/fields.hpp"

namespace pdeanim {

namespace {

// Modelled on PNG's: a byte that is not ASCII, the name, and line ends that a transfer as text would change.
constexpr std::array<u8, 12> identifier = {0x89, 'P', 'D', 'E', 'A', 'N', 'I', 'M', '\r', '\n', 0x1A, '\n'};
constexpr std::size_t header_size = 28, row_head = 5, checksum_size = 4;
constexpr u32 most_sections = 64;  // far more sections than this version defines: a larger number means damage
constexpr int length_at = 4;       // position, among a row's flag bits, of the width of its length
constexpr std::size_t most_length_bytes = 8;
constexpr u8 required = 1;                   // flag: a decoder that does not know the section must refuse the file
constexpr std::size_t piece_size = 1 << 20;  // checksums are computed over pieces of this size [bytes]

// Return the type of a section as text, with \xNN for bytes that are not ASCII.
std::string readable(std::span<const u8> bytes) {
    constexpr char digits[] = "0123456789abcdef";
    std::string text;
    for (const u8 byte : bytes) {
        if (byte < 128) {
            text += static_cast<char>(byte);
        } else {
            text += {'\\', 'x', digits[byte >> 4], digits[byte & 15]};
        }
    }
    return text;
}

}  // namespace

void Container::check_known() const {
    for (const SectionEntry &entry : entries_) {
        const auto is_known = [&](const SectionType &type) { return type.in_file && type.name == entry.type; };
        if (entry.is_required && std::none_of(section_types.begin(), section_types.end(), is_known)) {
            throw CorruptError(Section(entry.type), "is required, but this version does not know it; update pdecodec",
                               FaultCode::section_unknown_required, static_cast<i64>(entry.offset));
        }
    }
}

void Container::read_table() {
    std::vector<u8> header(header_size);
    header.resize(source_.read(0, header));
    const std::size_t shown = std::min(header.size(), identifier.size());
    if (header.empty() ||
        !std::equal(header.begin(), header.begin() + static_cast<std::ptrdiff_t>(shown), identifier.begin())) {
        throw CorruptError("not a .pdeanim file (its first bytes differ); pdecodec encode makes one",
                           FaultCode::identifier, 0);
    }
    if (header.size() < header_size) {
        throw CorruptError("ends inside its header; get it again", FaultCode::truncated,
                           static_cast<i64>(header.size()));
    }
    FieldReader fields(std::span<const u8>(header).subspan(identifier.size()), "header");
    const int major = fields.integer<u16>();
    fields.integer<u16>();  // skip the minor version: it concerns only data that an older decoder may ignore
    const u32 count = fields.integer<u32>(), table_checksum = fields.integer<u32>();
    if (!is_checksum(crc32(std::span<const u8>(header).first(header_size - checksum_size)), fields.integer<u32>())) {
        throw CorruptError("its header is damaged; get it again", FaultCode::header_checksum, 0);
    }
    if (major != major_version) {
        throw CorruptError("has format version " + std::to_string(major) + ", this decoder reads version " +
                               std::to_string(major_version) + "; update pdecodec",
                           FaultCode::version);
    }
    if (count > most_sections) {
        throw CorruptError(
            "declares " + std::to_string(count) + " sections, the most is " + std::to_string(most_sections),
            FaultCode::table);
    }
    std::vector<std::vector<u8>> rows;
    u64 offset = header_size;
    u32 checksum = 0;
    for (u32 i = 0; i < count; ++i) {
        rows.push_back(read_row(offset));
        offset += rows.back().size();
        checksum = crc32(rows.back(), checksum);
    }
    if (!is_checksum(checksum, table_checksum)) {
        throw CorruptError("its table of sections is damaged", FaultCode::table_checksum, header_size);
    }
    for (const std::vector<u8> &row : rows) {
        SectionEntry entry;
        entry.type = readable(std::span<const u8>(row).first(4));
        entry.is_required = row[4] & required;
        entry.offset = offset;
        for (std::size_t i = row.size() - checksum_size; i-- > row_head;) entry.length = entry.length << 8 | row[i];
        entry.checksum = FieldReader(std::span<const u8>(row).last(checksum_size), "table").integer<u32>();
        if (find(entry.type)) {
            throw CorruptError(Section(entry.type), "appears twice", FaultCode::table, static_cast<i64>(offset));
        }
        offset = entry.length > UINT64_MAX - offset ? UINT64_MAX : offset + entry.length;
        entries_.push_back(std::move(entry));
    }
    if (offset != source_.size()) {
        const bool is_short = offset > source_.size();
        throw CorruptError(std::string(is_short ? "is truncated" : "has bytes after its last section") + ": " +
                               std::to_string(source_.size()) + " bytes, but its table says " + std::to_string(offset) +
                               "; get it again",
                           is_short ? FaultCode::truncated : FaultCode::trailing_bytes,
                           static_cast<i64>(std::min(offset, source_.size())));
    }
}

std::vector<u8> Container::read_row(u64 offset) const {
    std::vector<u8> row(row_head + most_length_bytes + checksum_size);
    row.resize(source_.read(offset, row));
    const std::size_t size = row.size() >= row_head ? row[row_head - 1] >> length_at : most_length_bytes + 1;
    const std::size_t needed = row_head + size + checksum_size;
    if (size > most_length_bytes || row.size() < needed) {
        throw CorruptError("its table of sections is damaged", FaultCode::table, header_size);
    }
    row.resize(needed);
    return row;
}

const SectionEntry *Container::find(std::string_view type) const {
    for (const SectionEntry &entry : entries_) {
        if (entry.type == type) return &entry;
    }
    return nullptr;
}

const SectionEntry &Container::entry(std::string_view type) const {
    if (const SectionEntry *found = find(type)) return *found;
    throw CorruptError(Section(type), "is missing; get the file again");
}

std::vector<u8> Container::read(std::string_view type) const {
    const SectionEntry &found = entry(type);
    std::vector<u8> data;
    read_range(found.offset, found.length, data);
    if (found.checksum && !is_checksum(crc32(data), *found.checksum)) {
        throw CorruptError(Section(found.type), "is damaged; get the file again", FaultCode::section_checksum,
                           static_cast<i64>(found.offset));
    }
    return data;
}

std::vector<u8> Container::read_optional(std::string_view type) const {
    return find(type) ? read(type) : std::vector<u8>();
}

void Container::read_range(u64 offset, u64 length, std::vector<u8> &data) const {
    const std::size_t before = data.size();
    data.resize(before + static_cast<std::size_t>(length));
    const std::size_t count = source_.read(offset, std::span<u8>(data).subspan(before));
    if (count < length) {
        throw CorruptError("became shorter while it was read", FaultCode::truncated, static_cast<i64>(offset + count));
    }
}

void Container::check(const SectionEntry &entry) const {
    if (!entry.checksum) return;
    std::vector<u8> piece(static_cast<std::size_t>(std::min<u64>(entry.length, piece_size)));
    u32 checksum = 0;
    u64 done = 0;
    while (done < entry.length) {
        const std::size_t wanted = static_cast<std::size_t>(std::min<u64>(entry.length - done, piece_size));
        const std::size_t count = source_.read(entry.offset + done, std::span<u8>(piece).first(wanted));
        if (count == 0) break;
        checksum = crc32(std::span<const u8>(piece).first(count), checksum);
        done += count;
    }
    if (done < entry.length || !is_checksum(checksum, *entry.checksum)) {
        throw CorruptError(Section(entry.type), "is damaged; get the file again", FaultCode::section_checksum,
                           static_cast<i64>(entry.offset));
    }
}

void Container::verify() const {
    for (const SectionEntry &entry : entries_) check(entry);
}

}  // namespace pdeanim
