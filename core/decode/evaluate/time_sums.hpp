// What functions of space count at some frames: sums of functions of time over their coefficients.
#pragma once

#include "base/arrays.hpp"
#include "base/lanes.hpp"
#include "decode/evaluate/motion.hpp"

namespace pdeanim {

// What is below is written for registers of so many bytes. Whether one loop does for all numbers of vertices: code for a
// page is fetched, and its registers are few; and where there are variants for wider registers the narrowest ones serve
// old processors alone, and would only take time to compile.
#if defined(__wasm__)
template <int bytes> constexpr bool is_small = true;
#elif defined(PDEANIM_FOR)
template <int bytes> constexpr bool is_small = bytes == 16;
#else
template <int bytes> constexpr bool is_small = false;
#endif

template <int bytes, class Real> constexpr int lanes = bytes / static_cast<int>(sizeof(Real));

// The registers of the widest kind are twice as many as of the others.
template <int bytes> constexpr bool has_many_registers = bytes == 64;

// Numbers of some frames side by side: of each axis those of all frames; of one frame the three axes, and nothing.
template <int frames> constexpr int width = frames == 1 ? 4 : 3 * frames;

// Of every function of time its values at some frames: `width` numbers, or one a frame where all axes share them.
template <int frames, class Real> struct TimeRows {
    template <class Own> TimeRows(const Motion<Own> &motion, const double *time, i64 given)
        : is_shared(motion.axes == 3), stride(is_shared ? frames : width<frames>),
          values(static_cast<std::size_t>(motion.functions * stride)) {
        constexpr i64 at_once = 8;  // functions whose rows stay in the nearest cache
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

// Coefficients of one function of space.
template <class Real> struct RowOf {
    const u16 *functions;
    const Real *values;
    i64 count;
};

// So many sums are added up beside each other and put together at the end: one number would wait for the one before it.
constexpr int partial_sums = 2;

// `packs` registers of a row of counts, from number `first` on.
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

// `packs` registers of each axis, of coefficients that differ by axis.
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

// The same at one frame.
template <class Real> PDEANIM_INLINE void add_up_axes_once(const Real *time, const RowOf<Real> &own, Real *row) {
    constexpr int axes = static_cast<int>(SpaceRows<Real>::padded_axes);
    static_assert(axes == width<1>);
    Lanes<Real, axes> sums{};
    for (i64 k = 0; k < own.count; ++k) sums += time[own.functions[k]] * lanes_at<axes>(own.values + axes * k);
    put_lanes(row, sums);
}

// What one function of space counts at some frames: the sum over its coefficients of functions of time.
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

}  // namespace pdeanim
