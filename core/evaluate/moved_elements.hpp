// A motion at some frames, element by element: what comes down the tree, then what the element's own functions count.
#pragma once

#include <algorithm>
#include <vector>

#include "evaluate/time_sums.hpp"

namespace pdeanim {

// A node of the tree whose affine functions are summed up.
template <int frames> struct Node {
    i64 number;
    int level;
    alignas(cache_line) double affine[affine_count * width<frames>];
};

// A motion at some frames: what the functions of space count there, down the tree.
template <int bytes, int frames, class Real> class Descent {
public:
    PDEANIM_INLINE Descent(const Motion<Real> &motion, const TimeRows<frames, double> &time, VertexShare share)
        : motion_(motion), tree_(motion.basis->tree()), layout_(motion.basis->layout()), patches_(*layout_.patches()),
          time_(time), share_(share), waiting_(1) {
        waiting_[0].number = 0;
        waiting_[0].level = 0;
        for (i64 k = 0; k < layout_.affine_of_node(0); ++k) add_up_row(k, waiting_[0].affine + k * columns);
    }

    // The next element of the share; nothing after the last one. It is there until the next call.
    PDEANIM_INLINE const Node<frames> *next() {
        while (waiting_count_ > 0) {
            const Node<frames> &last = waiting_[waiting_count_ - 1];
            if (patches_.children[last.number] >= 0) {
                halve();
                continue;
            }
            --waiting_count_;
            if (last.level < share_.levels && share_.number >> last.level != 0) continue;
            return &last;
        }
        return nullptr;
    }

private:
    static constexpr int columns = width<frames>, most_functions = PartitionTree::most_functions;

    PDEANIM_INLINE bool has_row(i64 function) const {
        return motion_.tree.starts[function] < motion_.tree.starts[function + 1];
    }

    PDEANIM_INLINE void add_up_row(i64 function, double *row) const {
        add_up<bytes, frames>(time_, motion_.tree, function, row);
    }

    // Put the halves of the last node in its place, the first one last; of those that are shared out, the share's alone.
    PDEANIM_INLINE void halve() {
        constexpr int size = least(lanes<bytes, double>, columns);
        using Pack = Lanes<double, size>;
        const i64 place = waiting_count_ - 1;
        if (static_cast<i64>(waiting_.size()) < place + 2) waiting_.resize(place + 2);
        Node<frames> *nodes = waiting_.data() + place;
        const i64 number = nodes[0].number, half = patches_.children[number];
        const int level = nodes[0].level;
        const i64 own = layout_.affine_of_node(number), split = layout_.affine_of_node(half);
        const i64 total = split + layout_.affine_of_node(half + 1);
        const PartitionTree::Matrix &matrix = tree_.matrix(number);
        // What the node's functions count, as far as they do, and the rows of the matrix for them.
        double wavelets[most_functions][columns], ignored[columns];
        const double *rows[most_functions], *multiples[most_functions];
        double *to[most_functions];
        i64 used = own;
        for (i64 k = 0; k < own; ++k) {
            rows[k] = nodes[0].affine + k * columns;
            multiples[k] = matrix[k].data();
        }
        for (i64 k = own; k < total; ++k) {
            const i64 function = layout_.first_wavelet(number) + k - own;
            if (!has_row(function)) continue;
            add_up_row(function, wavelets[k]);
            rows[used] = wavelets[k];
            multiples[used++] = matrix[k].data();
        }
        for (double *&row : to) row = ignored;
        waiting_count_ = place;
        for (const int side : {1, 0}) {
            if (level < share_.levels && (share_.number >> level & 1) != side) continue;
            if (motion_.is_node_left_out(half + side)) continue;
            Node<frames> &child = waiting_[waiting_count_++];
            child.number = half + side;
            child.level = level + 1;
            const i64 first = side == 0 ? 0 : split, end = side == 0 ? split : total;
            for (i64 i = first; i < end; ++i) to[i] = child.affine + (i - first) * columns;
        }
        // A half may stand where the node does: each number of it is read before those at its place are written.
        for (int p = 0; p < columns; p += size) {
            Pack sums[most_functions];
            make_zero(sums);
            for (i64 k = 0; k < used; ++k) {
                const Pack row = lanes_at<size>(rows[k] + p);
                for (int i = 0; i < most_functions; ++i) sums[i] += multiples[k][i] * row;
            }
            for (int i = 0; i < most_functions; ++i) put_lanes(to[i] + p, sums[i]);
        }
    }

    const Motion<Real> &motion_;
    const PartitionTree &tree_;
    const SpaceLayout &layout_;
    const Patches &patches_;
    const TimeRows<frames, double> &time_;
    VertexShare share_;
    std::vector<Node<frames>> waiting_;  // still to come, the next one last
    i64 waiting_count_ = 1;
};

// Functions or fields of an element, and what each counts at some frames.
template <class Real> struct Columns {
    const Real *values;  // from the element's first vertex on
    i64 count;
    const Real *counts;
    i64 count_stride;
    bool is_shared;  // they have values for each axis, and count the same on all of them
};

// The elements of a motion at some frames, one after another.
template <int bytes, int frames, class Real> class MovedElements {
public:
    PDEANIM_INLINE MovedElements(const Motion<Real> &motion, const double *time, i64 given, VertexShare share)
        : motion_(motion), exact_(motion, time, given), usual_(motion, time, given), descent_(motion, exact_, share) {}
    MovedElements(const MovedElements &) = delete;

    // Go to the next one; false after the last one.
    PDEANIM_INLINE bool next() {
        const Patches &patches = *motion_.basis->elements().patches;
        do {
            node_ = descent_.next();
            if (!node_) return false;
            // Elements come in their order, as the halves of a node do, one after the other unless some are left out.
            if (element_ < 0 || motion_.selection) {
                const auto found =
                    std::lower_bound(patches.starts.begin(), patches.starts.end(), patches.begins[node_->number]);
                element_ = found - patches.starts.begin();
            } else {
                ++element_;
            }
        } while (motion_.is_left_out(element_));
        affine_ = motion_.basis->layout().affine_of_node(node_->number);
        return true;
    }

    PDEANIM_INLINE i64 element() const { return element_; }

    // How far its mean is moved on an axis at a frame.
    PDEANIM_INLINE double moved(int axis, int frame) const {
        return affine_ > 0 ? item().constant * node_->affine[axis * frames + frame] : 0.0;
    }

    // What else moves it; there until `next` is called.
    PDEANIM_INLINE Columns<Real> columns() {
        constexpr int numbers = width<frames>;
        const typename Motion<Real>::Element &own = item();
        if (own.has_fields) {
            return {own.values.data(), own.columns, usual_.values.data(), usual_.stride, usual_.is_shared};
        }
        counts_.resize(own.columns * numbers);
        const i64 first = most<i64>(affine_ - 1, 0);
        for (i64 i = 0; i < first * numbers; ++i) counts_[i] = static_cast<Real>(node_->affine[numbers + i]);
        for (i64 k = first; k < own.columns; ++k) {
            add_up<bytes, frames>(usual_, own.rows, k - first, counts_.data() + k * numbers);
        }
        return {own.values.data(), own.columns, counts_.data(), numbers, false};
    }

private:
    PDEANIM_INLINE const typename Motion<Real>::Element &item() const { return motion_.elements[element_]; }

    const Motion<Real> &motion_;
    const TimeRows<frames, double> exact_;
    const TimeRows<frames, Real> usual_;
    Descent<bytes, frames, Real> descent_;
    const Node<frames> *node_ = nullptr;
    i64 element_ = -1, affine_ = 0;
    AlignedArray<Real> counts_;
};

}  // namespace pdeanim
