#include <algorithm>
#include <cstdint>
#include <cstring>
#include <type_traits>

#include "evaluate/lanes.hpp"
#include "evaluate/motion.hpp"
#include "multiversion.hpp"

namespace pdeanim {

namespace {

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
    template <class Own> PDEANIM_INLINE TimeRows(const Motion<Own> &motion, const double *time, i64 given)
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
    std::vector<Real> values;
};

// So many sums are added up beside each other and put together at the end: one number would wait for the one before it.
constexpr int partial_sums = 2;

// `packs` registers of a row of counts, from number `first` on.
template <int packs, int size, class Real, class Coefficient>
PDEANIM_INLINE void add_up_part(const Real *time, i64 stride, const Coefficient *begin, const Coefficient *end,
                                Real *row) {
    using Pack = Lanes<Real, size>;
    Pack sums[partial_sums][packs] = {};
    const auto add = [&](int part, const Coefficient &own) PDEANIM_INLINE_LAMBDA {
        const Real *from = time + own.function * stride;
        for (int i = 0; i < packs; ++i) sums[part][i] += own.value * lanes_at<size>(from + i * size);
    };
    const Coefficient *own = begin;
    for (; end - own >= partial_sums; own += partial_sums) {
        for (int part = 0; part < partial_sums; ++part) add(part, own[part]);
    }
    if (own != end) add(0, *own);
    for (int i = 0; i < packs; ++i) {
        lanes_at<size>(row + i * size) = sums[0][i] + sums[1][i];
    }
}

// What one function of space counts at some frames: the sum over its coefficients of functions of time.
template <int bytes, int frames, class Real, class Coefficient>
PDEANIM_INLINE void add_up(const TimeRows<frames, Real> &time, const Coefficient *begin, const Coefficient *end,
                           Real *row) {
    constexpr int size = least(lanes<bytes, Real>, width<frames>), packs = width<frames> / size;
    if (time.is_shared) {
        constexpr int own_size = least(lanes<bytes, Real>, frames);
        std::fill_n(row, width<frames>, Real{0});
        for (const Coefficient *own = begin; own != end; ++own) {
            const Real *from = time.values.data() + own->function * frames;
            Real *to = row + own->axis * frames;
            if constexpr (frames == 1) {
                *to += own->value * *from;
            } else {
                for (int i = 0; i < frames; i += own_size) {
                    lanes_at<own_size>(to + i) += own->value * lanes_at<own_size>(from + i);
                }
            }
        }
        return;
    }
    constexpr int at_once = least(packs, 6);
    static_assert(packs % at_once == 0);
    for (int first = 0; first < packs; first += at_once) {
        add_up_part<at_once, size>(time.values.data() + first * size, width<frames>, begin, end, row + first * size);
    }
}

// An element's vertices at some frames.
template <class Real> struct Target {
    const Real *values;   // of functions or fields at the first of the vertices
    i64 columns, stride;  // from one function or field to the next
    const Real *counts;   // what each counts at the frames
    i64 count_stride;
    const Real *away;  // reference frame; nothing where there is none
    i64 away_stride;
    const Real *means, *rests;  // (axes, frames): of the means, and what these leave
    const i32 *vertices;
    i64 size;    // of the vertices, how many are written
    i64 frames;  // of the frames likewise
};

// One coordinate of some vertices: what is added up so far, with the two parts of its mean, the lesser one first.
template <int size, int points, class Real, class Out>
PDEANIM_INLINE void add_mean(Real *added, Real mean, Real rest, Out *found) {
    for (int i = 0; i < points; i += size) {
        lanes_at<size>(added + i) = rest + lanes_at<size>(added + i);
        if constexpr (std::is_same_v<Real, Out>) lanes_at<size>(found + i) = mean + lanes_at<size>(added + i);
    }
    if constexpr (std::is_same_v<Real, Out>) return;
    for (int i = 0; i < points; ++i) {
        found[i] = static_cast<Out>(static_cast<double>(mean) + static_cast<double>(added[i]));
    }
}

// `packs` times as many vertices as a register holds, at frames `first` to `first` + `together` - 1. Where `is_shared`,
// columns have values for each axis, and count the same.
template <int bytes, int frames, int packs, int together, bool is_shared, class Real, class Out>
PDEANIM_INLINE void add_columns(const Target<Real> &to, i64 first, i64 vertices, Out *out) {
    constexpr int size = lanes<bytes, Real>, points = packs * size;
    using Pack = Lanes<Real, size>;
    Pack sums[3][together][packs];
    for (int axis = 0; axis < 3; ++axis) {
        for (int p = 0; p < packs; ++p) {
            Pack away{};
            if (to.away) away = lanes_at<size>(to.away + axis * to.away_stride + p * size);
            for (int t = 0; t < together; ++t) sums[axis][t][p] = away;
        }
    }
    const Real *values = to.values, *counts = to.counts + first;
    for (i64 k = 0; k < to.columns; ++k) {
        if constexpr (is_shared) {
            for (int axis = 0; axis < 3; ++axis) {
                for (int p = 0; p < packs; ++p) {
                    const Pack value = lanes_at<size>(values + p * size);
                    for (int t = 0; t < together; ++t) sums[axis][t][p] += counts[t] * value;
                }
                values += to.stride;
            }
        } else {
            Pack value[packs];
            for (int p = 0; p < packs; ++p) value[p] = lanes_at<size>(values + p * size);
            for (int axis = 0; axis < 3; ++axis) {
                for (int t = 0; t < together; ++t) {
                    const Real count = counts[axis * frames + t];
                    for (int p = 0; p < packs; ++p) sums[axis][t][p] += count * value[p];
                }
            }
            values += to.stride;
        }
        counts += to.count_stride;
    }
    Real added[together][3][points];
    for (int t = 0; t < together; ++t) {
        for (int axis = 0; axis < 3; ++axis) {
            for (int p = 0; p < packs; ++p) lanes_at<size>(added[t][axis] + p * size) = sums[axis][t][p];
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

// Bring the line of the cache that an address lies in near, to be written.
PDEANIM_INLINE void prefetch_to_write([[maybe_unused]] const void *address) {
#if defined(__GNUC__)
    __builtin_prefetch(address, 1);
#endif
}

// Lines of the cache that hold an element's next vertices, `points` at most, at the first frame.
template <int points, class Out> class DistinctLines {
public:
    template <class Real> PDEANIM_INLINE DistinctLines(const Target<Real> &to, const Out *out) {
        std::uintptr_t last = 0;
        for (i64 i = 0; i < least<i64>(points, to.size); ++i) {
            const Out *end = out + 3 * static_cast<i64>(to.vertices[i]) + 2;
            const auto line = reinterpret_cast<std::uintptr_t>(end) / bytes_of_a_line;
            if (line != last) ends_[count_++] = end;
            last = line;
        }
    }

    // Fetch them for frames `first` to `first` + `together` - 1, as far as there are.
    template <class Real>
    PDEANIM_INLINE void fetch(const Target<Real> &to, i64 first, i64 together, i64 vertices) const {
        for (i64 t = first; t < least(first + together, to.frames); ++t) {
            for (int i = 0; i < count_; ++i) prefetch_to_write(ends_[i] + t * 3 * vertices);
        }
    }

private:
    static constexpr std::uintptr_t bytes_of_a_line = 64;

    const Out *ends_[points];
    int count_ = 0;
};

template <int bytes, int frames, bool is_shared, int packs, int together, class Real, class Out>
PDEANIM_INLINE void write_vertices(Target<Real> &to, i64 vertices, Out *out) {
    constexpr i64 points = packs * lanes<bytes, Real>;
    if constexpr (frames == 1 || is_small<bytes>) {
        for (i64 t = 0; t < to.frames; t += together) {
            add_columns<bytes, frames, packs, together, is_shared>(to, t, vertices, out);
        }
    } else {
        // Vertices are scattered over the frames: where they go is fetched while others are added up.
        const DistinctLines<points, Out> lines(to, out);
        lines.fetch(to, 0, together, vertices);
        for (i64 t = 0; t < to.frames; t += together) {
            lines.fetch(to, t + together, together, vertices);
            add_columns<bytes, frames, packs, together, is_shared>(to, t, vertices, out);
        }
    }
    to.values += points;
    if (to.away) to.away += points;
    to.vertices += points;
    to.size -= points;
}

// Twelve sums are kept in registers, or fewer; 24 where there are twice as many registers.
template <int bytes, int frames, bool is_shared, class Real, class Out>
PDEANIM_INLINE void write_element(Target<Real> to, i64 vertices, Out *out) {
    constexpr int size = lanes<bytes, Real>, more = has_many_registers<bytes> ? 2 : 1;
    if constexpr (is_small<bytes>) {
        while (to.size > 0) write_vertices<bytes, frames, is_shared, 1, 1>(to, vertices, out);
    } else if constexpr (frames == 1 && std::is_same_v<Out, double>) {
        // What is added to other groups' is rarer than what is shown: a loop as wide as elements are filled up to.
        while (to.size > 0) write_vertices<bytes, frames, is_shared, 64 / bytes, 1>(to, vertices, out);
    } else if constexpr (frames == 1) {
        while (to.size > 3 * size) write_vertices<bytes, frames, is_shared, 4, 1>(to, vertices, out);
        if (to.size > 2 * size) write_vertices<bytes, frames, is_shared, 3, 1>(to, vertices, out);
        if (to.size > size) write_vertices<bytes, frames, is_shared, 2, 1>(to, vertices, out);
        if (to.size > 0) write_vertices<bytes, frames, is_shared, 1, 1>(to, vertices, out);
    } else {
        while (to.size > size) write_vertices<bytes, frames, is_shared, 2, 2 * more>(to, vertices, out);
        if (to.size > 0) write_vertices<bytes, frames, is_shared, 1, 4 * more>(to, vertices, out);
    }
}

// A node of the tree whose affine functions are summed up.
template <int frames> struct Node {
    i64 number;
    int level;
    double affine[affine_count * width<frames>];
};

// A motion at some frames: what the functions of space count there, down the tree.
template <int bytes, int frames, class Real> class Descent {
public:
    PDEANIM_INLINE Descent(const Motion<Real> &motion, const TimeRows<frames, double> &time, VertexShare share)
        : motion_(motion), tree_(motion.basis->tree()), patches_(*motion.basis->elements().patches), time_(time),
          share_(share), waiting_(1) {
        waiting_[0].number = 0;
        waiting_[0].level = 0;
        for (i64 k = 0; k < tree_.affine(); ++k) add_up_row(k, waiting_[0].affine + k * columns);
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
        const auto *own = motion_.tree.coefficients.data();
        add_up<bytes, frames>(time_, own + motion_.tree.starts[function], own + motion_.tree.starts[function + 1], row);
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
        const i64 own = tree_.affine_of(number), split = tree_.affine_of(half);
        const i64 total = split + tree_.affine_of(half + 1);
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
            const i64 function = tree_.first_wavelet(number) + k - own;
            if (!has_row(function)) continue;
            add_up_row(function, wavelets[k]);
            rows[used] = wavelets[k];
            multiples[used++] = matrix[k].data();
        }
        for (double *&row : to) row = ignored;
        waiting_count_ = place;
        for (const int side : {1, 0}) {
            if (level < share_.levels && (share_.number >> level & 1) != side) continue;
            Node<frames> &child = waiting_[waiting_count_++];
            child.number = half + side;
            child.level = level + 1;
            const i64 first = side == 0 ? 0 : split, end = side == 0 ? split : total;
            for (i64 i = first; i < end; ++i) to[i] = child.affine + (i - first) * columns;
        }
        // A half may stand where the node does: each number of it is read before those at its place are written.
        for (int p = 0; p < columns; p += size) {
            Pack sums[most_functions] = {};
            for (i64 k = 0; k < used; ++k) {
                const Pack row = lanes_at<size>(rows[k] + p);
                for (int i = 0; i < most_functions; ++i) sums[i] += multiples[k][i] * row;
            }
            for (int i = 0; i < most_functions; ++i) lanes_at<size>(to[i] + p) = sums[i];
        }
    }

    const Motion<Real> &motion_;
    const PartitionTree &tree_;
    const Patches &patches_;
    const TimeRows<frames, double> &time_;
    VertexShare share_;
    std::vector<Node<frames>> waiting_;  // still to come, the next one last
    i64 waiting_count_ = 1;
};

template <int bytes, int frames, class Real, class Out>
PDEANIM_INLINE void evaluate_some(const Motion<Real> &motion, const double *time, i64 given,
                                  const AnchoredReference<Real> *reference, VertexShare share, Out *out) {
    constexpr int columns = width<frames>;
    const PartitionTree &tree = motion.basis->tree();
    const Patches &patches = *motion.basis->elements().patches;
    const TimeRows<frames, double> exact(motion, time, given);
    const TimeRows<frames, Real> usual(motion, time, given);
    std::vector<Real> counts;
    Descent<bytes, frames, Real> descent(motion, exact, share);
    i64 element = -1;
    while (const Node<frames> *node = descent.next()) {
        // Elements come in their order, as the halves of a node do.
        if (element < 0) {
            const i64 place = patches.begins[node->number];
            element = std::lower_bound(patches.starts.begin(), patches.starts.end(), place) - patches.starts.begin();
        }
        if (motion.is_left_out(element)) {
            ++element;
            continue;
        }
        const typename Motion<Real>::Element &item = motion.elements[element];
        const i64 affine = tree.affine_of(node->number);
        Real means[columns] = {}, rests[columns] = {};
        for (int axis = 0; axis < 3; ++axis) {
            const double anchor = reference ? reference->anchors[3 * element + axis] : 0.0;
            for (int t = 0; t < frames; ++t) {
                const double moved = affine > 0 ? item.constant * node->affine[axis * frames + t] : 0.0;
                const double mean = anchor + moved;
                means[axis * frames + t] = static_cast<Real>(mean);
                rests[axis * frames + t] = static_cast<Real>(mean - static_cast<double>(means[axis * frames + t]));
            }
        }
        Target<Real> to;
        to.size = patches.size(element);
        to.stride = padded<Real>(to.size);
        to.values = item.values.data();
        to.columns = item.columns;
        to.away = reference ? reference->away.data() + reference->starts[element] : nullptr;
        to.away_stride = to.stride;
        to.means = means;
        to.rests = rests;
        to.vertices = motion.places(element);
        to.frames = given;
        if (item.has_fields) {
            to.counts = usual.values.data();
            to.count_stride = usual.stride;
        } else {
            counts.resize(item.columns * columns);
            const i64 first = most<i64>(affine - 1, 0);
            for (i64 i = 0; i < first * columns; ++i) counts[i] = static_cast<Real>(node->affine[columns + i]);
            const auto *coefficients = item.rows.coefficients.data();
            for (i64 k = first; k < item.columns; ++k) {
                const i64 begin = item.rows.starts[k - first], end = item.rows.starts[k - first + 1];
                add_up<bytes, frames>(usual, coefficients + begin, coefficients + end, counts.data() + k * columns);
            }
            to.counts = counts.data();
            to.count_stride = columns;
        }
        if (item.has_fields && usual.is_shared) {
            write_element<bytes, frames, true>(to, motion.vertices(), out);
        } else {
            write_element<bytes, frames, false>(to, motion.vertices(), out);
        }
        ++element;
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
        if (given == 1) {
            evaluate_some<bytes, 1>(motion, own, given, reference, share, to);
        } else {
            evaluate_some<bytes, frames_at_once>(motion, own, given, reference, share, to);
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
        // Only what is shown has loops for the widest registers: they take as long to compile as all others.
        if constexpr (std::is_same_v<Out, float>) {
            if (__builtin_cpu_supports("avx512f")) return by_64;
        }
        if (__builtin_cpu_supports("avx2")) return by_32;
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

template void evaluate(const Motion<float> &, std::span<const double>, const AnchoredReference<float> *,
                       std::span<float>, VertexShare);
template void evaluate(const Motion<float> &, std::span<const double>, const AnchoredReference<float> *,
                       std::span<double>, VertexShare);
template void evaluate(const Motion<double> &, std::span<const double>, const AnchoredReference<double> *,
                       std::span<float>, VertexShare);
template void evaluate(const Motion<double> &, std::span<const double>, const AnchoredReference<double> *,
                       std::span<double>, VertexShare);

}  // namespace pdeanim
