// The quantised coefficients of a group: one thread decodes them part by part, others make motion of what is there.
#pragma once

#include <atomic>
#include <condition_variable>
#include <exception>
#include <memory>
#include <mutex>
#include <span>
#include <utility>
#include <vector>

#include "decode/evaluate/motion.hpp"
#include "decode/group_table.hpp"
#include "sections/coefficients/coefficients.hpp"
#include "sections/spatial/space_layout.hpp"

namespace pdeanim {

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

}  // namespace pdeanim
