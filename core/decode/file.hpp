// A file as a whole: its container, its times, and the places of the sections of each run of frames.
//
// Nothing here changes after it is read: any number of threads may use it, with several open runs.
#pragma once

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "base/errors.hpp"
#include "decode/container.hpp"
#include "decode/headers.hpp"

namespace pdeanim {

// Consecutive frames of one connectivity.
struct Run {
    static constexpr std::size_t section_count = 10;
    static constexpr i64 most_vertices = (i64{1} << 31) - 1;  // vertices are numbered by int32

    i64 first = 0, frames = 0;  // index of the first frame, and number of frames
    i64 vertices = -1;          // number of vertices by section RUNS; -1 if the file lacks it
    std::array<SectionPlace, section_count> places{};
    std::array<SectionPlace, 2> fields{};  // the run's parts of FLDS and FDAT
    SectionPlace cells{};                  // the run's part of SOLD
};

class File {
public:
    static constexpr u64 usual_memory = u64{4} << 30;  // default limit on memory; enough for some five million vertices

    // Read the header, the times and the table of runs. CorruptError if the file is damaged, LimitError if it needs too
    // much memory.
    File(std::unique_ptr<Source> source, u64 max_memory);

    const Container &container() const { return container_; }
    const SequenceDescription &sequence() const { return sequence_; }
    const std::vector<Run> &runs() const { return runs_; }
    i64 frames() const { return static_cast<i64>(sequence_.times.size()); }

    // Return the limit on memory, less the memory of the headers.
    const MemoryLimit &memory() const { return memory_; }

    // Return the run at a time [s]: the last run whose first frame is not later, or the first run before that.
    std::size_t run_at(double time) const;

    // Return the run that has a frame.
    std::size_t run_of(i64 frame) const;

    // Return the sections of a run, as if the run were a file of its own.
    Container container_of(std::size_t run) const;
    SequenceDescription sequence_of(std::size_t run) const;

private:
    void read_runs();
    void read_fields_of_runs();
    void read_cells_of_runs();

    std::unique_ptr<Source> source_;
    Container container_;
    MemoryLimit memory_;
    SequenceDescription sequence_;
    std::vector<Run> runs_;
};

}  // namespace pdeanim
