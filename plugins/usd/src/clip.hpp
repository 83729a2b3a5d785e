// An open .pdeanim file: its times, its metadata, and its runs of frames, which are opened when they are needed.
#pragma once

#include <pdeanim.h>

#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <vector>

#include "carrier.hpp"
#include "shape.hpp"
#include "usd_headers.hpp"

namespace pdeanim_usd {

// What went wrong with a file, without the file's name.
struct Failure : std::runtime_error {
    using std::runtime_error::runtime_error;
};

// Raise Failure unless a function of the library succeeded.
void check(pdeanim_status status, const pdeanim_error &error);

// Return the content, of `length` bytes, of a stream that Zstandard compressed. Raise Failure, which calls it by a name, if
// it is damaged.
std::string decompressed(const void *data, std::size_t size, std::size_t length, const std::string &name);

// The bytes of a file, which every animation opened from it reads.
struct Source {
    std::shared_ptr<ArAsset> asset;
};

// An open run of frames and the shapes of its objects.
class Run {
public:
    Run(std::shared_ptr<const Source> source, pdeanim_animation *handle, bool changes);
    ~Run() { pdeanim_close(handle_); }
    Run(const Run &) = delete;

    pdeanim_animation *handle() const { return handle_; }
    const std::vector<Shape> &shapes() const { return shapes_; }
    const std::vector<Field> &fields() const { return fields_; }

private:
    std::shared_ptr<const Source> source_;
    pdeanim_animation *handle_;
    std::vector<Shape> shapes_;
    std::vector<Field> fields_;
};

class Clip {
public:
    // Open a file. `max_memory` is the largest memory that decoding may take, 0 for the library's own limit, and `max_kept`
    // the size of the cache of decoded groups [bytes]. Raise Failure if it cannot be read.
    Clip(const std::string &resolved_path, std::size_t max_memory, std::size_t max_kept);
    ~Clip() { pdeanim_close(handle_); }
    Clip(const Clip &) = delete;

    const std::string &path() const { return path_; }
    const std::vector<double> &times() const { return times_; }
    double frame_rate() const { return pdeanim_frame_rate(handle_); }
    int run_count() const { return static_cast<int>(pdeanim_run_count(handle_)); }
    int first_frame(int run) const { return static_cast<int>(pdeanim_first_frame_of_run(handle_, run)); }
    int run_at(double time) const { return static_cast<int>(pdeanim_run_at(handle_, time)); }

    // Return a run; opening one decodes its connectivity and attributes. The runs used last stay open.
    std::shared_ptr<const Run> run(int index) const;

    // Return the scene around the motion, NULL if there is none. Raise Failure if it is damaged.
    std::shared_ptr<const Carrier> carrier() const;

    // Return the texts that the source's program stored: up_axis, unit, ...
    std::map<std::string, std::string> metadata() const;

private:
    std::string path_;
    std::uint64_t max_memory_;
    std::shared_ptr<const Source> source_;
    pdeanim_animation *handle_ = nullptr;
    std::vector<double> times_;
    mutable std::mutex lock_;
    mutable std::list<std::pair<int, std::shared_ptr<const Run>>> open_runs_;  // the one used last first
};

}  // namespace pdeanim_usd
