// Computes positions at the vertices: adds up the functions of each element, or the fields of functions of time.
#include <cstdint>
#include <cstring>
#include <type_traits>

#include "base/lanes.hpp"
#include "decode/evaluate/descent.hpp"

namespace pdeanim {

namespace {

// The vertices of an element, the terms from which their positions at some frames are added up, and the output.
template <class Real> struct Target {
    Columns<Real> columns;
    i64 stride;        // distance in memory from one function (or field, or axis of the reference frame) to the next
    const Real *away;  // reference frame; null if there is none
    const Real *means, *rests;  // (axes, frames): mean positions, and their rounding errors
    const i32 *vertices;
    i64 size;    // number of vertices written
    i64 frames;  // number of frames written

    PDEANIM_INLINE void pass(i64 points) {
        if (columns.values) columns.values += points;  // null if there are no functions
        if (away) away += points;
        vertices += points;
        size -= points;
    }
};

// Sums of some vertices at frames `first` to `first` + `together` - 1.
template <class Pack, int packs, int together> using Sums = Pack[3][together][packs];

// Fetch the cache line of an address for writing.
PDEANIM_INLINE void prefetch_to_write([[maybe_unused]] const void *address) {
#if defined(__GNUC__)
    __builtin_prefetch(address, 1);
#endif
}

// Takes the place of `DistinctLines` if no cache lines are fetched.
struct NoLines {
    PDEANIM_INLINE void fetch_one() {}
};

// The different cache lines in which the next vertices of an element, at most `points`, are written.
template <int points, int together, class Out> class DistinctLines {
public:
    template <class Real> PDEANIM_INLINE DistinctLines(const Target<Real> &to, i64 vertices, const Out *out)
        : row_(3 * vertices), frames_(to.frames) {
        std::uintptr_t last = 0;
        for (i64 i = 0; i < least<i64>(points, to.size); ++i) {
            const Out *end = out + 3 * static_cast<i64>(to.vertices[i]) + 2;
            const auto line = reinterpret_cast<std::uintptr_t>(end) / cache_line;
            if (line != last) ends_[count_++] = end;
            last = line;
        }
    }

    // Schedule the lines of frames `first` to `first` + `together` - 1, as far as these frames exist.
    PDEANIM_INLINE void begin(i64 first) {
        next_ = waiting_;
        end_ = waiting_;
        for (i64 t = first; t < least<i64>(first + together, frames_); ++t) {
            for (int i = 0; i < count_; ++i) *end_++ = ends_[i] + t * row_;
        }
    }

    PDEANIM_INLINE void fetch_one() {
        if (next_ != end_) prefetch_to_write(*next_++);
    }

    PDEANIM_INLINE void fetch_all() {
        while (next_ != end_) fetch_one();
    }

private:
    const Out *ends_[points], *waiting_[points * together], **next_ = nullptr, **end_ = nullptr;
    i64 row_, frames_;
    int count_ = 0;
};

template <int size, int frames, class Pack, int packs, int together, class Real, class Lines>
PDEANIM_INLINE void add_up_columns(const Columns<Real> &columns, i64 stride, i64 first,
                                   Sums<Pack, packs, together> &sums, Lines &lines) {
    const Real *values = columns.values, *counts = columns.counts + first;
    if (columns.is_shared) {
        for (i64 k = 0; k < columns.count; ++k) {
            lines.fetch_one();
            for (int axis = 0; axis < 3; ++axis) {
                for (int p = 0; p < packs; ++p) {
                    const Pack value = lanes_at<size>(values + p * size);
                    for (int t = 0; t < together; ++t) sums[axis][t][p] += counts[t] * value;
                }
                values += stride;
            }
            counts += columns.count_stride;
        }
        return;
    }
    for (i64 k = 0; k < columns.count; ++k) {
        lines.fetch_one();
        Pack value[packs];
        for (int p = 0; p < packs; ++p) value[p] = lanes_at<size>(values + p * size);
        for (int axis = 0; axis < 3; ++axis) {
            for (int t = 0; t < together; ++t) {
                const Real count = counts[axis * frames + t];
                for (int p = 0; p < packs; ++p) sums[axis][t][p] += count * value[p];
            }
        }
        values += stride;
        counts += columns.count_stride;
    }
}

// Finish one coordinate of some vertices: add both parts of its mean to the sum so far, the smaller part first.
template <int size, int points, class Real, class Out>
PDEANIM_INLINE void add_mean(Real *added, Real mean, Real rest, Out *found) {
    for (int i = 0; i < points; i += size) {
        put_lanes(added + i, rest + lanes_at<size>(added + i));
        if constexpr (std::is_same_v<Real, Out>) put_lanes(found + i, mean + lanes_at<size>(added + i));
    }
    if constexpr (std::is_same_v<Real, Out>) return;
    for (int i = 0; i < points; ++i) {
        found[i] = static_cast<Out>(static_cast<double>(mean) + static_cast<double>(added[i]));
    }
}

// Compute and write `packs` registers of vertices at frames `first` to `first` + `together` - 1.
template <int bytes, int frames, int packs, int together, class Real, class Out, class Lines>
PDEANIM_INLINE void add_columns(const Target<Real> &to, i64 first, i64 vertices, Lines &lines, Out *out) {
    constexpr int size = lanes<bytes, Real>, points = packs * size;
    using Pack = Lanes<Real, size>;
    Sums<Pack, packs, together> sums;
    for (int axis = 0; axis < 3; ++axis) {
        for (int p = 0; p < packs; ++p) {
            Pack away{};
            if (to.away) away = lanes_at<size>(to.away + axis * to.stride + p * size);
            for (int t = 0; t < together; ++t) sums[axis][t][p] = away;
        }
    }
    add_up_columns<size, frames, Pack, packs, together>(to.columns, to.stride, first, sums, lines);
    Real added[together][3][points];
    for (int t = 0; t < together; ++t) {
        for (int axis = 0; axis < 3; ++axis) {
            for (int p = 0; p < packs; ++p) put_lanes(added[t][axis] + p * size, sums[axis][t][p]);
        }
    }
    for (int t = 0; t < together && first + t < to.frames; ++t) {
        Out found[3][points], pairs[points][2];
        for (int axis = 0; axis < 3; ++axis) {
            const i64 at = axis * frames + first + t;
            add_mean<size, points>(added[t][axis], to.means[at], to.rests[at], found[axis]);
        }
        for (int i = 0; i < points; ++i) {
            pairs[i][0] = found[0][i];
            pairs[i][1] = found[1][i];
        }
        Out *row = out + (first + t) * 3 * vertices;
        const i64 count = least<i64>(points, to.size);
        for (i64 i = 0; i < count; ++i) {
            Out *own = row + 3 * static_cast<i64>(to.vertices[i]);
            std::memcpy(own, pairs[i], sizeof pairs[i]);
            own[2] = found[2][i];
        }
    }
}

template <int bytes, int frames, int packs, int together, class Real, class Out>
PDEANIM_INLINE void write_vertices(Target<Real> &to, i64 vertices, Out *out) {
    constexpr i64 points = packs * lanes<bytes, Real>;
    if constexpr (frames == 1 || is_small<bytes>) {
        NoLines lines;
        for (i64 t = 0; t < to.frames; t += together) {
            add_columns<bytes, frames, packs, together>(to, t, vertices, lines, out);
        }
    } else {
        // Vertices are scattered over a frame in memory: fetch the lines of the next frames while these are added up.
        DistinctLines<points, together, Out> lines(to, vertices, out);
        lines.begin(0);
        lines.fetch_all();
        for (i64 t = 0; t < to.frames; t += together) {
            lines.begin(t + together);
            add_columns<bytes, frames, packs, together>(to, t, vertices, lines, out);
            lines.fetch_all();
        }
    }
    to.pass(points);
}

// Write an element in blocks whose sums stay in registers: at most 12 sums, or 24 with twice as many registers.
template <int bytes, int frames, class Real, class Out>
PDEANIM_INLINE void write_element(Target<Real> to, i64 vertices, Out *out) {
    constexpr int size = lanes<bytes, Real>, more = has_many_registers<bytes> ? 2 : 1;
    if constexpr (is_small<bytes>) {
        while (to.size > 0) write_vertices<bytes, frames, 1, 1>(to, vertices, out);
    } else if constexpr (frames == 1) {
        while (to.size > 3 * size) write_vertices<bytes, frames, 4, 1>(to, vertices, out);
        if (to.size > 2 * size) write_vertices<bytes, frames, 3, 1>(to, vertices, out);
        if (to.size > size) write_vertices<bytes, frames, 2, 1>(to, vertices, out);
        if (to.size > 0) write_vertices<bytes, frames, 1, 1>(to, vertices, out);
    } else {
        constexpr int half = size / 2;
        while (to.size > size + half) write_vertices<bytes, frames, 2, 2 * more>(to, vertices, out);
        if (to.size > half) write_vertices<bytes, frames, 1, 4 * more>(to, vertices, out);
        if (to.size > 0) write_vertices<bytes / 2, frames, 1, 4>(to, vertices, out);
    }
}

template <int bytes, int frames, class Real, class Out>
PDEANIM_INLINE void evaluate_some(const Motion<Real> &motion, const double *time, i64 given,
                                  const AnchoredReference<Real> *reference, VertexShare share, Out *out) {
    const Patches &patches = *motion.basis->elements().patches;
    MovedElements<bytes, frames, Real> elements(motion, time, given, share);
    while (elements.next()) {
        const i64 element = elements.element();
        Real means[width<frames>] = {}, rests[width<frames>] = {};
        for (int axis = 0; axis < 3; ++axis) {
            const double anchor = reference ? reference->anchors[3 * element + axis] : 0.0;
            for (int t = 0; t < frames; ++t) {
                const double mean = anchor + elements.moved(axis, t);
                means[axis * frames + t] = static_cast<Real>(mean);
                rests[axis * frames + t] = static_cast<Real>(mean - static_cast<double>(means[axis * frames + t]));
            }
        }
        Target<Real> to;
        to.columns = elements.columns();
        to.size = patches.size(element);
        to.stride = padded<Real>(to.size);
        to.away = reference ? reference->away.data() + reference->starts[element] : nullptr;
        to.means = means;
        to.rests = rests;
        to.vertices = motion.places(element);
        to.frames = given;
        write_element<bytes, frames>(to, motion.vertices(), out);
    }
}

template <int bytes, class Real, class Out>
PDEANIM_INLINE void evaluate_all(const Motion<Real> &motion, std::span<const double> time,
                                 const AnchoredReference<Real> *reference, std::span<Out> out, VertexShare share) {
    const i64 size = 3 * motion.vertices(), row = motion.time_axes() * motion.functions;
    const i64 frames = size ? static_cast<i64>(out.size()) / size : 0;
    for (i64 frame = 0; frame < frames;) {
        const i64 given = least(frames_at_once, frames - frame);
        const double *own = time.data() + frame * row;
        Out *to = out.data() + frame * size;
        frame += given;
        // Only float output has loops for a single frame.
        if constexpr (std::is_same_v<Out, float>) {
            if (given == 1) {
                evaluate_some<bytes, 1>(motion, own, given, reference, share, to);
                continue;
            }
        }
        evaluate_some<bytes, frames_at_once>(motion, own, given, reference, share, to);
    }
}

// Add a motion at one time to the reference frame. Elements are padded to the widest registers, so there is no
// remainder.
template <int bytes, class Real> PDEANIM_INLINE void displace_all(const Motion<Real> &motion, const double *weights,
                                                                  AnchoredReference<Real> &moved, VertexShare share) {
    constexpr int size = lanes<bytes, Real>, packs = is_small<bytes> ? 1 : 64 / bytes;
    using Pack = Lanes<Real, size>;
    const Patches &patches = *motion.basis->elements().patches;
    MovedElements<bytes, 1, Real> elements(motion, weights, 1, share);
    while (elements.next()) {
        const i64 element = elements.element(), stride = padded<Real>(patches.size(element));
        for (int axis = 0; axis < 3; ++axis) moved.anchors[3 * element + axis] += elements.moved(axis, 0);
        Columns<Real> columns = elements.columns();
        Real *away = moved.away.data() + moved.starts[element];
        for (i64 first = 0; first < stride; first += packs * size) {
            Sums<Pack, packs, 1> sums;
            for (int axis = 0; axis < 3; ++axis) {
                for (int p = 0; p < packs; ++p) sums[axis][0][p] = lanes_at<size>(away + axis * stride + p * size);
            }
            NoLines lines;
            add_up_columns<size, 1, Pack, packs, 1>(columns, stride, 0, sums, lines);
            for (int axis = 0; axis < 3; ++axis) {
                for (int p = 0; p < packs; ++p) put_lanes(away + axis * stride + p * size, sums[axis][0][p]);
            }
            columns.values += packs * size;
            away += packs * size;
        }
    }
}

template <class Real, class Out> struct Evaluate {
    using Function = void(const Motion<Real> &, std::span<const double>, const AnchoredReference<Real> *,
                          std::span<Out>, VertexShare);

#if defined(PDEANIM_FOR)
    PDEANIM_FOR("avx512f")
    static void by_64(const Motion<Real> &motion, std::span<const double> time,
                      const AnchoredReference<Real> *reference, std::span<Out> out, VertexShare share) {
        evaluate_all<64>(motion, time, reference, out, share);
    }

    PDEANIM_FOR("avx2")
    static void by_32(const Motion<Real> &motion, std::span<const double> time,
                      const AnchoredReference<Real> *reference, std::span<Out> out, VertexShare share) {
        evaluate_all<32>(motion, time, reference, out, share);
    }
#endif

    static void by_16(const Motion<Real> &motion, std::span<const double> time,
                      const AnchoredReference<Real> *reference, std::span<Out> out, VertexShare share) {
        evaluate_all<16>(motion, time, reference, out, share);
    }

    static Function *widest() {
#if defined(PDEANIM_FOR)
        // Only float output has loops for the widest registers: they take as long to compile as all others.
        if constexpr (std::is_same_v<Out, float>) {
            if (has_avx512f()) return by_64;
        }
        if (has_avx2()) return by_32;
#endif
        return by_16;
    }
};

template <class Real> struct Displace {
    using Function = void(const Motion<Real> &, std::span<const double>, AnchoredReference<Real> &, VertexShare);

#if defined(PDEANIM_FOR)
    PDEANIM_FOR("avx2")
    static void by_32(const Motion<Real> &motion, std::span<const double> weights, AnchoredReference<Real> &moved,
                      VertexShare share) {
        displace_all<32>(motion, weights.data(), moved, share);
    }
#endif

    static void by_16(const Motion<Real> &motion, std::span<const double> weights, AnchoredReference<Real> &moved,
                      VertexShare share) {
        displace_all<16>(motion, weights.data(), moved, share);
    }

    static Function *widest() {
#if defined(PDEANIM_FOR)
        if (has_avx2()) return by_32;
#endif
        return by_16;
    }
};

}  // namespace

template <class Real, class Out> void evaluate(const Motion<Real> &motion, std::span<const double> time,
                                               const AnchoredReference<Real> *reference, std::span<Out> out,
                                               VertexShare share) {
    static const auto chosen = Evaluate<Real, Out>::widest();
    chosen(motion, time, reference, out, share);
}

template <class Real> void displace(const Motion<Real> &motion, std::span<const double> weights,
                                    AnchoredReference<Real> &moved, VertexShare share) {
    static const auto chosen = Displace<Real>::widest();
    chosen(motion, weights, moved, share);
}

template void evaluate(const Motion<float> &, std::span<const double>, const AnchoredReference<float> *,
                       std::span<float>, VertexShare);
template void evaluate(const Motion<float> &, std::span<const double>, const AnchoredReference<float> *,
                       std::span<double>, VertexShare);
template void evaluate(const Motion<double> &, std::span<const double>, const AnchoredReference<double> *,
                       std::span<float>, VertexShare);
template void evaluate(const Motion<double> &, std::span<const double>, const AnchoredReference<double> *,
                       std::span<double>, VertexShare);
template void displace(const Motion<float> &, std::span<const double>, AnchoredReference<float> &, VertexShare);
template void displace(const Motion<double> &, std::span<const double>, AnchoredReference<double> &, VertexShare);

}  // namespace pdeanim
