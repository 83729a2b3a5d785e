// The quantised coefficients of a group: one thread decodes them part by part, others make motion of what is there.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdlib>
#include <exception>
#include <memory>
#include <mutex>
#include <new>
#include <span>
#include <utility>
#include <vector>

#include "basis/space_layout.hpp"
#include "coefficients/coefficients.hpp"
#include "decoder/group_table.hpp"
#include "evaluate/motion.hpp"

namespace pdeanim {

Subbands view_of(const SubbandTable &table);

class GroupCoefficients {
public:
    // The chunk of section COEF must outlive it.
    GroupCoefficients(const Group &group, std::span<const u8> chunk, std::shared_ptr<const SpaceLayout> layout);

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
    // Numbers that are zero at first. Memory that is never written to is never there: most rows are all zero.
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

    enum class Tree { not_taken, being_taken, taken };  // what of the partition tree motion must have first

    void finish(std::exception_ptr failure);
    template <class Real> void take_tree(Motion<Real> &motion);

    std::shared_ptr<const SpaceLayout> layout_;
    SubbandTable subbands_;
    Zeros quantised_;
    std::vector<i32> used_;
    QuantisedRows rows_;
    CoefficientDecoder decoder_;
    std::mutex lock_;
    std::condition_variable changed_;
    std::vector<std::pair<i64, i64>> ready_;  // elements, first and end
    Tree tree_ = Tree::not_taken;
    bool is_done_ = false;
    std::atomic<bool> is_stopped_ = false;
    std::exception_ptr failure_;
};

}  // namespace pdeanim
