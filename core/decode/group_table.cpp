#include "decode/group_table.hpp"

#include <algorithm>

#include "decode/crc32.hpp"
#include "decode/fields.hpp"
#include "decode/limits.hpp"

namespace pdeanim {

namespace {

constexpr std::array<std::string_view, 3> chunk_sections = {"TIME", "COEF", "CORR"};
constexpr u8 is_double = 4, last_basis = 3;  // bit of a group's kind: its positions are added up in float64
constexpr i64 closed_functions = 4;          // of Eq. 12

bool is_step(double step) { return step > 0.0 && step <= limits::largest_step; }

Group read_group(FieldReader &fields) {
    Group group;
    group.frames = fields.count();
    group.functions = fields.count();
    const u8 kind = fields.integer<u8>();
    if (group.frames < 1 || group.frames > limits::most_group_frames) {
        throw CorruptError("section GRUP has a group of " + std::to_string(group.frames) + " frames; 1 to " +
                           std::to_string(limits::most_group_frames) + " can be");
    }
    if ((kind & ~is_double) > last_basis) {
        throw CorruptError("section GRUP has a group of kind " + std::to_string(kind) + ", which is unknown");
    }
    group.basis = static_cast<TimeBasis>(kind & ~is_double);
    group.is_single = !(kind & is_double);
    group.step = group.time_step = fields.real();
    if (group.is_sampled()) {
        group.time_step = fields.real();
        group.sizes[0] = static_cast<u64>(fields.count());
    } else if (group.basis == TimeBasis::closed_form) {
        group.alpha = fields.real();
    }
    if (!is_step(group.step) || !is_step(group.time_step)) {
        throw CorruptError("section GRUP has a quantisation step out of range");
    }
    if (!(group.alpha >= 0.0 && group.alpha <= limits::largest_rate)) {
        throw CorruptError("section GRUP has an alpha outside 0 to 12");
    }
    group.sizes[1] = static_cast<u64>(fields.count());
    group.sizes[2] = static_cast<u64>(fields.count());
    group.checksum = fields.integer<u32>();
    const i64 most = group.basis == TimeBasis::closed_form ? std::min(group.frames, closed_functions)
                                                           : group.frames * group.time_axes();
    if (group.functions > most) {
        throw CorruptError("section GRUP has " + std::to_string(group.functions) + " functions of time for " +
                           std::to_string(group.frames) + " frames");
    }
    return group;
}

}  // namespace

GroupTable::GroupTable(const Container &container, i64 frames, i64 most_groups) {
    const std::vector<u8> data = container.read("GRUP");
    FieldReader fields(data, "GRUP");
    std::array<u64, 3> ends{};
    i64 left = frames;
    while (left > 0) {
        if (static_cast<i64>(groups_.size()) == most_groups) {
            throw LimitError("section GRUP has more than " + std::to_string(most_groups) +
                             " groups of frames, more than the memory limit allows");
        }
        Group group = read_group(fields);
        group.first = frames - left;
        group.offsets = ends;
        for (std::size_t i = 0; i < ends.size(); ++i) {
            // A sum beyond the file's size would wrap only after more groups than fit in a file.
            ends[i] = std::min(ends[i] + group.sizes[i], container.file_bytes() + 1);
        }
        left -= group.frames;
        groups_.push_back(group);
    }
    fields.finish();
    if (left < 0) {
        throw CorruptError("section SEQN declares " + std::to_string(frames) + " frames, the groups have " +
                           std::to_string(frames - left));
    }
    for (const Group &group : groups_) {
        if ((group.basis == TimeBasis::closed_form) != (groups_[0].basis == TimeBasis::closed_form)) {
            throw CorruptError("section GRUP has groups in closed form and others; a file has one or the other");
        }
    }
    for (std::size_t i = 0; i < ends.size(); ++i) {
        if (container.entry(chunk_sections[i]).length != ends[i]) {
            throw CorruptError("section " + std::string(chunk_sections[i]) + " has another length than the groups say");
        }
    }
}

std::size_t GroupTable::group_of(i64 frame) const {
    const auto after = std::upper_bound(groups_.begin(), groups_.end(), frame,
                                        [](i64 wanted, const Group &group) { return wanted < group.first; });
    return static_cast<std::size_t>(after - groups_.begin()) - 1;
}

Chunks GroupTable::chunks(const Container &container, std::size_t index) const {
    const Group &group = groups_[index];
    Chunks found;
    u32 checksum = 0;
    for (std::size_t i = 0; i < found.size(); ++i) {
        container.read_range(container.entry(chunk_sections[i]).offset + group.offsets[i], group.sizes[i], found[i]);
        checksum = crc32(found[i], checksum);
    }
    if (!is_checksum(checksum, group.checksum)) {
        throw CorruptError("group " + std::to_string(index) + " is damaged; get the file again", -1, group.first);
    }
    return found;
}

}  // namespace pdeanim
