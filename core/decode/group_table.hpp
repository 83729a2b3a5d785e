// Section GRUP: the groups of frames, and where their chunks lie in TIME, COEF and CORR.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "decode/container.hpp"

namespace pdeanim {

// Functions of time of a group: principal trajectories (one for each axis, one coefficient for all three), principal
// functions of time that all axes share, the cosines of Eq. 12 at its harmonics, or Eq. 12 at a rate alpha.
enum class TimeBasis { trajectories, shapes, cosines, closed_form };

// One group of frames.
struct Group {
    i64 first = 0, frames = 0;
    i64 functions = 0;  // of time
    TimeBasis basis = TimeBasis::trajectories;
    bool is_single = false;                 // its positions are added up in float32
    double step = 0.0;                      // quantisation step of the coefficients [scene units]
    double time_step = 0.0;                 // the same of the functions of time, where these are stored
    double alpha = 0.0;                     // rate of Eq. 12 over half the group
    std::array<u64, 3> offsets{}, sizes{};  // of its chunks in TIME, COEF and CORR
    u32 checksum = 0;                       // of the three

    bool is_sampled() const { return basis == TimeBasis::trajectories || basis == TimeBasis::shapes; }

    // Coefficients that a function of time has for each of space.
    int axes() const { return basis == TimeBasis::trajectories ? 1 : 3; }

    // Values that a function of time has at a frame.
    int time_axes() const { return basis == TimeBasis::trajectories ? 3 : 1; }

    // Channels: coefficients of one function of space.
    i64 channels() const { return functions * axes(); }

    // Of its chunks.
    u64 bytes() const { return sizes[0] + sizes[1] + sizes[2]; }
};

// The bytes of a group in TIME, COEF and CORR.
using Chunks = std::array<std::vector<u8>, 3>;

class GroupTable {
public:
    // Read section GRUP of a clip of so many frames; the chunks must fill their sections. LimitError for more groups than
    // there is room for.
    GroupTable(const Container &container, i64 frames, i64 most_groups);

    const std::vector<Group> &groups() const { return groups_; }

    // The group that a frame belongs to.
    std::size_t group_of(i64 frame) const;

    // The chunks of one group, checked.
    Chunks chunks(const Container &container, std::size_t group) const;

private:
    std::vector<Group> groups_;
};

}  // namespace pdeanim
