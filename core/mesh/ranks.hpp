// Sets of numbers below n that give how many of their members lie below a number, and which is the k-th.
//
// A binary indexed tree (Fenwick 1994, "A new data structure for cumulative frequency tables"): each operation takes a
// number of steps that grows with the logarithm of n.
#pragma once

#include <vector>

#include "base/arithmetic.hpp"

namespace pdeanim {

class RankedSet {
public:
    // All numbers below `size`, or none, with room for those.
    RankedSet(i64 size, bool is_full) : tree_(size + 1) {
        if (!is_full) return;
        for (i64 place = 0; place <= size; ++place) tree_[place] = static_cast<i32>(place & -place);
        count_ = size;
    }

    i64 count() const { return count_; }
    void add(i64 number) { change(number, 1); }
    void remove(i64 number) { change(number, -1); }

    // How many members are below `number`.
    i64 rank_of(i64 number) const {
        i64 found = 0;
        for (i64 place = number; place > 0; place -= place & -place) found += tree_[place];
        return found;
    }

    // The member that has `rank` members below it, 0 to count() - 1.
    i64 member_at(i64 rank) const {
        const i64 size = static_cast<i64>(tree_.size());
        i64 place = 0, step = 1;
        while (2 * step < size) step *= 2;
        for (; step > 0; step /= 2) {
            if (place + step < size && tree_[place + step] <= rank) {
                place += step;
                rank -= tree_[place];
            }
        }
        return place;
    }

private:
    void change(i64 number, i32 by) {
        for (i64 place = number + 1; place < static_cast<i64>(tree_.size()); place += place & -place)
            tree_[place] += by;
        count_ += by;
    }

    std::vector<i32> tree_;
    i64 count_ = 0;
};

}  // namespace pdeanim
