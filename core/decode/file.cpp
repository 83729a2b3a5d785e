#include "decode/file.hpp"

#include <algorithm>

#include "decode/fields.hpp"

namespace pdeanim {

namespace {

// Peak memory that a file declares. For each frame: its time as stored, its times in the core and in Python, and a row
// of the spline. For each run: the places of its sections, and its Python objects.
constexpr u64 bytes_per_frame = 128, bytes_per_run = 512;

constexpr std::string_view table = "RUNS", data = "RDAT", table_of_fields = "RFLD", of_cells = "SOLD";
constexpr std::array<std::string_view, 2> of_fields = {"FLDS", "FDAT"};

constexpr std::array<SectionType, Run::section_count> of_run =
    sections_where<Run::section_count>(&SectionType::in_runs);
constexpr std::size_t names_at = 0;

}  // namespace

File::File(std::unique_ptr<Source> source, u64 max_memory)
    : source_(std::move(source)), container_(*source_), memory_(max_memory) {
    container_.check_known();
    sequence_ = SequenceDescription::of_bytes(container_.read("SEQN"), static_cast<i64>(max_memory / bytes_per_frame));
    memory_.take(bytes_per_frame * frames(), std::to_string(frames()) + " frames");
    if (container_.find(table)) {
        read_runs();
        if (container_.find(table_of_fields)) read_fields_of_runs();
        if (container_.find(of_cells)) read_cells_of_runs();
        return;
    }
    if (sequence_.run_frames.size() != 1) {
        throw CorruptError(Section("SEQN"), "declares " + std::to_string(sequence_.run_frames.size()) +
                                                " runs of frames, but there is no section RUNS");
    }
    for (const std::string_view type : {data, of_run[names_at].name, table_of_fields}) {
        if (container_.find(type)) throw CorruptError(Section(type), "is present without a section RUNS");
    }
    runs_.push_back({.first = 0, .frames = frames()});
}

void File::read_runs() {
    for (const SectionType &type : of_run) {
        if (const SectionEntry *found = container_.find(type.name)) {
            throw CorruptError(Section(found->type), "is present next to section RUNS", FaultCode::section_content,
                               static_cast<i64>(found->offset));
        }
    }
    const std::size_t count = sequence_.run_frames.size();
    memory_.take(bytes_per_run * count, std::to_string(count) + " runs of frames");
    sequence_.names(0, [](i64) {});  // a file of several runs has no names, because each run has its own
    const std::vector<u8> bytes = container_.read(table);
    FieldReader fields(bytes, "RUNS");
    const SectionPlace &all = container_.entry(data);
    u64 at = all.offset, left = all.length;
    i64 first = 0;
    for (const i64 frames : sequence_.run_frames) {
        Run run{.first = first, .frames = frames, .vertices = fields.count()};
        if (run.vertices < 1 || run.vertices > Run::most_vertices) {
            throw CorruptError(Section("RUNS"), "declares " + std::to_string(run.vertices) + " vertices of run " +
                                                    std::to_string(runs_.size()));
        }
        for (std::size_t k = 0; k < of_run.size(); ++k) {
            const u64 stored = static_cast<u64>(fields.count());
            SectionPlace &place = run.places[k];
            if (stored == 0) {
                if (runs_.empty()) throw CorruptError(Section("RUNS"), "has a first run without one of its sections");
                place = runs_.back().places[k];
                continue;
            }
            place = {.offset = at, .length = stored - 1, .checksum = std::nullopt};
            if (place.length > left) {
                throw CorruptError(Section("RDAT"), "ends before its run " + std::to_string(runs_.size()) + " does");
            }
            if (place.length > 0 && !of_run[k].in_groups) place.checksum = fields.integer<u32>();
            at += place.length;
            left -= place.length;
        }
        first += frames;
        runs_.push_back(run);
    }
    fields.finish();
    if (left > 0) throw CorruptError(Section("RDAT"), "has " + std::to_string(left) + " bytes that belong to no run");
}

// Read section RFLD: the lengths of each run's parts of FLDS and FDAT, which follow each other in these sections.
void File::read_fields_of_runs() {
    const std::vector<u8> bytes = container_.read(table_of_fields);
    FieldReader fields(bytes, "RFLD");
    std::array<SectionPlace, 2> left = {container_.entry(of_fields[0]), container_.entry(of_fields[1])};
    if (left[0].length == 0) throw CorruptError(Section(of_fields[0]), "is missing; get the file again");
    for (Run &run : runs_) {
        for (std::size_t k = 0; k < left.size(); ++k) {
            SectionPlace &place = run.fields[k];
            place = {.offset = left[k].offset, .length = static_cast<u64>(fields.count()), .checksum = std::nullopt};
            if (place.length > left[k].length) throw CorruptError(Section(of_fields[k]), "ends before its runs do");
            left[k].offset += place.length;
            left[k].length -= place.length;
        }
        if (run.fields[0].length > 0) run.fields[0].checksum = fields.integer<u32>();
    }
    fields.finish();
    if (left[0].length + left[1].length > 0) throw CorruptError(Section("RFLD"), "leaves bytes of FLDS or FDAT out");
}

// Read section SOLD of a file of several runs: first the length of each run's part, or 0 if it equals the previous one;
// then the parts.
void File::read_cells_of_runs() {
    const std::vector<u8> bytes = container_.read(of_cells);
    if (bytes.empty()) return;  // as if it were missing
    FieldReader fields(bytes, "SOLD");
    std::vector<u64> counts;
    for (std::size_t run = 0; run < runs_.size(); ++run) counts.push_back(static_cast<u64>(fields.count()));
    u64 left = fields.rest().size();
    SectionPlace place{.offset = container_.entry(of_cells).offset + bytes.size() - left, .length = 0, .checksum = {}};
    for (std::size_t run = 0; run < runs_.size(); ++run) {
        if (counts[run] > 0) {
            place.offset += place.length;
            place.length = counts[run] - 1;
            if (place.length > left) throw CorruptError(Section("SOLD"), "ends before its runs do");
            left -= place.length;
        }
        runs_[run].cells = place;
    }
    if (left > 0) throw CorruptError(Section("SOLD"), "has " + std::to_string(left) + " bytes that belong to no run");
}

std::size_t File::run_of(i64 frame) const {
    const auto after = std::upper_bound(runs_.begin(), runs_.end(), frame,
                                        [](i64 wanted, const Run &run) { return wanted < run.first; });
    return static_cast<std::size_t>(after - runs_.begin()) - 1;
}

std::size_t File::run_at(double time) const {
    const std::vector<double> &times = sequence_.times;
    const auto after = std::upper_bound(times.begin(), times.end(), time);
    return after == times.begin() ? 0 : run_of(after - times.begin() - 1);
}

Container File::container_of(std::size_t run) const {
    if (!container_.find(table)) return container_;
    std::vector<SectionEntry> entries;
    for (std::size_t k = 0; k < of_run.size(); ++k) {
        entries.push_back({runs_[run].places[k], std::string(of_run[k].name), true});
    }
    for (std::size_t k = 0; runs_[run].fields[0].length > 0 && k < of_fields.size(); ++k) {
        entries.push_back({runs_[run].fields[k], std::string(of_fields[k]), false});
    }
    if (runs_[run].cells.length > 0) entries.push_back({runs_[run].cells, std::string(of_cells), true});
    return Container(*source_, std::move(entries));
}

SequenceDescription File::sequence_of(std::size_t run) const {
    if (!container_.find(table)) return sequence_;
    const i64 first = runs_[run].first, end = first + runs_[run].frames;
    const auto begin = sequence_.times.begin() + first;
    std::vector<i64> jumps;
    for (auto jump = std::upper_bound(sequence_.jumps.begin(), sequence_.jumps.end(), first);
         jump != sequence_.jumps.end() && *jump < end; ++jump) {
        jumps.push_back(*jump - first);
    }
    return SequenceDescription::of_run({begin, begin + runs_[run].frames}, std::move(jumps), sequence_.fps,
                                       container_of(run).read(of_run[names_at].name));
}

}  // namespace pdeanim
