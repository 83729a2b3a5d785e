#include "decode/sequence.hpp"

#include <cmath>

#include "decode/fields.hpp"
#include "sections/description/description.hpp"

namespace pdeanim {

namespace {

// How times are stored: start + i / rate, (start + i) / rate, one by one, or start + i (1 / rate), which rounds otherwise.
enum TimeRule : u8 { stepped, counted, listed, by_period };

// Added to the rule: its rate is the frame rate, which then is not stored again; the frame rate, or the start, is a whole
// number of 0 or more, and stored as a count; jumps follow.
constexpr u8 at_frame_rate = 4, whole_frame_rate = 8, whole_start = 16, has_jumps = 32;

constexpr double largest_time = 0x1p53, shortest_step = 0x1p-53;  // [s]

double read_real(FieldReader &fields, bool is_whole) {
    if (!is_whole) return fields.real();
    const i64 value = fields.count();
    if (value > i64{1} << 53) throw CorruptError("section SEQN has a whole number out of range");
    return static_cast<double>(value);
}

std::vector<i64> read_jumps(FieldReader &fields, i64 frames) {
    const i64 count = fields.count();
    if (count < 1 || count >= frames) {
        throw CorruptError("section SEQN has " + std::to_string(count) + " jumps in " + std::to_string(frames) +
                           " frames");
    }
    std::vector<i64> found;
    i64 at = 0;
    for (i64 k = 0; k < count; ++k) {
        const i64 gap = fields.count();
        if (gap < 1 || gap >= frames - at) throw CorruptError("section SEQN has a jump at no frame");
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
    if (runs < 1) throw CorruptError("section SEQN declares no run of frames");
    for (i64 run = 0; run < runs; ++run) {
        const i64 own = fields.count();
        if (own < 1) throw CorruptError("section SEQN declares no frames");
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
    if (!(found.fps > 0.0)) throw CorruptError("section SEQN has a frame rate that is not positive");
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
        throw CorruptError("section SEQN stores its times in an unknown way (" + std::to_string(flags) + ")");
    }
    if (!are_sound(found.times)) {
        throw CorruptError("section SEQN has times that do not increase or lie out of range");
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

}  // namespace pdeanim
