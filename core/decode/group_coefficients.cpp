#include "decode/group_coefficients.hpp"

namespace pdeanim {

namespace {

// In which coefficients are decoded: enough for another thread to have work soon, few enough to cost nothing.
constexpr i64 parts = 12;
constexpr i64 subbands_at_once = 16;  // before it looks whether they are still wanted

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

}  // namespace pdeanim
