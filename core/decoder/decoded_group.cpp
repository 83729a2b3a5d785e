#include "decoder/decoded_group.hpp"

#include <algorithm>
#include <cmath>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <thread>

#include "coefficients/coefficients.hpp"
#include "time_functions/closed_form.hpp"
#include "time_functions/cosines.hpp"
#include "time_functions/time_functions.hpp"

namespace pdeanim {

namespace {

// In which coefficients are decoded: enough for another thread to have work soon, few enough to cost nothing.
constexpr i64 parts = 12;

// Each function divided by its length over all frames and axes; those that are all zero stay so. Squares are added up
// frame after frame, axis after axis.
void normalise(std::vector<double> &values, i64 functions) {
    std::vector<double> lengths(functions);
    for (std::size_t i = 0; i < values.size(); ++i) lengths[i % functions] += values[i] * values[i];
    for (double &length : lengths) length = length > 0.0 ? std::sqrt(length) : 1.0;
    for (std::size_t i = 0; i < values.size(); ++i) values[i] /= lengths[i % functions];
}

// cos(j pi (f + 1/2) / frames), orthonormal.
std::vector<double> cosines(i64 frames, i64 functions) {
    const std::vector<double> wave = cosine_wave(frames);
    const double scale = std::sqrt(2.0 / static_cast<double>(frames));
    std::vector<double> values;
    values.reserve(frames * functions);
    for (i64 frame = 0; frame < frames; ++frame) {
        for (i64 j = 0; j < functions; ++j) {
            const double value = wave[(2 * frame + 1) * j % (4 * frames)] * scale;
            values.push_back(j == 0 ? value * std::sqrt(0.5) : value);
        }
    }
    return values;
}

// For each axis, in the precision of the group's sums.
template <class Real> std::vector<Real> on_three_axes(const std::vector<double> &values, const Group &group) {
    const i64 own = group.time_axes(), functions = group.functions;
    std::vector<Real> found;
    found.reserve(group.frames * 3 * functions);
    for (i64 frame = 0; frame < group.frames; ++frame) {
        for (i64 axis = 0; axis < 3; ++axis) {
            const double *row = values.data() + (frame * own + (own == 3 ? axis : 0)) * functions;
            for (i64 j = 0; j < functions; ++j) found.push_back(static_cast<Real>(row[j]));
        }
    }
    return found;
}

Subbands view_of(const SubbandTable &table) { return {table.starts, table.kinds, table.parents}; }

// Decodes the coefficients part by part, and expands what is there: this thread decodes, others expand, and this one, too,
// when it is done.
class CoefficientPipeline {
public:
    CoefficientPipeline(const Group &group, std::span<const u8> chunk, const SpaceBasis &space)
        : group_(group), space_(space), subbands_(space.subbands()), quantised_(space.functions() * group.channels()),
          values_(quantised_.size()), expansion_(space, values_.data(), group.channels()),
          decoder_({view_of(subbands_), space.functions(), group.channels(), group.axes()}, chunk, quantised_) {}

    // Decode everything; `expand(first, end)` is called by whoever runs `work`.
    void decode() {
        const i64 elements = space_.elements().count();
        const i64 nodes = static_cast<i64>(subbands_.kinds.size()) - elements;
        const i64 cuts = std::min(parts, elements);
        try {
            for (i64 part = 0; part < cuts; ++part) {
                const i64 first = elements * part / cuts, end = elements * (part + 1) / cuts;
                decoder_.decode(nodes + end);
                if (part == 0) {
                    scale(0, subbands_.starts[nodes]);
                    expansion_.synthesise();
                }
                const std::lock_guard guard(lock_);
                ready_.push_back({first, end});
                changed_.notify_one();
            }
            decoder_.finish();
        } catch (...) {
            finish();
            throw;
        }
        finish();
    }

    // Expand parts until there are no more to come.
    template <class Real> void expand(Real *fields) {
        while (true) {
            std::pair<i64, i64> part;
            {
                std::unique_lock guard(lock_);
                changed_.wait(guard, [&] { return !ready_.empty() || is_done_; });
                if (ready_.empty()) return;
                part = ready_.back();
                ready_.pop_back();
            }
            const std::vector<i64> &starts = space_.elements().coefficient_starts;
            scale(starts[part.first], starts[part.second]);
            expansion_.expand(part.first, part.second, fields);
        }
    }

private:
    void finish() {
        const std::lock_guard guard(lock_);
        is_done_ = true;
        changed_.notify_all();
    }

