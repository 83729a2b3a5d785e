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
    // Read the section. CorruptError if it is damaged, LimitError if it has more than `most_frames` frames.
    static SequenceDescription of_bytes(std::span<const u8> data, i64 most_frames);

    // Describe one run of frames: its times, and the coded names of its objects.
    static SequenceDescription of_run(std::vector<double> times, std::vector<i64> jumps, double fps,
                                      std::vector<u8> names);

    // Return the names of the objects; CorruptError unless there are `objects` of them.
    std::vector<std::string> names(i64 objects, const TakeMemory &take) const;

    std::vector<double> times;    // [s], increasing
    std::vector<i64> jumps;       // frames before which the motion is discontinuous, increasing
    std::vector<i64> run_frames;  // number of frames of each run
    double fps = 0.0;             // nominal frames per second

private:
    std::vector<u8> coded_;  // listed times and names, still coded
    i64 listed_ = 0;         // number of times in the list
};

// Section MODL: the parameters that the space basis is built from.
struct Model {
    SpaceForm form;
    double residual_step = 0.0;  // quantisation step of residuals [scene units]
    std::vector<u8> still;       // which vertices stand still, coded (`decode_still`); empty if none does
    std::vector<u8> layout;      // layout of the functions of space, coded (`SpaceLayout`)

    // Read section MODL; CorruptError if a field is out of range.
    static Model of_bytes(std::span<const u8> data);
};

// Section GRUP: the groups of frames, and the places of their chunks in TIME, COEF and CORR.
//
// Kinds of a group's functions of time: principal trajectories (values per axis, one coefficient for all three axes),
// principal functions of time that all axes share, the cosines of Eq. 12 at its harmonics, or Eq. 12 at a rate alpha.
enum class TimeBasis { trajectories, shapes, cosines, closed_form };

// One group of frames.
struct Group {
    i64 first = 0, frames = 0;
    i64 functions = 0;  // number of functions of time
    TimeBasis basis = TimeBasis::trajectories;
    bool is_single = false;                 // whether positions are added up in float32
    double step = 0.0;                      // quantisation step of the coefficients [scene units]
    double time_step = 0.0;                 // quantisation step of the functions of time, if they are stored
    double alpha = 0.0;                     // rate alpha of Eq. 12 over half the length of the group
    std::array<u64, 3> offsets{}, sizes{};  // where its chunks start in TIME, COEF and CORR, and how long they are
    u32 checksum = 0;                       // checksum of all three chunks together

    bool is_sampled() const { return basis == TimeBasis::trajectories || basis == TimeBasis::shapes; }

    // Number of coefficients per pair of functions of time and space.
    int axes() const { return basis == TimeBasis::trajectories ? 1 : 3; }

    // Number of values of a function of time at a frame.
    int time_axes() const { return basis == TimeBasis::trajectories ? 3 : 1; }

    // Number of channels, which are the coefficients per function of space.
    i64 channels() const { return functions * axes(); }

    // Size of its chunks [bytes].
    u64 bytes() const { return sizes[0] + sizes[1] + sizes[2]; }
};

// The chunks of a group in TIME, COEF and CORR.
using Chunks = std::array<std::vector<u8>, 3>;

class GroupTable {
public:
    // Read section GRUP of a clip of `frames` frames; the chunks must fill their sections. LimitError if it has more
    // than `most_groups` groups.
    GroupTable(const Container &container, i64 frames, i64 most_groups);

    const std::vector<Group> &groups() const { return groups_; }

    // Return the group that has a frame.
    std::size_t group_of(i64 frame) const;

    // Read the chunks of one group and verify their checksum.
    Chunks chunks(const Container &container, std::size_t group) const;

private:
    std::vector<Group> groups_;
};

}  // namespace pdeanim
