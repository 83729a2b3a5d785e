#include <algorithm>
#include <cstdint>
#include <cstring>
#include <type_traits>

#include "aligned_array.hpp"
#include "evaluate/motion.hpp"
#include "instructions.hpp"
#include "lanes.hpp"
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
    Pack sums[partial_sums][packs] = {};
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
    Pack sums[3][packs] = {};
    for (i64 k = 0; k < own.count; ++k) {
        const Real *values = own.values + Motion<Real>::padded_axes * k, *from = time + own.functions[k] * frames;
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
    constexpr int axes = static_cast<int>(Motion<Real>::padded_axes);
    static_assert(axes == width<1>);
    Lanes<Real, axes> sums{};
    for (i64 k = 0; k < own.count; ++k) sums += time[own.functions[k]] * lanes_at<axes>(own.values + axes * k);
    put_lanes(row, sums);
}

// What one function of space counts at some frames: the sum over its coefficients of functions of time.
template <int bytes, int frames, class Real, class Rows>
PDEANIM_INLINE void add_up(const TimeRows<frames, Real> &time, const Rows &rows, i64 function, Real *row) {
    const i64 start = rows.starts[function], numbers = time.is_shared ? Motion<Real>::padded_axes : 1;
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

// Functions or fields of an element, and what each counts at some frames.
template <class Real> struct Columns {
    const Real *values;  // from the element's first vertex on
    i64 count;
    const Real *counts;
    i64 count_stride;
    bool is_shared;  // they have values for each axis, and count the same on all of them
};

// An element's vertices at some frames.
template <class Real> struct Target {
    Columns<Real> columns;
    i64 stride;                 // from one function, field or axis of the reference frame to the next
    const Real *away;           // reference frame; nothing where there is none
    const Real *means, *rests;  // (axes, frames): of the means, and what these leave
    const i32 *vertices;
    i64 size;    // of the vertices, how many are written
    i64 frames;  // of the frames likewise

    PDEANIM_INLINE void pass(i64 points) {
        columns.values += points;
        if (away) away += points;
        vertices += points;
        size -= points;
    }
};

// Sums of some vertices at frames `first` to `first` + `together` - 1.
template <class Pack, int packs, int together> using Sums = Pack[3][together][packs];

// Bring the line of the cache that an address lies in near, to be written.
PDEANIM_INLINE void prefetch_to_write([[maybe_unused]] const void *address) {
#if defined(__GNUC__)
    __builtin_prefetch(address, 1);
#endif
}

// In the place of `DistinctLines` where none are fetched.
struct NoLines {
    PDEANIM_INLINE void fetch_one() {}
};

// Lines of the cache that hold an element's next vertices, `points` at most.
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

    // Those of frames `first` to `first` + `together` - 1, as far as there are, are fetched from now on.
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

// One coordinate of some vertices: what is added up so far, with the two parts of its mean, the lesser one first.
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

// `packs` times as many vertices as a register holds, at frames `first` to `first` + `together` - 1.
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
        // Vertices are scattered over the frames: where they go is fetched while others are added up.
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

// Twelve sums are kept in registers, or fewer; 24 where there are twice as many registers.
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
            Pack sums[most_functions] = {};
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
        // Loops for one frame are for what is shown.
        if constexpr (std::is_same_v<Out, float>) {
            if (given == 1) {
                evaluate_some<bytes, 1>(motion, own, given, reference, share, to);
                continue;
            }
        }
        evaluate_some<bytes, frames_at_once>(motion, own, given, reference, share, to);
    }
}

// Elements are filled up to the widest registers.
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
        // Only what is shown has loops for the widest registers: they take as long to compile as all others.
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
