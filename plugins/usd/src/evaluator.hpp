// Values of attributes at any time, decoded when they are asked for.
#pragma once

#include <list>
#include <memory>
#include <mutex>
#include <string>
#include <tuple>
#include <vector>

#include "clip.hpp"
#include "placement.hpp"

namespace pdeanim_usd {

// A sample of a layer.
struct Sample {
    double time, code;  // [s], [time codes]
    int run;
};

// What varies: with each frame, but for `constant`, an attribute that is constant within a run, and `sampled`, a field at some
// of the samples of a scene.
enum class Quantity { points, velocities, accelerations, normals, extent, transform, field, constant, sampled };

// How a prim of a scene differs from the object of the file.
struct InScene {
    std::shared_ptr<const Placement> placement;  // NULL: its space is the scene's
    bool is_gathered = false;                    // whether it has a point for each point of the object's lines
    bool is_turned = false;                      // whether its faces have the corners of the object's in reverse order
};

// An attribute that varies.
struct Series {
    Quantity quantity;
    int shape;
    std::string name;  // of the field, or of the attribute that is constant within a run
    VtValue empty;     // the value where the shape, or what it has a value for, is missing
    std::shared_ptr<const std::vector<double>> codes;
    std::shared_ptr<const InScene> in_scene = nullptr;  // NULL outside of scenes
    std::map<double, double> times = {};                // of `sampled`: the time [s] of the frame for each time code
};

class Evaluator {
public:
    // Use the clip's frames, or, if `fps` is above 0, so many samples a second. `max_kept` is the size of the cache of
    // evaluated values [bytes], `rate` the number of time codes a second, 0 for what the clip says.
    Evaluator(std::shared_ptr<const Clip> clip, double fps, std::size_t max_kept, double rate = 0);

    const Clip &clip() const { return *clip_; }
    const std::vector<ShapeKey> &keys() const { return keys_; }
    const std::vector<Sample> &samples() const { return samples_; }
    double fps() const { return fps_; }
    double time_codes_per_second() const { return rate_; }
    const std::map<std::string, std::string> &metadata() const { return metadata_; }
    bool changes() const { return clip_->run_count() > 1; }

    // Return a shape in a run, or NULL if it is not there.
    const Shape *shape(const Run &run, int run_index, int shape) const;

    // Return whether a field has values for a shape in a run.
    const Field *field(const Run &run, int run_index, int shape, const std::string &name) const;

    // Return the value at a time code. Raise Failure if it cannot be decoded.
    VtValue value(const Series &series, double code) const;

private:
    using Key = std::tuple<Quantity, int, int, std::uint64_t>;  // with run, object or field, and the bits of the time
    struct Kept {
        Key key;
        std::shared_ptr<const void> data;
        std::size_t bytes;
    };

    double time_of(double code) const;
    VtVec3fArray in_own_space(const Series &series, double code, VtVec3fArray found, Quantity quantity) const;
    VtVec3fArray velocities_in_own_space(const Series &series, double code, VtVec3fArray found,
                                         const VtVec3fArray &points) const;
    VtValue field_at(const Series &series, const Run &run, int run_index, double time, double code) const;
    std::shared_ptr<const VtVec3fArray> vectors(Quantity quantity, const Run &run, int run_index, int object,
                                                double time) const;
    std::shared_ptr<const std::vector<char>> field_rows(const Run &run, int run_index, const Field &field,
                                                        double time) const;
    template <class Made, class Make> std::shared_ptr<const Made> kept(const Key &key, const Make &make) const;

    std::shared_ptr<const Clip> clip_;
    std::map<std::string, std::string> metadata_;
    double fps_, rate_;
    std::vector<Sample> samples_;
    std::vector<ShapeKey> keys_;
    std::vector<std::vector<int>> objects_;  // [shape][run], -1 if it is not there
    std::size_t max_kept_;
    mutable std::mutex lock_;
    mutable std::list<Kept> kept_;  // the value used last first
    mutable std::map<Key, std::list<Kept>::iterator> places_;
    mutable std::size_t kept_bytes_ = 0;
};

}  // namespace pdeanim_usd
