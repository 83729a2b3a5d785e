#include "evaluate/fields.hpp"

#include <array>

#include "multiversion.hpp"

namespace pdeanim {

namespace {

// Vertices whose sums are kept at hand: three axes of them fill a fraction of a first-level cache.
constexpr i64 block = 512;

template <class Sum> using Sums = std::array<std::array<Sum, block>, 3>;

// Add up what the fields give at a run of vertices from `first` on. weights: (3, functions).
template <class T, class Sum>
PDEANIM_INLINE void add_run(const Sum *weights, const Fields<T> &fields, i64 first, i64 size, Sums<Sum> &sums) {
    for (i64 axis = 0; axis < 3; ++axis) {
        const Sum *weight = weights + axis * fields.functions;
        Sum *sum = sums[axis].data();
        i64 a = 0;
        for (; a + 4 <= fields.functions; a += 4) {
            const Sum w0 = weight[a], w1 = weight[a + 1], w2 = weight[a + 2], w3 = weight[a + 3];
            const T *g0 = fields.row(a, axis) + first, *g1 = fields.row(a + 1, axis) + first;
            const T *g2 = fields.row(a + 2, axis) + first, *g3 = fields.row(a + 3, axis) + first;
            for (i64 i = 0; i < size; ++i) {
                sum[i] = (((sum[i] + w0 * static_cast<Sum>(g0[i])) + w1 * static_cast<Sum>(g1[i])) +
                          w2 * static_cast<Sum>(g2[i])) + w3 * static_cast<Sum>(g3[i]);
            }
        }
        for (; a < fields.functions; ++a) {
            const Sum w = weight[a];
            const T *g = fields.row(a, axis) + first;
            for (i64 i = 0; i < size; ++i) sum[i] += w * static_cast<Sum>(g[i]);
        }
    }
}

template <class T, class Out>
PDEANIM_INLINE void evaluate(std::span<const T> time, const Fields<T> &fields, std::span<const double> reference,
                              std::span<Out> out) {
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
