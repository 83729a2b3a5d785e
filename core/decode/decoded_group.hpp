// A decoded group of frames: its functions of time, the motion that they cause, and its residuals.
#pragma once

#include <atomic>
#include <condition_variable>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <span>
#include <utility>
#include <variant>
#include <vector>

#include "decode/evaluate/motion.hpp"
#include "decode/headers.hpp"
#include "sections/coefficients/coefficients.hpp"
#include "sections/residuals/residuals.hpp"
#include "sections/spatial/space_basis.hpp"
#include "sections/spatial/space_layout.hpp"

namespace pdeanim {

Subbands view_of(const SubbandTable &table);

// The quantised coefficients of a group: one thread decodes them part by part, while others turn finished parts into
// motion.
class GroupCoefficients {
public:
    // The chunk of section COEF must outlive this object. Memory of the coefficients is counted in `taken`.
    GroupCoefficients(const Group &group, std::span<const u8> chunk, std::shared_ptr<const SpaceLayout> layout,
                      TakenMemory taken);

    // Decode all parts, once. Errors are raised in the threads that call `take`.
    void decode() noexcept;

    // Wait until all parts are decoded.
    void wait();

    // Stop decoding soon; call it when no thread is in `take`.
    void stop() { is_stopped_ = true; }

    // Add each part to the motion as soon as it is decoded, and return after the last one; several threads may share
    // this work. CorruptError if the bytes are damaged.
    template <class Real> void take(Motion<Real> &motion);

private:
    enum class Tree {
        not_taken,
        being_taken,
        taken
    };  // the state of the coefficients of the partition tree, which motion needs first

    void finish(std::exception_ptr failure);
    template <class Real> void take_tree(Motion<Real> &motion);

    std::shared_ptr<const SpaceLayout> layout_;
    CoefficientDecoder decoder_;
    std::mutex lock_;
    std::condition_variable changed_;
    std::vector<std::pair<i64, i64>> ready_;  // decoded elements: first and end of each part
    Tree tree_ = Tree::not_taken;
    bool is_done_ = false;
    std::atomic<bool> is_stopped_ = false;
    std::exception_ptr failure_;
};

struct DecodedGroup {
    // Return its size in the cache in bytes.
    i64 bytes() const;

    // Return the functions of time at consecutive frames. `frame` is the index of the first one in the clip.
    std::span<const double> time_at(i64 frame, i64 frames) const {
        const i64 row = group.time_axes() * group.functions;
        return std::span(time).subspan((frame - group.first) * row, frames * row);
    }

    Group group;
    std::vector<double> time;  // functions of time at all frames: (frames, time axes, functions)
    std::variant<Motion<float>, Motion<double>> motion;  // in the precision of the group's sums
    Residuals residuals;
    TakenMemory taken;  // memory of the functions of time and of the residuals
};

// Return the functions of time at the frames of a group: (frames, time axes, functions). times: of the group's frames
// [s]; values: the result of `decode_group_times`, used only by sampled bases.
std::vector<double> functions_of_time(const Group &group, std::span<const double> times, std::vector<double> values);

// Decode the functions of time of a sampled basis from a group's chunk of section TIME; CorruptError if it is damaged.
std::vector<double> decode_group_times(const Group &group, std::span<const u8> chunk);

// Parts of a group that other threads have begun to decode.
struct GroupBegun {
    std::function<std::vector<double>()> values;  // returns the result of `decode_group_times`, perhaps after waiting
    GroupCoefficients *coefficients = nullptr;    // null if no other thread decodes them
};

// Decode the chunks of a group. CorruptError if one is damaged, LimitError if memory runs out; `taken` counts the
// memory of its chunks and functions of time. Coefficients are decoded while another thread handles the rest.
DecodedGroup decode_group(const Group &group, const Chunks &chunks, const SpaceBasis &space,
                          std::span<const double> times, TakenMemory taken, int threads, const GroupBegun &begun);

// Return the coefficients of a group [scene units]: (functions of space, functions of time, axes).
std::vector<double> group_coefficients(const Group &group, std::span<const u8> chunk, const SpaceBasis &space,
                                       TakenMemory taken);

}  // namespace pdeanim
