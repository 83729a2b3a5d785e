// What the functions of space of a partition tree count at some frames: down from its root to the elements.
#pragma once

#include <vector>

#include "decode/evaluate/time_sums.hpp"

namespace pdeanim {

// A node of the tree whose affine functions are summed up.
template <int frames> struct Node {
    i64 number;
    int level;
    alignas(cache_line) double affine[affine_count * width<frames>];
};

// Nothing in it depends on the precision that elements are added up in.
template <int frames> class Descent {
public:
    // The motion and the time must outlive it.
    template <class Real> Descent(const Motion<Real> &motion, const TimeRows<frames, double> &time, VertexShare share)
        : Descent(*motion.basis, motion.tree, motion.selection ? &*motion.selection : nullptr, time, share) {}

    // The next element of the share; nothing after the last one. It is there until the next call.
    const Node<frames> *next();

private:
    static constexpr int columns = width<frames>, most_functions = PartitionTree::most_functions;

    Descent(const SpaceBasis &basis, const SpaceRows<double> &rows, const SpaceSelection *selection,
            const TimeRows<frames, double> &time, VertexShare share);

    bool has_row(i64 function) const { return rows_.starts[function] < rows_.starts[function + 1]; }
    bool is_left_out(i64 node) const { return selection_ && !selection_->has_elements[node]; }
    template <int bytes> void add_up_row(i64 function, double *row) const;
    template <int bytes> void begin();
    template <int bytes> void halve();

    const PartitionTree &tree_;
    const SpaceLayout &layout_;
    const Patches &patches_;
    const SpaceRows<double> &rows_;
    const SpaceSelection *selection_;  // nothing where all functions count
    const TimeRows<frames, double> &time_;
    VertexShare share_;
    std::vector<Node<frames>> waiting_;  // still to come, the next one last
    i64 waiting_count_ = 1;
};

}  // namespace pdeanim
