// A group of frames as its chunks decode: functions of time, what they move, residuals.
#pragma once

#include <functional>
#include <span>
#include <variant>
#include <vector>

#include "decode/evaluate/motion.hpp"
#include "decode/group_coefficients.hpp"
#include "decode/group_table.hpp"
#include "sections/residuals/residuals.hpp"
#include "sections/spatial/space_basis.hpp"

namespace pdeanim {

struct DecodedGroup {
    // Memory that is counted for it.
    i64 bytes() const;

    // Functions of time at some of its frames in a row, the first one numbered as in the clip.
    std::span<const double> time_at(i64 frame, i64 frames) const {
        const i64 row = group.time_axes() * group.functions;
        return std::span(time).subspan((frame - group.first) * row, frames * row);
    }

    Group group;
    std::vector<double> time;  // functions of time at the frames, (frames, time axes, functions)
    std::variant<Motion<float>, Motion<double>> motion;  // in the precision of the group's sums
    Residuals residuals;
    TakenMemory taken;  // for functions of time and residuals
};

// Functions of time at the frames of a group, (frames, axes, functions): as many axes as they have values at a frame.
// times: of the group's frames [s]; values: as `decode_time_functions` gives them, for sampled bases.
std::vector<double> functions_of_time(const Group &group, std::span<const double> times, std::vector<double> values);

// What functions of time a group's chunk in TIME holds, for sampled bases; CorruptError where it is damaged.
std::vector<double> decode_group_times(const Group &group, std::span<const u8> chunk);

// What of a group others have begun with.
struct GroupBegun {
    std::function<std::vector<double>()> values;  // hands over those of `decode_group_times`, and may wait for them
    GroupCoefficients *coefficients = nullptr;    // which another thread decodes; none where nobody does
};

// Decode the chunks of a group. CorruptError where one is damaged, LimitError where it takes more than is left; `taken` has
// what its chunks and functions of time take. Coefficients are decoded while another thread is busy with the rest.
DecodedGroup decode_group(const Group &group, const Chunks &chunks, const SpaceBasis &space,
                          std::span<const double> times, TakenMemory taken, int threads, const GroupBegun &begun);

// The coefficients of a group [scene units]: (functions of space, functions of time, axes).
std::vector<double> group_coefficients(const Group &group, std::span<const u8> chunk, const SpaceBasis &space,
                                       TakenMemory taken);

}  // namespace pdeanim
