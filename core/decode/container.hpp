// The container: identifier, header, table of sections, sections (the specification's sections 1 to 3).
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "decode/source.hpp"

namespace pdeanim {

// Where a section is. What has no checksum here has one for each of its pieces.
struct SectionPlace {
    u64 offset = 0, length = 0;
    std::optional<u32> checksum;
};

// One row of the table of sections.
struct SectionEntry : SectionPlace {
    std::string type;  // four letters; bytes that are not ASCII are escaped
    bool is_required = false;
};

class Container {
public:
    static constexpr int major_version = 1, minor_version = 0;

    // Read header and table. CorruptError if this is no such file, or one that cannot be read.
    explicit Container(Source &source) : source_(source) { read_table(); }

    // Sections of a file that another table than its first one lists.
    Container(Source &source, std::vector<SectionEntry> entries) : source_(source), entries_(std::move(entries)) {}

    // CorruptError if there is a section that this decoder does not know, and must.
    void check_known() const;

    const std::vector<SectionEntry> &entries() const { return entries_; }
    u64 file_bytes() const { return source_.size(); }

    // The row of a section, or none.
    const SectionEntry *find(std::string_view type) const;

    // The row of a section; CorruptError if the file lacks it.
    const SectionEntry &entry(std::string_view type) const;

    // A whole section, checked; nothing where an optional one is not there.
    std::vector<u8> read(std::string_view type) const;
    std::vector<u8> read_optional(std::string_view type) const;

    // Bytes of the file as they are, added to `data`; the caller checks them.
    void read_range(u64 offset, u64 length, std::vector<u8> &data) const;

    // Check a section, without holding more than a piece of it.
    void check(const SectionEntry &entry) const;

    // Check every section, unknown ones too.
    void verify() const;

private:
    void read_table();
    std::vector<u8> read_row(u64 offset) const;

    Source &source_;
    std::vector<SectionEntry> entries_;
};

}  // namespace pdeanim
