#include "decode/evaluate/descent.hpp"

#include "base/lanes.hpp"

namespace pdeanim {

template <int frames>
Descent<frames>::Descent(const SpaceBasis &basis, const SpaceRows<double> &rows, const SpaceSelection *selection,
                         const TimeRows<frames, double> &time, VertexShare share)
    : tree_(basis.tree()), layout_(basis.layout()), patches_(*layout_.patches()), rows_(rows), selection_(selection),
      time_(time), share_(share), waiting_(1) {
    waiting_[0].number = 0;
    waiting_[0].level = 0;
    in_widest([&](auto bytes) PDEANIM_INLINE_LAMBDA { begin<bytes>(); });
}

template <int frames> const Node<frames> *Descent<frames>::next() {
    while (waiting_count_ > 0) {
        const Node<frames> &last = waiting_[waiting_count_ - 1];
        if (patches_.children[last.number] >= 0) {
            in_widest([&](auto bytes) PDEANIM_INLINE_LAMBDA { halve<bytes>(); });
            continue;
        }
        --waiting_count_;
        if (last.level < share_.levels && share_.number >> last.level != 0) continue;
        return &last;
    }
    return nullptr;
}

template <int frames> template <int bytes>
PDEANIM_INLINE void Descent<frames>::add_up_row(i64 function, double *row) const {
    add_up<bytes, frames>(time_, rows_, function, row);
}

// Add up the affine functions of the root, which have coefficients of their own.
template <int frames> template <int bytes> PDEANIM_INLINE void Descent<frames>::begin() {
    for (i64 k = 0; k < layout_.affine_of_node(0); ++k) {
        add_up_row<bytes>(k, waiting_[0].affine + k * columns);
    }
}

// Replace the last node in the list by its halves, the first half on top. Above the subtree of a share, only the half
// that contains the share is kept.
template <int frames> template <int bytes> PDEANIM_INLINE void Descent<frames>::halve() {
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
    // Values at the frames of the node's wavelets that have coefficients, and the matching rows of the matrix.
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
        add_up_row<bytes>(function, wavelets[k]);
        rows[used] = wavelets[k];
        multiples[used++] = matrix[k].data();
    }
    for (double *&row : to) row = ignored;
    waiting_count_ = place;
    for (const int side : {1, 0}) {
        if (level < share_.levels && (share_.number >> level & 1) != side) continue;
        if (is_left_out(half + side)) continue;
        Node<frames> &child = waiting_[waiting_count_++];
        child.number = half + side;
        child.level = level + 1;
        const i64 first = side == 0 ? 0 : split, end = side == 0 ? split : total;
        for (i64 i = first; i < end; ++i) to[i] = child.affine + (i - first) * columns;
    }
    // A half may overwrite the node in the list: each number of the node is read before.
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

template class Descent<1>;
#if !defined(__wasm__)
template class Descent<frames_at_once>;
#endif

}  // namespace pdeanim
