// Section SEQN: the times of the frames, where motion jumps, and what the names of objects are decoded from.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "entropy/text_model.hpp"

namespace pdeanim {

struct SequenceDescription {
    // Read the section. CorruptError where it is damaged, LimitError for more frames than there is room for.
    static SequenceDescription of_bytes(std::span<const u8> data, i64 most_frames);

    // Of one run of frames: its times, and the coded names of its objects.
    static SequenceDescription of_run(std::vector<double> times, std::vector<i64> jumps, double fps,
                                      std::vector<u8> names);

    // Names of so many objects; CorruptError if there are more or fewer.
    std::vector<std::string> names(i64 objects, const TakeMemory &take) const;

    std::vector<double> times;    // [s], increasing
    std::vector<i64> jumps;       // frames that motion from the frame before jumps to, increasing
    std::vector<i64> run_frames;  // of each run of frames
    double fps = 0.0;             // frames a second that the clip was made for

private:
    std::vector<u8> coded_;  // listed times, and names
    i64 listed_ = 0;         // how many times are listed
};

}  // namespace pdeanim
