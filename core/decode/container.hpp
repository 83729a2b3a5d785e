// The container: identifier, header, table of sections, sections (the specification's sections 1 to 3).
#pragma once

#include <algorithm>
#include <array>
#include <functional>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/arithmetic.hpp"

namespace pdeanim {

// The bytes of a file: in memory, or read by a caller's function.
class Source {
public:
    virtual ~Source() = default;

    u64 size() const { return size_; }

    // Fill `into` with the bytes of the file from `offset` on; return the number of bytes read.
    virtual std::size_t read(u64 offset, std::span<u8> into) = 0;

protected:
    explicit Source(u64 size) : size_(size) {}

private:
    u64 size_;
};

// A whole file in memory, which must outlive the source.
class MemorySource : public Source {
public:
    explicit MemorySource(std::span<const u8> data) : Source(data.size()), data_(data) {}

    std::size_t read(u64 offset, std::span<u8> into) override {
        const u64 first = std::min<u64>(offset, data_.size());
        const std::size_t count = std::min(into.size(), data_.size() - static_cast<std::size_t>(first));
        std::copy_n(data_.data() + first, count, into.data());
        return count;
    }

private:
    std::span<const u8> data_;
};

// A file that is read by a function of the caller. The function returns the number of bytes it has read, which is
// smaller than `into` only at the end of the file. Groups are decoded in parallel, but a file has one read position:
// only one thread at a time calls the function.
class CallbackSource : public Source {
public:
    using Read = std::function<std::size_t(u64 offset, std::span<u8> into)>;

    CallbackSource(u64 size, Read read) : Source(size), read_(std::move(read)) {}

    std::size_t read(u64 offset, std::span<u8> into) override {
        const std::lock_guard guard(lock_);
        return read_(offset, into);
    }

private:
    Read read_;
    std::mutex lock_;
};

// A section type of this version: whether a file may have it, whether a run of a file with several runs may have it
// (runs list and store their sections in this order), and whether it consists of the chunks of groups, which have
// checksums of their own.
struct SectionType {
    std::string_view name;
    bool in_file, in_runs, in_groups;
};

inline constexpr std::array<SectionType, 19> section_types = {{{"META", true, false, false},
                                                               {"SEQN", true, false, false},
                                                               {"NAME", false, true, false},
                                                               {"CONN", true, true, false},
                                                               {"ORDR", true, true, false},
                                                               {"REST", true, true, false},
                                                               {"MODL", true, true, false},
                                                               {"GRUP", true, true, false},
                                                               {"TIME", true, true, true},
                                                               {"COEF", true, true, true},
                                                               {"CORR", true, true, true},
                                                               {"ATTR", true, true, false},
                                                               {"RUNS", true, false, false},
                                                               {"RDAT", true, false, false},
                                                               {"FLDS", true, false, false},
                                                               {"FDAT", true, false, false},
                                                               {"RFLD", true, false, false},
                                                               {"SOLD", true, false, false},
                                                               {"SCEN", true, false, false}}};

// Return the section types for which a flag is set.
template <std::size_t count> consteval std::array<SectionType, count> sections_where(bool SectionType::*is_so) {
    std::array<SectionType, count> found{};
    std::copy_if(section_types.begin(), section_types.end(), found.begin(),
                 [is_so](const SectionType &type) { return type.*is_so; });
    return found;
}

// The position of a section. If it has no checksum for the whole section, each of its chunks has one.
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
    static constexpr int major_version = 1;

    // Read the header and the table. CorruptError if the file is of another kind or damaged.
    explicit Container(Source &source) : source_(source) { read_table(); }

    // Use a given table, which lists the sections of one run of the file.
    Container(Source &source, std::vector<SectionEntry> entries) : source_(source), entries_(std::move(entries)) {}

    // Raise CorruptError if there is a section that a decoder must know but does not know.
    void check_known() const;

    const std::vector<SectionEntry> &entries() const { return entries_; }
    u64 file_bytes() const { return source_.size(); }

    // Return the row of a section, or null.
    const SectionEntry *find(std::string_view type) const;

    // Return the row of a section; CorruptError if the file lacks it.
    const SectionEntry &entry(std::string_view type) const;

    // Read a whole section and verify its checksum; empty if it is missing and optional.
    std::vector<u8> read(std::string_view type) const;
    std::vector<u8> read_optional(std::string_view type) const;

    // Append bytes of the file to `data`, without verifying a checksum.
    void read_range(u64 offset, u64 length, std::vector<u8> &data) const;

    // Verify the checksum of a section, in pieces of bounded memory.
    void check(const SectionEntry &entry) const;

    // Verify the checksums of all sections, unknown ones too.
    void verify() const;

private:
    void read_table();
    std::vector<u8> read_row(u64 offset) const;

    Source &source_;
    std::vector<SectionEntry> entries_;
};

}  // namespace pdeanim
