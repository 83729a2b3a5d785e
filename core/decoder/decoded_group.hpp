// A group of frames as its chunks decode: functions of time, what they move, residuals.
#pragma once

#include <array>
#include <span>
#include <variant>
#include <vector>

#include "basis/space_basis.hpp"
#include "decoder/group_table.hpp"
#include "evaluate/motion.hpp"
#include "residuals/residuals.hpp"

namespace pdeanim {

struct DecodedGroup {
    i64 bytes() const;

    Group group;
    std::vector<double> time;  // functions of time at the frames, (frames, time axes, functions)
    std::variant<Motion<float>, Motion<double>> motion;  // in the precision of the group's sums
    Residuals residuals;
};

// Functions of time at the frames of a group, (frames, axes, functions): as many axes as they have values at a frame.
// times: of the group's frames [s]; values: as `decode_time_functions` gives them, for sampled bases.
std::vector<double> functions_of_time(const Group &group, std::span<const double> times, std::vector<double> values);

// Decode the chunks of a group in TIME, COEF and CORR. CorruptError where they are damaged, LimitError where residuals take
// more than `most_bytes`. Coefficients are decoded while another thread is busy with the rest.
DecodedGroup decode_group(const Group &group, const std::array<std::vector<u8>, 3> &chunks, const SpaceBasis &space,
                          std::span<const double> times, i64 most_bytes, int threads);

// The coefficients of a group [scene units]: (functions of space, functions of time, axes).
std::vector<double> group_coefficients(const Group &group, std::span<const u8> chunk, const SpaceBasis &space);

}  // namespace pdeanim
