// The decoder: a run of frames of an open file. Begin here. From the bytes to a position:
//
// - container.hpp: source of the bytes, and the table of sections; fields.hpp reads numbers from a section
// - file.hpp: a file: its times, and the places of the sections of each run; headers.hpp: SEQN, MODL, GRUP
// - run_sections.hpp: names, connectivity, reference frame, attributes and space basis of a run, decoded on first use
// - decoded_cache.hpp: decoded parts of motion and fields, within one byte budget
// - group_cache.hpp: decodes groups of frames; groups_ahead.hpp reads them ahead, decoded_group.hpp decodes one
// - evaluator.hpp: positions, velocities, accelerations at times, from groups; evaluate/ has the loops
// - stored_fields.hpp: values that change in time on vertices, faces, corners, objects or cells; field_headers.hpp reads
//   their headers (FLDS)
//
// core/bindings/ exposes all of it to C, Python and WebAssembly.
#pragma once

#include <thread>

#include "decode/evaluator.hpp"
#include "decode/stored_fields.hpp"

namespace pdeanim {

class Animation {
public:
    static constexpr i64 usual_kept = i64{512} << 20;

    struct Options {
        int threads = 0;              // number of threads; 0: one per processor
        i64 kept_bytes = usual_kept;  // byte budget of the cache of decoded parts, fields included
        Turns::Cancels cancels;       // shared with other animations that are cancelled together; null: not shared
    };

    // Read the headers of a run. CorruptError if it is damaged, LimitError if it needs more memory than the file has
    // left.
    Animation(std::shared_ptr<const File> file, std::size_t run, const Options &options)
        : turns_(options.cancels), sections_(std::move(file), run, threads_of(options), turns_),
          cache_(sections_.memory(), options.kept_bytes), groups_(sections_, cache_, turns_),
          evaluator_(sections_, groups_, turns_), fields_(sections_, groups_, evaluator_, turns_),
          stored_fields_(sections_, cache_, evaluator_, turns_) {}

    // Check every byte, and decode everything.
    void verify() {
        const auto guard = turns_.begin_call();
        check_sections(sections_.container());
        // A file of runs with a single run is opened as that run, and has further sections.
        const File &file = sections_.file();
        if (file.runs().size() == 1 && file.container().find("RUNS")) check_sections(file.container());
        sections_.names();
        sections_.reference();
        turns_.check_cancelled();
        sections_.attributes();
        sections_.remarks();
        for (std::size_t index = 0; index < sections_.table().groups().size(); ++index) groups_.group(index);
        stored_fields_.verify();
    }

    // Exclude other callers during several related calls.
    std::unique_lock<std::recursive_mutex> locked() { return turns_.take(); }

    // Make running calls end with a CancelledError; later calls are not affected.
    void cancel() { turns_.cancel(); }

    const RunSections &sections() const { return sections_; }
    RunSections &sections() { return sections_; }
    Evaluator &evaluator() { return evaluator_; }
    GroupFields &fields() { return fields_; }
    StoredFields &stored_fields() { return stored_fields_; }

private:
    void check_sections(const Container &container) {
        for (const SectionEntry &entry : container.entries()) {
            turns_.check_cancelled();
            container.check(entry);
        }
    }

    static int threads_of(const Options &options) {
        return options.threads > 0 ? options.threads : static_cast<int>(most(std::thread::hardware_concurrency(), 1u));
    }

    Turns turns_;
    RunSections sections_;
    DecodedCache cache_;
    GroupCache groups_;
    Evaluator evaluator_;
    GroupFields fields_;
    StoredFields stored_fields_;
};

}  // namespace pdeanim
