#include "evaluate/motion.hpp"

#include <algorithm>
#include <cstring>

#include "basis/add_multiples.hpp"
#include "evaluate/lanes.hpp"
#include "multiversion.hpp"

namespace pdeanim {

namespace {

// Of so many functions of time at most, an element may keep fields: it never has more functions than twice that.
constexpr i64 most_fields = 64;

// Whether one loop does for all numbers of vertices: code for a page is fetched, and its registers are few.
#if defined(__wasm__)
constexpr bool is_small = true;
#else
constexpr bool is_small = false;
#endif

template <class Real> constexpr int lanes = 32 / sizeof(Real);

template <class Real> constexpr i64 padded(i64 size) { return (size + lanes<Real> - 1) / lanes<Real> * lanes<Real>; }

// Numbers of some frames side by side: of each axis those of all frames; of one frame the three axes, and nothing.
template <int frames> constexpr int width = frames == 1 ? 4 : 3 * frames;

// Of every function of time its values at some frames: `width` numbers, or one a frame where all axes share them.
template <int frames, class Real> struct TimeRows {
    template <class Own> PDEANIM_INLINE TimeRows(const Motion<Own> &motion, const double *time, i64 given)
        : is_shared(motion.axes == 3), stride(is_shared ? frames : width<frames>),
          values(static_cast<std::size_t>(motion.functions * stride)) {
        const i64 functions = motion.functions, time_axes = is_shared ? 1 : 3;
        for (i64 frame = 0; frame < given; ++frame) {
            for (i64 axis = 0; axis < time_axes; ++axis) {
                const double *from = time + (frame * time_axes + axis) * functions;
                Real *to = values.data() + axis * frames + frame;
                for (i64 a = 0; a < functions; ++a) to[a * stride] = static_cast<Real>(from[a]);
            }
        }
    }

    bool is_shared;
    i64 stride;
    std::vector<Real> values;
};

// What one function of space counts at some frames: the sum over its coefficients of functions of time.
template <int frames, class Real, class Coefficient> PDEANIM_INLINE void add_up(const TimeRows<frames, Real> &time,
                                                                                const Coefficient *begin,
                                                                                const Coefficient *end, Real *row) {
    constexpr int size = least(lanes<Real>, width<frames>), packs = width<frames> / size;
    using Pack = Lanes<Real, size>;
    if (time.is_shared) {
        std::fill_n(row, width<frames>, Real{0});
        for (const Coefficient *own = begin; own != end; ++own) {
            const Real *from = time.values.data() + own->function * frames;
            Real *to = row + own->axis * frames;
            if constexpr (frames == 1) {
                *to += own->value * *from;
            } else {
                for (int i = 0; i < frames; i += lanes<Real>) {
                    lanes_at<lanes<Real>>(to + i) += own->value * lanes_at<lanes<Real>>(from + i);
                }
            }
        }
        return;
    }
    Pack sums[packs] = {};
    for (const Coefficient *own = begin; own != end; ++own) {
        const Real *from = time.values.data() + own->function * width<frames>;
        for (int i = 0; i < packs; ++i) sums[i] += own->value * lanes_at<size>(from + i * size);
    }
    for (int i = 0; i < packs; ++i) lanes_at<size>(row + i * size) = sums[i];
}

// An element's vertices at some frames.
template <class Real> struct Target {
    const Real *values;   // of functions or fields at the first of the vertices
    i64 columns, stride;  // from one function or field to the next
    const Real *counts;   // what each counts at the frames
    i64 count_stride;
    const Real *away;  // reference frame; nothing where there is none
    i64 away_stride;
    const double *means;  // (axes, frames)
    const i32 *vertices;
    i64 size;    // of the vertices, how many are written
    i64 frames;  // of the frames likewise
};

// `packs` times as many vertices as a register holds, at frames `first` to `first` + `together` - 1. Where `is_shared`,
// columns have values for each axis, and count the same.
template <int frames, int packs, int together, bool is_shared, class Real, class Out>
PDEANIM_INLINE void add_columns(const Target<Real> &to, i64 first, i64 vertices, Out *out) {
    using Pack = Lanes<Real, lanes<Real>>;
    constexpr int size = lanes<Real>, points = packs * size;
    Pack sums[packs][3][together];
    for (int p = 0; p < packs; ++p) {
        for (int axis = 0; axis < 3; ++axis) {
            Pack away{};
            if (to.away) away = lanes_at<size>(to.away + axis * to.away_stride + p * size);
            for (int t = 0; t < together; ++t) sums[p][axis][t] = away;
        }
    }
    const Real *values = to.values, *counts = to.counts + first;
    for (i64 k = 0; k < to.columns; ++k) {
        if constexpr (is_shared) {
            for (int axis = 0; axis < 3; ++axis) {
                for (int p = 0; p < packs; ++p) {
                    const Pack value = lanes_at<size>(values + p * size);
                    for (int t = 0; t < together; ++t) sums[p][axis][t] += counts[t] * value;
                }
                values += to.stride;
            }
        } else {
            Pack value[packs];
            for (int p = 0; p < packs; ++p) value[p] = lanes_at<size>(values + p * size);
            for (int axis = 0; axis < 3; ++axis) {
                for (int t = 0; t < together; ++t) {
                    const Real count = counts[axis * frames + t];
                    for (int p = 0; p < packs; ++p) sums[p][axis][t] += count * value[p];
                }
            }
            values += to.stride;
        }
        counts += to.count_stride;
    }
    for (int t = 0; t < together && first + t < to.frames; ++t) {
        Real added[3][points];
        Out found[3][points], pairs[points][2];
        for (int axis = 0; axis < 3; ++axis) {
            for (int p = 0; p < packs; ++p) lanes_at<size>(added[axis] + p * size) = sums[p][axis][t];
            const double mean = to.means[axis * frames + first + t];
            for (int i = 0; i < points; ++i)
                found[axis][i] = static_cast<Out>(mean + static_cast<double>(added[axis][i]));
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

template <int frames, bool is_shared, int packs, int together, class Real, class Out>
PDEANIM_INLINE void write_vertices(Target<Real> &to, i64 vertices, Out *out) {
    for (i64 t = 0; t < to.frames; t += together) {
        add_columns<frames, packs, together, is_shared>(to, t, vertices, out);
    }
    constexpr i64 points = packs * lanes<Real>;
    to.values += points;
    if (to.away) to.away += points;
    to.vertices += points;
    to.size -= points;
}

// Twelve sums are kept in registers, or fewer.
template <int frames, bool is_shared, class Real, class Out>
PDEANIM_INLINE void write_element(Target<Real> to, i64 vertices, Out *out) {
    if constexpr (is_small) {
        while (to.size > 0) write_vertices<frames, is_shared, 1, 1>(to, vertices, out);
    } else if constexpr (frames == 1) {
        while (to.size > 3 * lanes<Real>) write_vertices<frames, is_shared, 4, 1>(to, vertices, out);
        if (to.size > 2 * lanes<Real>) write_vertices<frames, is_shared, 3, 1>(to, vertices, out);
        if (to.size > lanes<Real>) write_vertices<frames, is_shared, 2, 1>(to, vertices, out);
        if (to.size > 0) write_vertices<frames, is_shared, 1, 1>(to, vertices, out);
    } else {
        while (to.size > lanes<Real>) write_vertices<frames, is_shared, 2, 2>(to, vertices, out);
        if (to.size > 0) write_vertices<frames, is_shared, 1, 4>(to, vertices, out);
    }
}

template <int frames, class Real, class Out>
PDEANIM_INLINE void evaluate_some(const Motion<Real> &motion, const double *time, i64 given,
                                  const AnchoredReference<Real> *reference, VertexShare share, Out *out) {
    constexpr int columns = width<frames>, most_functions = PartitionTree::most_functions;
    constexpr int size = least(lanes<double>, columns);
    using Pack = Lanes<double, size>;
    const SpaceBasis &basis = *motion.basis;
    const PartitionTree &tree = basis.tree();
    const Patches &patches = *basis.elements().patches;
    const TimeRows<frames, double> exact(motion, time, given);
    const TimeRows<frames, Real> usual(motion, time, given);
    std::vector<Real> counts;
    // Nodes whose affine functions are summed up, and that are still to come, the next one last.
    struct Node {
        i64 number;
        int level;
        double affine[affine_count * columns];
    };
    const auto tree_row = [&](i64 function, double *row) {
        const auto *own = motion.tree.coefficients.data();
        add_up<frames>(exact, own + motion.tree.starts[function], own + motion.tree.starts[function + 1], row);
    };
    std::vector<Node> waiting(1);
    waiting[0].number = 0;
    waiting[0].level = 0;
    for (i64 k = 0; k < tree.affine(); ++k) tree_row(k, waiting[0].affine + k * columns);
    i64 element = -1;
    while (!waiting.empty()) {
        const Node node = waiting.back();
        waiting.pop_back();
        const i64 own = tree.affine_of(node.number), half = patches.children[node.number];
        if (half >= 0) {
            const i64 total = tree.affine_of(half) + tree.affine_of(half + 1), split = tree.affine_of(half);
            const PartitionTree::Matrix &matrix = tree.matrix(node.number);
            // What the node's functions count, as far as they do, and the rows of the matrix for them.
            double wavelets[most_functions][columns], affine[most_functions][columns];
            const double *rows[most_functions], *multiples[most_functions];
            i64 used = own;
            for (i64 k = 0; k < own; ++k) {
                rows[k] = node.affine + k * columns;
                multiples[k] = matrix[k].data();
            }
            for (i64 k = own; k < total; ++k) {
                const i64 function = tree.first_wavelet(node.number) + k - own;
                if (motion.tree.starts[function] == motion.tree.starts[function + 1]) continue;
                tree_row(function, wavelets[k]);
                rows[used] = wavelets[k];
                multiples[used++] = matrix[k].data();
            }
            for (int p = 0; p < columns; p += size) {
                Pack sums[most_functions] = {};
                for (i64 k = 0; k < used; ++k) {
                    const Pack row = lanes_at<size>(rows[k] + p);
                    for (int i = 0; i < most_functions; ++i) sums[i] += multiples[k][i] * row;
                }
                for (int i = 0; i < most_functions; ++i) lanes_at<size>(affine[i] + p) = sums[i];
            }
            // The first half comes first.
            for (const int side : {1, 0}) {
                if (node.level < share.levels && (share.number >> node.level & 1) != side) continue;
                waiting.emplace_back();
                waiting.back().number = half + side;
                waiting.back().level = node.level + 1;
                std::copy_n(affine[side * split], (side == 0 ? split : total - split) * columns, waiting.back().affine);
            }
            continue;
        }
        if (node.level < share.levels && share.number >> node.level != 0) continue;
        // Elements come in their order, as the halves of a node do.
        if (element < 0) {
            const i64 place = patches.begins[node.number];
            element = std::lower_bound(patches.starts.begin(), patches.starts.end(), place) - patches.starts.begin();
        }
        if (motion.is_left_out(element)) {
            ++element;
            continue;
        }
        const typename Motion<Real>::Element &item = motion.elements[element];
        double means[columns] = {};
        for (int axis = 0; axis < 3; ++axis) {
            const double anchor = reference ? reference->anchors[3 * element + axis] : 0.0;
            for (int t = 0; t < frames; ++t) {
                const double mean = own > 0 ? item.constant * node.affine[axis * frames + t] : 0.0;
                means[axis * frames + t] = anchor + mean;
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
        to.vertices = motion.places(element);
        to.frames = given;
        if (item.has_fields) {
            to.counts = usual.values.data();
            to.count_stride = usual.stride;
        } else {
            counts.resize(item.columns * columns);
            const i64 affine = most<i64>(own - 1, 0);
            for (i64 i = 0; i < least(affine, item.columns) * columns; ++i) {
                counts[i] = static_cast<Real>(node.affine[columns + i]);
            }
            for (i64 k = affine; k < item.columns; ++k) {
                const auto *coefficients = item.rows.coefficients.data();
                add_up<frames>(usual, coefficients + item.rows.starts[k - affine],
                               coefficients + item.rows.starts[k - affine + 1], counts.data() + k * columns);
            }
            to.counts = counts.data();
            to.count_stride = columns;
        }
        if (item.has_fields && usual.is_shared) {
            write_element<frames, true>(to, motion.vertices(), out);
        } else {
            write_element<frames, false>(to, motion.vertices(), out);
        }
        ++element;
    }
}

template <class Real, class Out>
PDEANIM_INLINE void evaluate_all(const Motion<Real> &motion, std::span<const double> time,
                                 const AnchoredReference<Real> *reference, std::span<Out> out, VertexShare share) {
    const i64 size = 3 * motion.vertices(), row = motion.time_axes() * motion.functions;
    const i64 frames = size ? static_cast<i64>(out.size()) / size : 0;
    for (i64 frame = 0; frame < frames;) {
        const i64 given = least(frames_at_once, frames - frame);
        const double *own = time.data() + frame * row;
        if (given == 1) {
            evaluate_some<1>(motion, own, given, reference, share, out.data() + frame * size);
        } else {
            evaluate_some<frames_at_once>(motion, own, given, reference, share, out.data() + frame * size);
        }
        frame += given;
    }
}

}  // namespace

template <class Real> AnchoredReference<Real>::AnchoredReference(const Patches &patches, std::span<const double> points)
    : anchors(3 * patches.count()), starts(patches.count() + 1) {
    for (i64 e = 0; e < patches.count(); ++e) starts[e + 1] = starts[e] + 3 * padded<Real>(patches.size(e));
    away.resize(starts.back());
    for (i64 e = 0; e < patches.count(); ++e) {
        const std::span<const i32> vertices = patches.vertices(e);
        for (int axis = 0; axis < 3; ++axis) {
            const double anchor = points[3 * vertices[0] + axis];
            anchors[3 * e + axis] = anchor;
            Real *to = away.data() + starts[e] + axis * padded<Real>(patches.size(e));
            for (const i32 vertex : vertices) *to++ = static_cast<Real>(points[3 * vertex + axis] - anchor);
        }
    }
}

template <class Real> Motion<Real>::Motion(const SpaceBasis &basis, i64 functions, int axes, double step)
    : basis(&basis), functions(functions), axes(axes), step(step), elements(basis.elements().count()) {}

template <class Real> void Motion<Real>::choose(std::span<const i64> chosen) {
    const Patches &patches = *basis->elements().patches;
    is_chosen.assign(patches.count(), 0);
    chosen_places.assign(basis->vertices(), 0);
    chosen_vertices = 0;
    for (const i64 e : chosen) {
        is_chosen[e] = 1;
        for (i64 at = patches.starts[e]; at < patches.starts[e + 1]; ++at) {
            chosen_places[at] = static_cast<i32>(chosen_vertices++);
        }
    }
}

template <class Real> i64 Motion<Real>::bytes() const {
    i64 total =
        static_cast<i64>(sizeof(tree.coefficients[0]) * tree.coefficients.size() + sizeof(i64) * tree.starts.size());
    for (const Element &own : elements) {
        total +=
            static_cast<i64>(sizeof(Element) + sizeof(Real) * own.values.size() + sizeof(i64) * own.rows.starts.size() +
                             sizeof(own.rows.coefficients[0]) * own.rows.coefficients.size());
    }
    return total;
}

namespace {

template <class Value, class Rows>
void append_row(Rows &rows, const QuantisedRows &quantised, i64 function, int axes, double step) {
    const i64 *row = quantised.row(function);
    for (i64 channel = 0; channel < quantised.used_of(function); ++channel) {
        if (row[channel] == 0) continue;
        rows.coefficients.push_back({static_cast<u16>(channel / axes), static_cast<u16>(channel % axes),
                                     static_cast<Value>(static_cast<double>(row[channel]) * step)});
    }
    rows.starts.push_back(static_cast<i64>(rows.coefficients.size()));
}

}  // namespace

template <class Real> void Motion<Real>::take_tree(const QuantisedRows &rows) {
    const PartitionTree &own = basis->tree();
    for (i64 row = 0; row < own.functions(); ++row) append_row<double>(tree, rows, row, axes, step);
    if (functions > most_fields) return;
    std::vector<double> values(own.functions() * channels());
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = static_cast<double>(rows.numbers[i]) * step;
    affine_.resize(affine_count * own.nodes() * channels());
    own.synthesise(values.data(), affine_, channels());
}

// Fields of an element's functions but the constant one; values: of these functions.
template <class Real> void Motion<Real>::make_fields(i64 element, i64 rank, const QuantisedRows &rows,
                                                     std::span<const double *const> values) {
    Element &own = elements[element];
    const Elements &all = basis->elements();
    const i64 affine = all.affine[element], size = all.patches->size(element), width = channels();
    const i64 skipped = affine > 0;
    own.values.resize(width * padded<Real>(size));
    std::vector<double> multiples(rank - skipped), sums;
    for (i64 channel = 0; channel < width; ++channel) {
        for (i64 k = skipped; k < rank; ++k) {
            const i64 node = all.patches->node_of[element];
            multiples[k - skipped] =
                k < affine ? affine_[(affine_count * node + k) * width + channel]
                           : static_cast<double>(rows.row(all.first_function(element) + k)[channel]) * step;
        }
        sums.assign(size, 0.0);
        add_multiples(sums.data(), size, values.data() + skipped, multiples.data(), rank - skipped);
        std::copy(sums.begin(), sums.end(), own.values.begin() + channel * padded<Real>(size));
    }
    own.has_fields = true;
    own.columns = functions;
}

template <class Real> void Motion<Real>::take_elements(i64 first, i64 end, const QuantisedRows &rows) {
    const Elements &all = basis->elements();
    ElementFunctions made(all);
    std::vector<const double *> values;
    for (i64 e = first; e < end; ++e) {
        if (is_left_out(e)) continue;
        Element &own = elements[e];
        const i64 affine = all.affine[e], size = all.patches->size(e), skipped = affine > 0;
        const i64 first_function = all.first_function(e);
        // An element's functions are made as far as there are coefficients for them: mostly a fraction.
        i64 rank = all.rank(e);
        while (rank > affine && rows.is_zero(first_function + rank - 1)) --rank;
        const std::span<const double> given = basis->functions_of(e);
        if (given.empty()) made.make(e, rank);
        values.clear();
        for (i64 k = 0; k < rank; ++k) values.push_back(given.empty() ? made.function(k) : given.data() + k * size);
        own.constant = affine > 0 ? values[0][0] : 0.0;
        if (rank - skipped > functions && functions <= most_fields) {
            make_fields(e, rank, rows, values);
            continue;
        }
        own.columns = rank - skipped;
        own.values.resize(own.columns * padded<Real>(size));
        for (i64 k = skipped; k < rank; ++k) {
            std::copy_n(values[k], size, own.values.begin() + (k - skipped) * padded<Real>(size));
        }
        for (i64 k = affine; k < rank; ++k) append_row<Real>(own.rows, rows, first_function + k, axes, step);
    }
}

template struct AnchoredReference<float>;
template struct AnchoredReference<double>;
template struct Motion<float>;
template struct Motion<double>;

PDEANIM_MULTIVERSION void evaluate(const Motion<float> &motion, std::span<const double> time,
                                   const AnchoredReference<float> *reference, std::span<float> out, VertexShare share) {
    evaluate_all(motion, time, reference, out, share);
}

PDEANIM_MULTIVERSION void evaluate(const Motion<float> &motion, std::span<const double> time,
                                   const AnchoredReference<float> *reference, std::span<double> out,
                                   VertexShare share) {
    evaluate_all(motion, time, reference, out, share);
}

PDEANIM_MULTIVERSION void evaluate(const Motion<double> &motion, std::span<const double> time,
                                   const AnchoredReference<double> *reference, std::span<float> out,
                                   VertexShare share) {
    evaluate_all(motion, time, reference, out, share);
}

PDEANIM_MULTIVERSION void evaluate(const Motion<double> &motion, std::span<const double> time,
                                   const AnchoredReference<double> *reference, std::span<double> out,
                                   VertexShare share) {
    evaluate_all(motion, time, reference, out, share);
}

}  // namespace pdeanim
