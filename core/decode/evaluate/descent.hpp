// Carries coefficients of functions of space, evaluated at some frames, down the partition tree to the elements.
#pragma once

#include <algorithm>
#include <vector>

#include "base/arrays.hpp"
#include "base/lanes.hpp"
#include "decode/evaluate/motion.hpp"

namespace pdeanim {

// The loops below exist for several register widths. If this is true, a width has only one loop for meshes of all
// sizes. For WebAssembly the code must be downloaded, and there are few registers. Elsewhere the narrow variant runs on
// old processors only, where more loops are not worth their compile time.
#if defined(__wasm__)
template <int bytes> constexpr bool is_small = true;
#elif defined(PDEANIM_FOR)
template <int bytes> constexpr bool is_small = bytes == 16;
#else
template <int bytes> constexpr bool is_small = false;
#endif

template <int bytes, class Real> constexpr int lanes = bytes / static_cast<int>(sizeof(Real));

// AVX-512 has twice as many registers as narrower instruction sets.
template <int bytes> constexpr bool has_many_registers = bytes == 64;

// Numbers per row of values at several frames: x at all frames, then y, then z; for a single frame, the three axes and
// padding.
template <int frames> constexpr int width = frames == 1 ? 4 : 3 * frames;

// Values of every function of time at some frames: `width` numbers per function, or one per frame if all axes share
// them.
template <int frames, class Real> struct TimeRows {
    template <class Own> TimeRows(const Motion<Own> &motion, const double *time, i64 given)
        : is_shared(motion.axes == 3), stride(is_shared ? frames : width<frames>),
          values(static_cast<std::size_t>(motion.functions * stride)) {
        constexpr i64 at_once = 8;  // as many functions as have rows that fit in the first-level cache
        const i64 functions = motion.functions, rows = given * motion.time_axes();
        for (i64 first = 0; first < functions; first += at_once) {
            const i64 end = least(first + at_once, functions);
            for (i64 row = 0; row < rows; ++row) {
                const double *from = time + row * functions;
                const i64 frame = is_shared ? row : row / 3, axis = is_shared ? 0 : row % 3;
                Real *to = values.data() + axis * frames + frame;
                for (i64 a = first; a < end; ++a) to[a * stride] = static_cast<Real>(from[a]);
            }
        }
    }

    bool is_shared;
    i64 stride;
    AlignedArray<Real> values;
};

// Coefficients of one function of space, each with its function of time.
template <class Real> struct RowOf {
    const u16 *functions;
    const Real *values;
    i64 count;
};

// Number of sums that are added up independently and joined at the end: each addition to a single sum would wait for
// the one before.
constexpr int partial_sums = 2;

// Add up `packs` registers of a row, from number `first` on: coefficients that all axes share times functions of time.
template <int packs, int size, class Real>
PDEANIM_INLINE void add_up_part(const Real *time, i64 stride, const RowOf<Real> &own, Real *row) {
    using Pack = Lanes<Real, size>;
    Pack sums[partial_sums][packs];
    make_zero(sums);
    const auto add = [&](int part, i64 k) PDEANIM_INLINE_LAMBDA {
        const Real value = own.values[k], *from = time + own.functions[k] * stride;
        for (int i = 0; i < packs; ++i) sums[part][i] += value * lanes_at<size>(from + i * size);
    };
    i64 k = 0;
    for (; k + partial_sums <= own.count; k += partial_sums) {
        for (int part = 0; part < partial_sums; ++part) add(part, k + part);
    }
    if (k < own.count) add(0, k);
    for (int i = 0; i < packs; ++i) {
        put_lanes(row + i * size, sums[0][i] + sums[1][i]);
    }
}

// Add up `packs` registers per axis, with coefficients that differ by axis.
template <int packs, int size, int frames, class Real>
PDEANIM_INLINE void add_up_axes(const Real *time, const RowOf<Real> &own, Real *row) {
    using Pack = Lanes<Real, size>;
    Pack sums[3][packs];
    make_zero(sums);
    for (i64 k = 0; k < own.count; ++k) {
        const Real *values = own.values + SpaceRows<Real>::padded_axes * k, *from = time + own.functions[k] * frames;
        for (int i = 0; i < packs; ++i) {
            const Pack counted = lanes_at<size>(from + i * size);
            for (int axis = 0; axis < 3; ++axis) sums[axis][i] += values[axis] * counted;
        }
    }
    for (int axis = 0; axis < 3; ++axis) {
        for (int i = 0; i < packs; ++i) put_lanes(row + axis * frames + i * size, sums[axis][i]);
    }
}

// Add up a row for a single frame.
template <class Real> PDEANIM_INLINE void add_up_axes_once(const Real *time, const RowOf<Real> &own, Real *row) {
    constexpr int axes = static_cast<int>(SpaceRows<Real>::padded_axes);
    static_assert(axes == width<1>);
    Lanes<Real, axes> sums{};
    for (i64 k = 0; k < own.count; ++k) sums += time[own.functions[k]] * lanes_at<axes>(own.values + axes * k);
    put_lanes(row, sums);
}

// Compute the value of one function of space at some frames: the sum of its coefficients times functions of time.
template <int bytes, int frames, class Real>
PDEANIM_INLINE void add_up(const TimeRows<frames, Real> &time, const SpaceRows<Real> &rows, i64 function, Real *row) {
    const i64 start = rows.starts[function], numbers = time.is_shared ? SpaceRows<Real>::padded_axes : 1;
    const RowOf<Real> own{rows.functions.data() + start, rows.values.data() + numbers * start,
                          rows.starts[function + 1] - start};
    if (time.is_shared) {
        if constexpr (frames == 1) {
            add_up_axes_once(time.values.data(), own, row);
        } else {
            constexpr int size = least(lanes<bytes, Real>, frames), packs = frames / size;
            constexpr int at_once = least(packs, 2);
            static_assert(packs % at_once == 0);
            for (int first = 0; first < packs; first += at_once) {
                add_up_axes<at_once, size, frames>(time.values.data() + first * size, own, row + first * size);
            }
        }
        return;
    }
    constexpr int size = least(lanes<bytes, Real>, width<frames>), packs = width<frames> / size;
    constexpr int at_once = least(packs, 6);
    static_assert(packs % at_once == 0);
    for (int first = 0; first < packs; first += at_once) {
        add_up_part<at_once, size>(time.values.data() + first * size, width<frames>, own, row + first * size);
    }
}

// A node of the partition tree, with the values of its affine functions at some frames.
template <int frames> struct Node {
    i64 number;
    int level;
    alignas(cache_line) double affine[affine_count * width<frames>];
};

// Walks the partition tree to the elements. It always computes in double, whatever precision the elements use.
template <int frames> class Descent {
public:
    // `motion` and `time` must outlive this object.
    template <class Real> Descent(const Motion<Real> &motion, const TimeRows<frames, double> &time, VertexShare share)
        : Descent(*motion.basis, motion.tree, motion.selection ? &*motion.selection : nullptr, time, share) {}

    // Return the next element of the share, or null after the last one. It is valid until the next call.
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
    const SpaceSelection *selection_;  // null if all functions are used
    const TimeRows<frames, double> &time_;
    VertexShare share_;
    std::vector<Node<frames>> waiting_;  // nodes that are still to be visited, the next one last
    i64 waiting_count_ = 1;
};

// Functions or fields of an element (its columns), and the weight of each at some frames.
template <class Real> struct Columns {
    const Real *values;  // values of the columns, beginning at the element's first vertex
    i64 count;
    const Real *counts;
    i64 count_stride;
    bool is_shared;  // whether each axis has its own values, and all axes share one weight per frame
};

// Visits the elements of a motion one after another, with their values at some frames.
template <int bytes, int frames, class Real> class MovedElements {
public:
    PDEANIM_INLINE MovedElements(const Motion<Real> &motion, const double *time, i64 given, VertexShare share)
        : motion_(motion), exact_(motion, time, given), usual_(motion, time, given), descent_(motion, exact_, share) {}
    MovedElements(const MovedElements &) = delete;

    // Go to the next element; return false after the last one.
    PDEANIM_INLINE bool next() {
        const Patches &patches = *motion_.basis->elements().patches;
        do {
            node_ = descent_.next();
            if (!node_) return false;
            // Elements come in ascending order, so the next one usually follows the last. With a selection, some are
            // left out: search.
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

    // Displacement of the element's mean on an axis at a frame.
    PDEANIM_INLINE double moved(int axis, int frame) const {
        return affine_ > 0 ? item().constant * node_->affine[axis * frames + frame] : 0.0;
    }

    // Return the other functions that move the element; valid until the next call of `next`.
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
