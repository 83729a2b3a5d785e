#include "sections/spatial/partition_tree.hpp"

#include <algorithm>
#include <utility>

#include "linalg/products.hpp"

namespace pdeanim {

SpaceSelection::SpaceSelection(const SpaceLayout &layout, std::span<const i64> subbands)
    : tree_rows(layout.tree_functions(), -1), element_rows(layout.elements(), -1), has_elements(layout.nodes()) {
    const SubbandTable &all = layout.subbands();
    const i64 first_element = static_cast<i64>(all.kinds.size()) - layout.elements();
    for (const i64 subband : subbands) {
        const i64 begin = all.starts[subband], end = all.starts[subband + 1];
        if (subband < first_element) {
            for (i64 function = begin; function < end; ++function) tree_rows[function] = functions + function - begin;
        } else {
            const i64 element = subband - first_element;
            elements.push_back(element);
            element_rows[element] = functions;
            has_elements[layout.patches()->node_of[element]] = 1;
        }
        functions += end - begin;
    }
    const std::vector<i64> &children = layout.patches()->children;
    for (i64 node = layout.nodes(); node-- > 0;) {
        const i64 half = children[node];
        if (half >= 0) has_elements[node] = has_elements[half] | has_elements[half + 1];
    }
}

namespace {

// An encoder leaves out an axis if at most this fraction of its squared norm is new.
constexpr double dependent = 0x1p-16;

}  // namespace

PartitionTree::PartitionTree(const Elements &elements, const std::vector<AffineSums> &sums,
                             std::shared_ptr<const SpaceLayout> layout)
    : layout_(std::move(layout)) {
    std::vector<u8> masks = layout_->masks();
    build_matrices(elements, sums, layout_->local(), masks, false);
}

PartitionTree::PartitionTree(const Elements &elements, const std::vector<AffineSums> &sums, std::vector<u8> local) {
    std::vector<u8> masks(elements.patches->children.size());
    build_matrices(elements, sums, local, masks, true);
    layout_ = std::make_shared<SpaceLayout>(elements.form, elements.patches, std::move(local), std::move(masks));
}

// local: number of local coordinates of each element. masks: which of 1, x, y and z each node keeps; read, or written
// if `chooses`.
void PartitionTree::build_matrices(const Elements &elements, const std::vector<AffineSums> &of_elements,
                                   const std::vector<u8> &local, std::vector<u8> &masks, bool chooses) {
    const Patches &patches = *elements.patches;
    // Number of affine functions of each node.
    std::vector<i64> affine = SpaceLayout::affine_of_elements(elements.form, patches, local);
    const std::vector<i64> &children = patches.children;
    const i64 nodes = static_cast<i64>(children.size());
    std::vector<AffineSums> sums(nodes);
    for (i64 element = 0; element < elements.count(); ++element) {
        sums[patches.node_of[element]] = of_elements[element];
    }
    const auto origin = [&](i64 node) { return elements.grid[patches.order[patches.begins[node]]]; };
    i64 place = std::count_if(children.begin(), children.end(), [](i64 half) { return half >= 0; });
    matrices_.resize(place);
    OrthonormalFunctions functions;
    for (i64 node = nodes; node-- > 0;) {
        const i64 a = children[node], b = a + 1;
        if (a < 0) continue;
        const i64 size = affine[a] + affine[b];
        std::array<std::array<double, affine_count>, most_functions> stacked;
        const GridPoint from = origin(a), to = origin(b);
        for (i64 k = 0; k < size; ++k) {
            if (k < affine[a]) {
                stacked[k] = sums[a][k];
                continue;
            }
            // Make the sums relative to the first vertex of the node, which is also the first vertex of its first half.
            const std::array<double, affine_count> &row = sums[b][k - affine[a]];
            for (int c = 0; c < affine_count; ++c) {
                const double away = c > 0 ? static_cast<double>(to[c - 1] - from[c - 1]) : 0.0;
                stacked[k][c] = row[c] + away * row[0];
            }
        }
        functions.begin(size, size);
        // The file stores this choice, so that decoders need no threshold here.
        functions.nearest = std::numeric_limits<double>::infinity();
        for (int c = 0; c < affine_count && !functions.is_complete(); ++c) {
            if (!chooses && !(masks[node] >> c & 1)) continue;
            // Subtract the mean over the node, because far from the origin x would hardly differ from a constant.
            double along = 0.0, square = 0.0;
            for (i64 k = 0; k < size; ++k) {
                along += stacked[k][c] * stacked[k][0];
                square += stacked[k][0] * stacked[k][0];
            }
            const double mean = c > 0 && square > 0.0 ? along / square : 0.0;
            for (i64 k = 0; k < size; ++k) functions.column()[k] = stacked[k][c] - mean * stacked[k][0];
            if (functions.add(chooses ? dependent : 0.0)) masks[node] = static_cast<u8>(masks[node] | 1 << c);
        }
        const i64 count = functions.count();
        affine[node] = count;
        for (i64 k = 0; k < count; ++k) {
            for (int c = 0; c < affine_count; ++c) {
                double total = 0.0;
                for (i64 i = 0; i < size; ++i) total += functions.function(k)[i] * stacked[i][c];
                sums[node][k][c] = total;
            }
        }
        functions.nearest = nearest;
        functions.add_unit_vectors(elements.shares[unit_vector]);
        functions.add_zeros();
        nearest = functions.nearest;
        Matrix &matrix = matrices_[--place];
        for (i64 k = 0; k < size; ++k) std::copy_n(functions.function(k), size, matrix[k].begin());
    }
}

template <class Real> void PartitionTree::analyse(std::span<double> affine, Real *coefficients, i64 channels,
                                                  const SpaceSelection *selection) const {
    i64 place = static_cast<i64>(matrices_.size());
    std::array<const double *, most_functions> rows;
    std::vector<double> of_wavelet(channels);
    const auto put = [&](const double *row, i64 function) {
        std::transform(row, row + channels, coefficients + function * channels,
                       [](double number) { return static_cast<Real>(number); });
    };
    for (i64 node = layout_->nodes(); node-- > 0;) {
        const i64 a = layout_->patches()->children[node], b = a + 1;
        if (a < 0) continue;
        const Matrix &matrix = matrices_[--place];
        const i64 own = layout_->affine_of_node(node), split = layout_->affine_of_node(a);
        const i64 size = split + layout_->affine_of_node(b), wavelet = layout_->first_wavelet(node);
        for (i64 i = 0; i < size; ++i) {
            const i64 row = i < split ? affine_count * a + i : affine_count * b + i - split;
            rows[i] = affine.data() + row * channels;
        }
        const auto add_up = [&](i64 k, double *row) {
            std::fill_n(row, channels, 0.0);
            add_multiples(row, channels, rows.data(), matrix[k].data(), size);
        };
        for (i64 k = 0; k < own; ++k) add_up(k, affine.data() + (affine_count * node + k) * channels);
        for (i64 k = own; k < size; ++k) {
            const i64 function = wavelet + k - own, row = selection ? selection->tree_rows[function] : function;
            if (row < 0) break;  // none of the node's wavelets is selected
            add_up(k, of_wavelet.data());
            put(of_wavelet.data(), row);
        }
    }
    for (i64 k = 0; k < layout_->affine_of_node(0); ++k) put(affine.data() + k * channels, k);
}

template void PartitionTree::analyse(std::span<double>, float *, i64, const SpaceSelection *) const;
template void PartitionTree::analyse(std::span<double>, double *, i64, const SpaceSelection *) const;

void PartitionTree::synthesise(const double *coefficients, std::span<double> affine, i64 channels) const {
    std::copy_n(coefficients, layout_->affine_of_node(0) * channels, affine.begin());
    i64 place = 0;
    std::array<const double *, most_functions> rows;
    std::array<double, most_functions> multiples;
    for (i64 node = 0; node < layout_->nodes(); ++node) {
        const i64 a = layout_->patches()->children[node], b = a + 1;
        if (a < 0) continue;
        const Matrix &matrix = matrices_[place++];
        const i64 own = layout_->affine_of_node(node), split = layout_->affine_of_node(a);
        const i64 size = split + layout_->affine_of_node(b), wavelet = layout_->first_wavelet(node);
        for (i64 k = 0; k < size; ++k) {
            rows[k] = k < own ? affine.data() + (affine_count * node + k) * channels
                              : coefficients + (wavelet + k - own) * channels;
        }
        for (i64 i = 0; i < size; ++i) {
            const i64 row = i < split ? affine_count * a + i : affine_count * b + i - split;
            for (i64 k = 0; k < size; ++k) multiples[k] = matrix[k][i];
            std::fill_n(affine.begin() + row * channels, channels, 0.0);
            add_multiples(affine.data() + row * channels, channels, rows.data(), multiples.data(), size);
        }
    }
}

}  // namespace pdeanim