    // From steps to scene units, for the functions of space `first` to `end` - 1.
    void scale(i64 first, i64 end) {
        for (i64 i = first * group_.channels(); i < end * group_.channels(); ++i) {
            values_[i] = static_cast<double>(quantised_[i]) * group_.step;
        }
    }

    const Group &group_;
    const SpaceBasis &space_;
    SubbandTable subbands_;
    std::vector<i64> quantised_;
    std::vector<double> values_;
    Expansion expansion_;
    CoefficientDecoder decoder_;
    std::mutex lock_;
    std::condition_variable changed_;
    std::vector<std::pair<i64, i64>> ready_;
    bool is_done_ = false;
};

template <class Real> GroupFunctions<Real> decode_functions(const Group &group,
                                                            const std::array<std::vector<u8>, 3> &chunks,
                                                            const SpaceBasis &space, std::span<const double> times,
                                                            i64 most_bytes, int threads, Residuals &residuals) {
    GroupFunctions<Real> found;
    found.fields.resize(group.channels() * space.vertices());
    CoefficientPipeline pipeline(group, chunks[1], space);
    const auto decode_rest = [&] {
        std::vector<double> values;
        if (group.is_sampled()) {
            const TimeShape shape{group.functions, group.frames, group.time_axes()};
            values = decode_time_functions(chunks[0], shape, group.time_step);
        }
        found.time = on_three_axes<Real>(functions_of_time(group, times, std::move(values)), group);
        residuals = decode_residuals(chunks[2], group.frames, space.elements().patches->starts, most_bytes);
    };
    if (threads < 2) {
        decode_rest();
        pipeline.decode();
        pipeline.expand(found.fields.data());
        return found;
    }
    std::exception_ptr failure;
    {
        std::jthread other([&] {
            try {
                decode_rest();
                pipeline.expand(found.fields.data());
            } catch (...) {
                failure = std::current_exception();
            }
        });
        pipeline.decode();
        pipeline.expand(found.fields.data());
    }
    if (failure) std::rethrow_exception(failure);
    return found;
}

}  // namespace

i64 DecodedGroup::bytes() const {
    const auto size = [](const auto &own) {
        return static_cast<i64>(own.time.size() * sizeof(own.time[0]) + own.fields.size() * sizeof(own.fields[0]));
    };
    return std::visit(size, functions) + residuals.bytes();
}

std::vector<double> functions_of_time(const Group &group, std::span<const double> times, std::vector<double> values) {
    if (group.is_sampled()) {
        normalise(values, group.functions);
        return values;
    }
    if (group.basis == TimeBasis::cosines) return cosines(group.frames, group.functions);
    const ClosedForm form(times, group.alpha, group.functions);
    std::vector<double> found;
    for (const double time : times) {
        const ClosedForm::Weights weights = form.weights(time);
        found.insert(found.end(), weights.begin(), weights.begin() + group.functions);
    }
    return found;
}

DecodedGroup decode_group(const Group &group, const std::array<std::vector<u8>, 3> &chunks, const SpaceBasis &space,
                          std::span<const double> times, i64 most_bytes, int threads) {
    DecodedGroup found;
    found.group = group;
    found.vertices = space.vertices();
    if (group.is_single) {
        found.functions = decode_functions<float>(group, chunks, space, times, most_bytes, threads, found.residuals);
    } else {
        found.functions = decode_functions<double>(group, chunks, space, times, most_bytes, threads, found.residuals);
    }
    return found;
}

std::vector<double> group_coefficients(const Group &group, std::span<const u8> chunk, const SpaceBasis &space) {
    const SubbandTable subbands = space.subbands();
    std::vector<i64> quantised(space.functions() * group.channels());
    CoefficientDecoder decoder({view_of(subbands), space.functions(), group.channels(), group.axes()}, chunk,
                               quantised);
    decoder.decode(static_cast<i64>(subbands.kinds.size()));
    decoder.finish();
    std::vector<double> found;
    found.reserve(quantised.size());
    for (const i64 number : quantised) found.push_back(static_cast<double>(number) * group.step);
    return found;
}

}  // namespace pdeanim
