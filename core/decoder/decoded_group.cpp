#include "decoder/decoded_group.hpp"

#include <algorithm>
#include <cmath>
#include <condition_variable>
#include <cstdlib>
#include <exception>
#include <memory>
#include <mutex>
#include <new>
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

// Numbers that are zero at first. Memory that is never written to is never there: most rows of coefficients are all zero.
class Zeros {
public:
    explicit Zeros(i64 count)
        : count_(count), values_(static_cast<i64 *>(std::calloc(most<i64>(count, 1), sizeof(i64)))) {
        if (!values_) throw std::bad_alloc();
    }

    const i64 *data() const { return values_.get(); }
    std::span<i64> all() const { return {values_.get(), static_cast<std::size_t>(count_)}; }

private:
    struct Free {
        void operator()(i64 *values) const { std::free(values); }
    };

    i64 count_;
    std::unique_ptr<i64, Free> values_;
};

Subbands view_of(const SubbandTable &table) { return {table.starts, table.kinds, table.parents}; }

// Decodes the coefficients part by part, and makes motion of what is there: this thread decodes, others take over, and this
// one, too, when it is done.
template <class Real> class CoefficientPipeline {
public:
    CoefficientPipeline(const Group &group, std::span<const u8> chunk, const SpaceBasis &space)
        : motion(space, group.functions, group.axes(), group.step), space_(space), subbands_(space.layout().subbands()),
          quantised_(space.functions() * group.channels()), used_(space.functions()),
          rows_{quantised_.data(), group.channels(), used_},
          decoder_({view_of(subbands_), space.functions(), group.channels(), group.axes()}, chunk, quantised_.all(),
                   used_) {}

    // Decode everything.
    void decode() {
        const i64 elements = space_.elements().count();
        const i64 nodes = static_cast<i64>(subbands_.kinds.size()) - elements;
        const i64 cuts = std::min(parts, elements);
        try {
            for (i64 part = 0; part < cuts; ++part) {
                const i64 first = elements * part / cuts, end = elements * (part + 1) / cuts;
                decoder_.decode(nodes + end);
                if (part == 0) motion.take_tree(rows_);
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

    // Take over parts until there are no more to come.
    void take() {
        while (true) {
            std::pair<i64, i64> part;
            {
                std::unique_lock guard(lock_);
                changed_.wait(guard, [&] { return !ready_.empty() || is_done_; });
                if (ready_.empty()) return;
                part = ready_.back();
                ready_.pop_back();
            }
            motion.take_elements(part.first, part.second, rows_);
        }
    }

    Motion<Real> motion;

private:
    void finish() {
        const std::lock_guard guard(lock_);
        is_done_ = true;
        changed_.notify_all();
    }

    const SpaceBasis &space_;
    SubbandTable subbands_;
    Zeros quantised_;
    std::vector<i32> used_;
    QuantisedRows rows_;
    CoefficientDecoder decoder_;
    std::mutex lock_;
    std::condition_variable changed_;
    std::vector<std::pair<i64, i64>> ready_;
    bool is_done_ = false;
};

template <class Real> DecodedGroup decode_in(const Group &group, const Chunks &chunks, const SpaceBasis &space,
                                             std::span<const double> times, i64 most_bytes, int threads,
                                             const std::function<std::vector<double>()> &values) {
    CoefficientPipeline<Real> pipeline(group, chunks[1], space);
    std::vector<double> time;
    Residuals residuals;
    const auto decode_rest = [&] {
        time = functions_of_time(group, times, values());
        residuals = decode_residuals(chunks[2], group.frames, space.elements().patches->starts, most_bytes);
    };
    std::exception_ptr failure;
    if (threads < 2) {
        // Those of TIME last: another thread may still be at them.
        pipeline.decode();
        pipeline.take();
        decode_rest();
    } else {
        std::jthread other([&] {
            try {
                decode_rest();
                pipeline.take();
            } catch (...) {
                failure = std::current_exception();
            }
        });
        pipeline.decode();
        pipeline.take();
    }
    if (failure) std::rethrow_exception(failure);
    return {group, std::move(time), std::move(pipeline.motion), std::move(residuals)};
}

}  // namespace

i64 DecodedGroup::bytes() const {
    return static_cast<i64>(sizeof(double) * time.size()) + residuals.bytes() +
           std::visit([](const auto &own) { return own.bytes(); }, motion);
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

std::vector<double> decode_group_times(const Group &group, std::span<const u8> chunk) {
    if (!group.is_sampled()) return {};
    return decode_time_functions(chunk, {group.functions, group.frames, group.time_axes()}, group.time_step);
}

DecodedGroup decode_group(const Group &group, const Chunks &chunks, const SpaceBasis &space,
                          std::span<const double> times, i64 most_bytes, int threads,
                          const std::function<std::vector<double>()> &values) {
    const auto decode = group.is_single ? &decode_in<float> : &decode_in<double>;
    return decode(group, chunks, space, times, most_bytes, threads, values);
}

std::vector<double> group_coefficients(const Group &group, std::span<const u8> chunk, const SpaceBasis &space) {
    const SubbandTable subbands = space.layout().subbands();
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
