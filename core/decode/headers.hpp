// Small sections that are read when a file or a run is opened: SEQN, MODL, GRUP.
#pragma once

#include <array>
#include <span>
#include <string>
#include <vector>

#include "base/errors.hpp"
#include "decode/container.hpp"
#include "entropy/text_model.hpp"
#include "sections/spatial/space_layout.hpp"

namespace pdeanim {

// Section SEQN: times of the frames, discontinuities, and the coded names of objects.
struct SequenceDescription {
    // Read the section. CorruptError if it is damaged, LimitError for more frames than there is room for.
    static SequenceDescription of_bytes(std::span<const u8> data, i64 most_frames);

    // Describe one run of frames: its times, and the coded names of its objects.
    static SequenceDescription of_run(std::vector<double> times, std::vector<i64> jumps, double fps,
                                      std::vector<u8> names);

    // Return the names of `objects` objects; CorruptError if there are more or fewer.
    std::vector<std::string> names(i64 objects, const TakeMemory &take) const;

    std::vector<double> times;    // [s], increasing
    std::vector<i64> jumps;       // frames before which the motion is discontinuous, increasing
    std::vector<i64> run_frames;  // number of frames of each run
    double fps = 0.0;             // nominal frames per second

private:
    std::vector<u8> coded_;  // listed times, and names
    i64 listed_ = 0;         // number of listed times
};

// Section MODL: the data that the space basis of a file is built from.
struct Model {
    SpaceForm form;
    double residual_step = 0.0;  // quantisation step of residuals [scene units]
    std::vector<u8> layout;      // layout of its functions, coded (`SpaceLayout`)

    // Read section MODL; CorruptError if a field is out of range.
    static Model of_bytes(std::span<const u8> data);
};

// Section GRUP: the groups of frames, and the places of their chunks in TIME, COEF and CORR.
//
// Functions of time of a group: principal trajectories (one per axis, one coefficient for all three), principal
// functions of time that all axes share, the cosines of Eq. 12 at its harmonics, or Eq. 12 at a rate alpha.
enum class TimeBasis { trajectories, shapes, cosines, closed_form };

// One group of frames.
struct Group {
    i64 first = 0, frames = 0;
    i64 functions = 0;  // number of functions of time
    TimeBasis basis = TimeBasis::trajectories;
    bool is_single = false;                 // its positions are added up in float32
    double step = 0.0;                      // quantisation step of the coefficients [scene units]
    double time_step = 0.0;                 // quantisation step of the functions of time, if they are stored
    double alpha = 0.0;                     // rate of Eq. 12 over half the group
    std::array<u64, 3> offsets{}, sizes{};  // where its chunks start in TIME, COEF and CORR, and how long they are
    u32 checksum = 0;                       // checksum of all three chunks together

    bool is_sampled() const { return basis == TimeBasis::trajectories || basis == TimeBasis::shapes; }

    // Coefficients per function of time and of space.
    int axes() const { return basis == TimeBasis::trajectories ? 1 : 3; }

    // Values of a function of time at a frame.
    int time_axes() const { return basis == TimeBasis::trajectories ? 3 : 1; }

    // Channels: coefficients per function of space.
    i64 channels() const { return functions * axes(); }

    // Bytes of its chunks.
    u64 bytes() const { return sizes[0] + sizes[1] + sizes[2]; }
};

// The bytes of a group in TIME, COEF and CORR.
using Chunks = std::array<std::vector<u8>, 3>;

class GroupTable {
public:
    // Read section GRUP of a clip of `frames` frames; the chunks must fill their sections. LimitError for more groups
    // than there is room for.
    GroupTable(const Container &container, i64 frames, i64 most_groups);

    const std::vector<Group> &groups() const { return groups_; }

    // The group of a frame.
    std::size_t group_of(i64 frame) const;

    // Read and check the chunks of one group.
    Chunks chunks(const Container &container, std::size_t group) const;

private:
    std::vector<Group> groups_;
};

}  // namespace pdeanim
