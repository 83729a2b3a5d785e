// A group of frames as its chunks decode: functions of time, what they move, residuals.
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

// The quantised coefficients of a group: one thread decodes them part by part, others make motion of what is there.
Subbands view_of(const SubbandTable &table);

class GroupCoefficients {
public:
    // The chunk of section COEF must outlive it. Memory of the coefficients is counted in `taken`.
    GroupCoefficients(const Group &group, std::span<const u8> chunk, std::shared_ptr<const SpaceLayout> layout,
                      TakenMemory taken);

    // Decode all, once. What goes wrong comes to those who take.
    void decode() noexcept;

    // Wait until all are decoded.
    void wait();

    // End decoding soon: nobody takes.
    void stop() { is_stopped_ = true; }

    // Make motion of each part when it is there, until no more are to come; any number of threads share them. CorruptError
    // where the bytes hold what cannot be.
    template <class Real> void take(Motion<Real> &motion);

private:
    enum class Tree { not_taken, being_taken, taken };  // what of the partition tree motion must have first

    void finish(std::exception_ptr failure);
    template <class Real> void take_tree(Motion<Real> &motion);

    std::shared_ptr<const SpaceLayout> layout_;
    CoefficientDecoder decoder_;
    std::mutex lock_;
    std::condition_variable changed_;
    std::vector<std::pair<i64, i64>> ready_;  // elements, first and end
    Tree tree_ = Tree::not_taken;
    bool is_done_ = false;
    std::atomic<bool> is_stopped_ = false;
    std::exception_ptr failure_;
};

struct DecodedGroup {
    // Memory that is counted for it.
    i64 bytes() const;

    // Functions of time at some of its frames in a row, the first one numbered as in the clip.
    std::span<const double> time_at(i64 frame, i64 frames) const {
        const i64 row = group.time_axes() * group.functions;
        return std::span(time).subspan((frame - group.first) * row, frames * row);
    }

    Group group;
    std::vector<double> time;  // functions of time at the frames, (frames, time axes, functions)
    std::variant<Motion<float>, Motion<double>> motion;  // in the precision of the group's sums
    Residuals residuals;
    TakenMemory taken;  // for functions of time and residuals
};

// Functions of time at the frames of a group, (frames, axes, functions): as many axes as they have values at a frame.
// times: of the group's frames [s]; values: as `decode_time_functions` gives them, for sampled bases.
std::vector<double> functions_of_time(const Group &group, std::span<const double> times, std::vector<double> values);

// What functions of time a group's chunk in TIME holds, for sampled bases; CorruptError where it is damaged.
std::vector<double> decode_group_times(const Group &group, std::span<const u8> chunk);

// What of a group others have begun with.
struct GroupBegun {
    std::function<std::vector<double>()> values;  // hands over those of `decode_group_times`, and may wait for them
    GroupCoefficients *coefficients = nullptr;    // which another thread decodes; none where nobody does
};

// Decode the chunks of a group. CorruptError where one is damaged, LimitError where it takes more than is left; `taken` has
// what its chunks and functions of time take. Coefficients are decoded while another thread is busy with the rest.
DecodedGroup decode_group(const Group &group, const Chunks &chunks, const SpaceBasis &space,
                          std::span<const double> times, TakenMemory taken, int threads, const GroupBegun &begun);

// The coefficients of a group [scene units]: (functions of space, functions of time, axes).
std::vector<double> group_coefficients(const Group &group, std::span<const u8> chunk, const SpaceBasis &space,
                                       TakenMemory taken);

}  // namespace pdeanim
