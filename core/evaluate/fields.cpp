#include "evaluate/fields.hpp"

#include <array>

#include "multiversion.hpp"

namespace pdeanim {

namespace {

// Vertices whose sums are kept at hand: three axes of them fill a fraction of a first-level cache.
constexpr i64 block = 512;

template <class Sum> using Sums = std::array<std::array<Sum, block>, 3>;

// Add what `several` functions from `a` on give at a run of vertices from `first` on, on `axes` axes from `axis` on
// that share their values. weights: (3, functions).
template <int axes, int several, class T, class Sum>
PDEANIM_INLINE void add_functions(const Sum *weights, const Fields<T> &fields, i64 a, i64 first, i64 size, int axis,
                                  Sums<Sum> &sums) {
    Sum weight[axes][several];
    const T *value[several];
    for (int k = 0; k < several; ++k) {
        value[k] = fields.row(a + k, axis) + first;
        for (int x = 0; x < axes; ++x) weight[x][k] = weights[(axis + x) * fields.functions + a + k];
    }
    for (i64 i = 0; i < size; ++i) {
        for (int x = 0; x < axes; ++x) {
            Sum sum = sums[axis + x][i];
            for (int k = 0; k < several; ++k) sum += weight[x][k] * static_cast<Sum>(value[k][i]);
            sums[axis + x][i] = sum;
        }
    }
}

template <int axes, class T, class Sum> PDEANIM_INLINE void add_axes(const Sum *weights, const Fields<T> &fields,
                                                                     i64 first, i64 size, int axis, Sums<Sum> &sums) {
    constexpr int together = 4;  // functions for which sums are loaded and stored once
    i64 a = 0;
    for (; a + together <= fields.functions; a += together) {
        add_functions<axes, together>(weights, fields, a, first, size, axis, sums);
    }
    for (; a < fields.functions; ++a) add_functions<axes, 1>(weights, fields, a, first, size, axis, sums);
}

template <class T, class Sum>
PDEANIM_INLINE void add_run(const Sum *weights, const Fields<T> &fields, i64 first, i64 size, Sums<Sum> &sums) {
    if (fields.axes == 1) {
        add_axes<3>(weights, fields, first, size, 0, sums);
    } else {
        for (int axis = 0; axis < 3; ++axis) add_axes<1>(weights, fields, first, size, axis, sums);
    }
}

template <class T, class Out> PDEANIM_INLINE void evaluate(std::span<const T> time, const Fields<T> &fields,
                                                           std::span<const double> reference, std::span<Out> out) {
    const i64 vertices = fields.vertices, frames = vertices ? static_cast<i64>(out.size()) / (3 * vertices) : 0;
    Sums<T> sums;
    for (i64 tile = 0; tile < frames; tile += frames_at_once) {
        for (i64 first = 0; first < vertices; first += block) {
            const i64 size = least(block, vertices - first);
            for (i64 frame = tile; frame < least(tile + frames_at_once, frames); ++frame) {
                sums = {};
                add_run(time.data() + frame * 3 * fields.functions, fields, first, size, sums);
                const double *from = &reference[3 * first];
                Out *to = &out[3 * (frame * vertices + first)];
                for (i64 i = 0; i < size; ++i) {
                    for (i64 axis = 0; axis < 3; ++axis) {
                        to[3 * i + axis] = static_cast<Out>(from[3 * i + axis] + static_cast<double>(sums[axis][i]));
                    }
                }
            }
        }
    }
}

template <class T>
PDEANIM_INLINE void displace(std::span<const double> weights, const Fields<T> &fields, std::span<double> moved) {
    Sums<double> sums;
    for (i64 first = 0; first < fields.vertices; first += block) {
        const i64 size = least(block, fields.vertices - first);
        double *to = &moved[3 * first];
        for (i64 i = 0; i < size; ++i) {
            for (i64 axis = 0; axis < 3; ++axis) sums[axis][i] = to[3 * i + axis];
        }
        add_run(weights.data(), fields, first, size, sums);
        for (i64 i = 0; i < size; ++i) {
            for (i64 axis = 0; axis < 3; ++axis) to[3 * i + axis] = sums[axis][i];
        }
    }
}

}  // namespace

PDEANIM_MULTIVERSION void evaluate_frames(std::span<const float> time, const Fields<float> &fields,
                                          std::span<const double> reference, std::span<float> out) {
    evaluate(time, fields, reference, out);
}

PDEANIM_MULTIVERSION void evaluate_frames(std::span<const float> time, const Fields<float> &fields,
                                          std::span<const double> reference, std::span<double> out) {
    evaluate(time, fields, reference, out);
}

PDEANIM_MULTIVERSION void evaluate_frames(std::span<const double> time, const Fields<double> &fields,
                                          std::span<const double> reference, std::span<float> out) {
    evaluate(time, fields, reference, out);
}

PDEANIM_MULTIVERSION void evaluate_frames(std::span<const double> time, const Fields<double> &fields,
                                          std::span<const double> reference, std::span<double> out) {
    evaluate(time, fields, reference, out);
}

PDEANIM_MULTIVERSION void add_displacement(std::span<const double> weights, const Fields<float> &fields,
                                           std::span<double> moved) {
    displace(weights, fields, moved);
}

PDEANIM_MULTIVERSION void add_displacement(std::span<const double> weights, const Fields<double> &fields,
                                           std::span<double> moved) {
    displace(weights, fields, moved);
}

}  // namespace pdeanim
