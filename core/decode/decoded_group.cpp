#include "decode/decoded_group.hpp"

#include <algorithm>
#include <cmath>
#include <exception>
#include <thread>

#include "sections/temporal/closed_form.hpp"
#include "sections/temporal/time_functions.hpp"

namespace pdeanim {

namespace {

// Number of parts in which coefficients are decoded: enough that another thread soon has work, few enough that the
// division costs nothing.
constexpr i64 parts = 12;
constexpr i64 subbands_at_once = 16;  // number of subbands between two checks whether decoding shall stop

}  // namespace

Subbands view_of(const SubbandTable &table) { return {table.starts, table.kinds, table.parents}; }

GroupCoefficients::GroupCoefficients(const Group &group, std::span<const u8> chunk,
                                     std::shared_ptr<const SpaceLayout> layout, TakenMemory taken)
    : layout_(std::move(layout)),
      decoder_({view_of(layout_->subbands()), layout_->functions(), group.channels(), group.axes()}, chunk,
               std::move(taken)) {}

void GroupCoefficients::decode() noexcept {
    const i64 elements = layout_->elements();
    const i64 others = static_cast<i64>(layout_->subbands().kinds.size()) - elements;
    const i64 cuts = least(parts, elements);
    try {
        for (i64 part = 0; part < cuts; ++part) {
            const i64 first = elements * part / cuts, end = elements * (part + 1) / cuts;
            for (i64 done = first == 0 ? 0 : others + first; done < others + end;) {
                if (is_stopped_) return finish(nullptr);
                done = least(done + subbands_at_once, others + end);
                decoder_.decode(done);
            }
            const std::lock_guard guard(lock_);
            ready_.emplace_back(first, end);
            changed_.notify_one();
        }
        decoder_.finish();
    } catch (...) {
        finish(std::current_exception());
        return;
    }
    finish(nullptr);
}

void GroupCoefficients::finish(std::exception_ptr failure) {
    const std::lock_guard guard(lock_);
    if (failure) {
        failure_ = failure;
        ready_.clear();
    }
    is_done_ = true;
    changed_.notify_all();
}

void GroupCoefficients::wait() {
    std::unique_lock guard(lock_);
    changed_.wait(guard, [&] { return is_done_; });
}

template <class Real> void GroupCoefficients::take_tree(Motion<Real> &motion) {
    std::exception_ptr failure;
    try {
        motion.take_tree(decoder_.rows());
    } catch (...) {
        failure = std::current_exception();
    }
    const std::lock_guard guard(lock_);
    if (failure) failure_ = failure;
    tree_ = Tree::taken;
    changed_.notify_all();
}

template <class Real> void GroupCoefficients::take(Motion<Real> &motion) {
    while (true) {
        std::pair<i64, i64> part;
        bool is_tree = false;
        {
            std::unique_lock guard(lock_);
            changed_.wait(guard, [&] { return tree_ != Tree::being_taken && (is_done_ || !ready_.empty()); });
            if (failure_) std::rethrow_exception(failure_);
            if (ready_.empty()) return;
            is_tree = tree_ == Tree::not_taken;
            if (is_tree) {
                tree_ = Tree::being_taken;
            } else {
                part = ready_.back();
                ready_.pop_back();
            }
        }
        if (is_tree) {
            take_tree(motion);
        } else {
            motion.take_elements(part.first, part.second, decoder_.rows());
        }
    }
}

template void GroupCoefficients::take(Motion<float> &);
template void GroupCoefficients::take(Motion<double> &);

namespace {

// Divide each function by its length over all frames and axes; zero functions stay zero. Squares are added frame by
// frame, axis by axis.
void normalise(std::vector<double> &values, i64 functions) {
    if (values.empty()) return;
    std::vector<double> lengths(functions);
    const i64 rows = static_cast<i64>(values.size()) / functions;
    for (i64 row = 0; row < rows; ++row) {
        const double *own = values.data() + row * functions;
        for (i64 k = 0; k < functions; ++k) lengths[k] += own[k] * own[k];
    }
    for (double &length : lengths) length = length > 0.0 ? std::sqrt(length) : 1.0;
    for (i64 row = 0; row < rows; ++row) {
        double *own = values.data() + row * functions;
        for (i64 k = 0; k < functions; ++k) own[k] /= lengths[k];
    }
}

// Orthonormal cosines cos(j pi (f + 1/2) / frames).
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

template <class Real> DecodedGroup decode_in(const Group &group, const Chunks &chunks, const SpaceBasis &space,
                                             std::span<const double> times, TakenMemory taken, int threads,
                                             const GroupBegun &begun) {
    std::optional<GroupCoefficients> own;
    if (!begun.coefficients) own.emplace(group, chunks[1], space.tree().layout(), taken.another());
    GroupCoefficients &coefficients = own ? *own : *begun.coefficients;
    Motion<Real> motion(space, group.functions, group.axes(), group.step, taken.another());
    std::vector<double> time;
    Residuals residuals;
    const auto decode_rest = [&] {
        time = functions_of_time(group, times, begun.values());
        residuals = decode_residuals(chunks[2], group.frames, space.elements().patches->starts, taken);
    };
    std::exception_ptr failure;
    if (threads < 2) {
        // Functions of time come last: another thread may still be decoding them.
        if (own) own->decode();
        coefficients.take(motion);
        decode_rest();
    } else {
        // At most two threads are busy at a time: with more threads than processors, each would be slower.
        std::jthread other([&] {
            try {
                if (own) {
                    decode_rest();
                } else {
                    coefficients.wait();
                }
                coefficients.take(motion);
            } catch (...) {
                failure = std::current_exception();
            }
        });
        if (own) {
            own->decode();
        } else {
            decode_rest();
        }
        coefficients.take(motion);
    }
    if (failure) std::rethrow_exception(failure);
    motion.end();
    taken.keep(sizeof(double) * time.size() + static_cast<u64>(residuals.bytes()));
    return {group, std::move(time), std::move(motion), std::move(residuals), std::move(taken)};
}

}  // namespace

i64 DecodedGroup::bytes() const {
    return static_cast<i64>(taken.bytes() + std::visit([](const auto &own) { return own.taken().bytes(); }, motion));
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
                          std::span<const double> times, TakenMemory taken, int threads, const GroupBegun &begun) {
    const auto decode = group.is_single ? &decode_in<float> : &decode_in<double>;
    return decode(group, chunks, space, times, std::move(taken), threads, begun);
}

std::vector<double> group_coefficients(const Group &group, std::span<const u8> chunk, const SpaceBasis &space,
                                       TakenMemory taken) {
    const SubbandTable &subbands = space.layout().subbands();
    CoefficientDecoder decoder({view_of(subbands), space.functions(), group.channels(), group.axes()}, chunk,
                               std::move(taken));
    decoder.decode(static_cast<i64>(subbands.kinds.size()));
    decoder.finish();
    std::vector<double> found(space.functions() * group.channels());
    double *to = found.data();
    for (const std::span<const i64> row : decoder.rows()) {
        std::transform(row.begin(), row.end(), to,
                       [&](i64 number) { return static_cast<double>(number) * group.step; });
        to += group.channels();
    }
    return found;
}

}  // namespace pdeanim
