// A motion at some frames, element by element: what comes down the tree, then what the element's own functions count.
#pragma once

#include <algorithm>

#include "decode/evaluate/descent.hpp"

namespace pdeanim {

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
    Descent<frames> descent_;
    const Node<frames> *node_ = nullptr;
    i64 element_ = -1, affine_ = 0;
    AlignedArray<Real> counts_;
};

}  // namespace pdeanim
