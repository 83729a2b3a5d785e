#include "decode/headers.hpp"

#include <algorithm>
#include <cmath>

#include "decode/fields.hpp"
#include "sections/description/description.hpp"

namespace pdeanim {

namespace {

// How the time of frame i is stored: start + i / rate, (start + i) / rate, in a list, or start + i (1 / rate), which
// rounds differently.
enum TimeRule : u8 { stepped, counted, listed, by_period };

// Flags in addition to the rule: the rate is the frame rate, which is then stored once; the frame rate is a whole
// number, stored as a count; the start is such a number; discontinuities follow.
constexpr u8 at_frame_rate = 4, whole_frame_rate = 8, whole_start = 16, has_jumps = 32;

constexpr double largest_time = 0x1p53, shortest_step = 0x1p-53;  // [s]

double read_real(FieldReader &fields, bool is_whole) {
    if (!is_whole) return fields.real();
    const i64 value = fields.count();
    if (value > i64{1} << 53) throw CorruptError(Section("SEQN"), "has a whole number out of range");
    return static_cast<double>(value);
}

std::vector<i64> read_jumps(FieldReader &fields, i64 frames) {
    const i64 count = fields.count();
    if (count < 1 || count >= frames) {
        throw CorruptError(Section("SEQN"), "has " + std::to_string(count) + " discontinuities in " +
                                                std::to_string(frames) + " frames");
    }
    std::vector<i64> found;
    i64 at = 0;
    for (i64 k = 0; k < count; ++k) {
        const i64 gap = fields.count();
        if (gap < 1 || gap >= frames - at)
            throw CorruptError(Section("SEQN"), "has a discontinuity outside its frames");
        at += gap;
        found.push_back(at);
    }
    return found;
}

double ruled_time(u8 rule, double start, double rate, i64 frame) {
    const double step = static_cast<double>(frame);
    if (rule == by_period) return start + step * (1.0 / rate);
    return rule == stepped ? start + step / rate : (start + step) / rate;
}

bool are_sound(std::span<const double> times) {
    for (std::size_t i = 0; i < times.size(); ++i) {
        if (!(std::abs(times[i]) <= largest_time)) return false;
        if (i > 0 && !(times[i] - times[i - 1] >= shortest_step)) return false;
    }
    return true;
}

}  // namespace

SequenceDescription SequenceDescription::of_bytes(std::span<const u8> data, i64 most_frames) {
    FieldReader fields(data, "SEQN");
    SequenceDescription found;
    const i64 runs = fields.count();
    i64 frames = 0;
    if (runs < 1) throw CorruptError(Section("SEQN"), "declares no run of frames");
    for (i64 run = 0; run < runs; ++run) {
        const i64 own = fields.count();
        if (own < 1) throw CorruptError(Section("SEQN"), "declares no frames");
        if (own > most_frames - frames) {
            throw LimitError("section SEQN declares " + std::to_string(own) + " frames after " +
                             std::to_string(frames) + ", more than the memory limit allows");
        }
        frames += own;
        found.run_frames.push_back(own);
    }
    const u8 all_flags = fields.integer<u8>(), flags = all_flags & ~has_jumps;
    const u8 rule = flags & ~(at_frame_rate | whole_frame_rate | whole_start);
    found.fps = read_real(fields, flags & whole_frame_rate);
    if (!(found.fps > 0.0)) throw CorruptError(Section("SEQN"), "has a frame rate that is not positive");
    const auto keep_rest = [&] {
        if (all_flags & has_jumps) found.jumps = read_jumps(fields, frames);
        const std::span<const u8> rest = fields.rest();
        found.coded_.assign(rest.begin(), rest.end());
    };
    if ((flags | whole_frame_rate) == (listed | whole_frame_rate)) {
        keep_rest();
        found.listed_ = frames;
        found.times = decode_times(found.coded_, frames);
    } else if (rule == stepped || rule == counted || rule == by_period) {
        const double start = read_real(fields, flags & whole_start);
        const double rate = flags & at_frame_rate ? found.fps : fields.real();
        keep_rest();
        found.times.reserve(frames);
        for (i64 frame = 0; rate > 0.0 && frame < frames; ++frame) {
            found.times.push_back(ruled_time(rule, start, rate, frame));
        }
    }
    if (found.times.empty()) {
        throw CorruptError(Section("SEQN"), "stores its times in an unknown way (" + std::to_string(flags) + ")");
    }
    if (!are_sound(found.times)) {
        throw CorruptError(Section("SEQN"), "has times that do not increase or lie out of range");
    }
    return found;
}

SequenceDescription SequenceDescription::of_run(std::vector<double> times, std::vector<i64> jumps, double fps,
                                                std::vector<u8> names) {
    SequenceDescription found;
    found.run_frames = {static_cast<i64>(times.size())};
    found.times = std::move(times);
    found.jumps = std::move(jumps);
    found.fps = fps;
    found.coded_ = std::move(names);
    return found;
}

std::vector<std::string> SequenceDescription::names(i64 objects, const TakeMemory &take) const {
    return decode_names(coded_, listed_, objects, take);
}

namespace {

// Largest numbers of vertices (by the kind of basis) and of functions of an element. Building the functions takes time
// that grows with the square of their number.
constexpr i64 most_points[] = {256, 65535};
constexpr int most_functions = 128;
constexpr int thresholds = 8;
constexpr u8 has_still_vertices = 2;  // flag in the byte of the basis

}  // namespace

Model Model::of_bytes(std::span<const u8> data) {
    FieldReader fields(data, "MODL");
    const u8 flags = fields.integer<u8>();
    if (flags > (static_cast<u8>(SpaceKind::curve) | has_still_vertices)) {
        throw CorruptError(Section("MODL"), "names space basis " + std::to_string(flags) + ", which is unknown");
    }
    const u8 kind = flags & ~has_still_vertices;
    Model model;
    SpaceForm &form = model.form;
    form.kind = static_cast<SpaceKind>(kind);
    form.points = fields.count();
    form.functions = fields.integer<u8>();
    form.threshold = fields.integer<u8>();
    int affine = 1;
    if (form.kind == SpaceKind::curve) {
        form.rate = fields.real();
        affine = fields.integer<u8>();
    }
    form.is_affine = affine != 0;
    model.residual_step = fields.real();
    if (form.points < 1 || form.points > most_points[kind] || form.functions < 1 || form.functions > most_functions) {
        throw CorruptError(Section("MODL"), "has a patch size out of range");
    }
    if (form.threshold >= thresholds || affine > 1 || !(form.rate >= 0.0 && form.rate <= limits::largest_rate)) {
        throw CorruptError(Section("MODL"), "has a threshold, a rate or a kind of pieces out of range");
    }
    if (!(model.residual_step > 0.0 && model.residual_step <= limits::largest_step)) {
        throw CorruptError(Section("MODL"), "has a quantisation step out of range");
    }
    if (flags & has_still_vertices) {
        const i64 size = fields.count();
        const std::span<const u8> still = fields.bytes(static_cast<std::size_t>(size));
        model.still.assign(still.begin(), still.end());
        if (size == 0) throw CorruptError(Section("MODL"), "does not say which vertices stand still");
    }
    const std::span<const u8> layout = fields.rest();
    model.layout.assign(layout.begin(), layout.end());
    return model;
}

namespace {

constexpr std::array<SectionType, 3> chunk_sections = sections_where<3>(&SectionType::in_groups);
constexpr u8 is_double = 4, last_basis = 3;  // is_double: bit of a group's kind; positions are added up in float64
constexpr i64 closed_functions = 4;          // number of functions in Eq. 12

bool is_step(double step) { return step > 0.0 && step <= limits::largest_step; }

Group read_group(FieldReader &fields) {
    Group group;
    group.frames = fields.count();
    group.functions = fields.count();
    const u8 kind = fields.integer<u8>();
    if (group.frames < 1 || group.frames > limits::most_group_frames) {
        throw CorruptError(Section("GRUP"), "has a group of " + std::to_string(group.frames) + " frames, not 1 to " +
                                                std::to_string(limits::most_group_frames));
    }
    if ((kind & ~is_double) > last_basis) {
        throw CorruptError(Section("GRUP"), "has a group of kind " + std::to_string(kind) + ", which is unknown");
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
        throw CorruptError(Section("GRUP"), "has a quantisation step out of range");
    }
    if (!(group.alpha >= 0.0 && group.alpha <= limits::largest_rate)) {
        throw CorruptError(Section("GRUP"), "has an alpha outside 0 to 12");
    }
    group.sizes[1] = static_cast<u64>(fields.count());
    group.sizes[2] = static_cast<u64>(fields.count());
    group.checksum = fields.integer<u32>();
    const i64 most = group.basis == TimeBasis::closed_form ? std::min(group.frames, closed_functions)
                                                           : group.frames * group.time_axes();
    if (group.functions > most) {
        throw CorruptError(Section("GRUP"), "has " + std::to_string(group.functions) + " functions of time for " +
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
            // Beyond the size of the file the sum is capped; it cannot wrap before that.
            ends[i] = std::min(ends[i] + group.sizes[i], container.file_bytes() + 1);
        }
        left -= group.frames;
        groups_.push_back(group);
    }
    fields.finish();
    if (left < 0) {
        throw CorruptError(Section("SEQN"), "declares " + std::to_string(frames) + " frames, the groups have " +
                                                std::to_string(frames - left));
    }
    for (const Group &group : groups_) {
        if ((group.basis == TimeBasis::closed_form) != (groups_[0].basis == TimeBasis::closed_form)) {
            throw CorruptError(Section("GRUP"), "mixes groups in closed form with others");
        }
    }
    for (std::size_t i = 0; i < ends.size(); ++i) {
        if (container.entry(chunk_sections[i].name).length != ends[i]) {
            throw CorruptError(Section(chunk_sections[i].name), "has a length that differs from the sum of its groups");
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
        container.read_range(container.entry(chunk_sections[i].name).offset + group.offsets[i], group.sizes[i],
                             found[i]);
        checksum = crc32(found[i], checksum);
    }
    if (!is_checksum(checksum, group.checksum)) {
        CorruptError error("group " + std::to_string(index) + " is damaged; get the file again",
                           FaultCode::group_checksum);
        error.frame = group.first;
        throw error;
    }
    return found;
}

}  // namespace pdeanim
