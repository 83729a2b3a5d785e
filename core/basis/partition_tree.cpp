#include "basis/partition_tree.hpp"

#include <algorithm>

#include "entropy/range_coder.hpp"
#include "errors.hpp"
#include "linear_algebra/add_multiples.hpp"

namespace pdeanim {

namespace {

// An encoder leaves out an axis where no more than this share of its squared norm is new.
constexpr double dependent = 0x1p-16;

// Code which of 1, x, y and z the nodes keep, upwards. `affine`: how many affine functions each node has, those of elements
// given.
template <Mode mode> void code_masks(RangeCoder<mode> &coder, const std::vector<i64> &children,
                                     std::vector<i64> &affine, std::vector<u8> &masks) {
    std::array<std::array<BitModel, affine_count>, 3> models;  // by how many halves have all four functions, and axis
    for (i64 node = static_cast<i64>(children.size()); node-- > 0;) {
        const i64 half = children[node];
        if (half < 0) continue;
        const i64 size = affine[half] + affine[half + 1];
        const int full = (affine[half] == affine_count) + (affine[half + 1] == affine_count);
        // The constant is always kept.
        u8 mask = size > 0;
        i64 count = mask;
        for (int c = 1; c < affine_count; ++c) {
            if (count < size && coder.bit(models[full][c], masks[node] >> c & 1)) {
                mask = static_cast<u8>(mask | 1 << c);
                ++count;
            }
        }
        masks[node] = mask;
        affine[node] = count;
    }
}

}  // namespace

PartitionTree::PartitionTree(const Elements &elements, const std::vector<AffineSums> &sums,
                             std::optional<std::span<const u8>> masks)
    : patches_(elements.patches), affine_(patches_->children.size()), masks_(affine_.size()),
      wavelet_starts_(affine_.size()) {
    const std::vector<i64> &children = patches_->children;
    for (i64 element = 0; element < elements.count(); ++element) {
        affine_[patches_->node_of[element]] = elements.affine[element];
    }
    if (masks) {
        RangeCoder<Mode::decode> coder(*masks);
        code_masks(coder, children, affine_, masks_);
        if (!coder.is_finished()) {
            throw CorruptError("section MODL does not end where its partition tree does; get the file again");
        }
    }
    build_matrices(elements, sums, !masks);
    functions_ = affine_[0];
    for (i64 node = 0; node < nodes(); ++node) {
        wavelet_starts_[node] = functions_;
        const i64 half = children[node];
        if (half >= 0) functions_ += affine_[half] + affine_[half + 1] - affine_[node];
    }
}

std::vector<u8> PartitionTree::encode_masks() const {
    RangeCoder<Mode::encode> coder;
    std::vector<i64> affine = affine_;  // coding leaves the numbers as they are
    std::vector<u8> masks = masks_;
    code_masks(coder, patches_->children, affine, masks);
    return coder.finish();
}

void PartitionTree::build_matrices(const Elements &elements, const std::vector<AffineSums> &of_elements, bool chooses) {
    const std::vector<i64> &children = patches_->children;
    std::vector<AffineSums> sums(nodes());
    for (i64 element = 0; element < elements.count(); ++element) {
        sums[patches_->node_of[element]] = of_elements[element];
    }
    const auto origin = [&](i64 node) { return elements.grid[patches_->order[patches_->begins[node]]]; };
    i64 place = std::count_if(children.begin(), children.end(), [](i64 half) { return half >= 0; });
    matrices_.resize(place);
    OrthonormalFunctions functions;
    for (i64 node = nodes(); node-- > 0;) {
        const i64 a = children[node], b = a + 1;
        if (a < 0) continue;
        const i64 size = affine_[a] + affine_[b];
        std::array<std::array<double, affine_count>, most_functions> stacked;
        const GridPoint from = origin(a), to = origin(b);
        for (i64 k = 0; k < size; ++k) {
            if (k < affine_[a]) {
                stacked[k] = sums[a][k];
                continue;
            }
            // About the first vertex of the node, which is that of its first half.
            const std::array<double, affine_count> &row = sums[b][k - affine_[a]];
            for (int c = 0; c < affine_count; ++c) {
                const double away = c > 0 ? static_cast<double>(to[c - 1] - from[c - 1]) : 0.0;
                stacked[k][c] = row[c] + away * row[0];
            }
        }
        functions.begin(size, size);
        functions.nearest = std::numeric_limits<double>::infinity();  // what is chosen here is in the file
        for (int c = 0; c < affine_count && !functions.is_complete(); ++c) {
            if (!chooses && !(masks_[node] >> c & 1)) continue;
            // About the node's mean: seen from afar, x would hardly differ from a constant.
            double along = 0.0, square = 0.0;
            for (i64 k = 0; k < size; ++k) {
                along += stacked[k][c] * stacked[k][0];
                square += stacked[k][0] * stacked[k][0];
            }
            const double mean = c > 0 && square > 0.0 ? along / square : 0.0;
            for (i64 k = 0; k < size; ++k) functions.column()[k] = stacked[k][c] - mean * stacked[k][0];
            if (functions.add(chooses ? dependent : 0.0)) masks_[node] = static_cast<u8>(masks_[node] | 1 << c);
        }
        const i64 count = functions.count();
        affine_[node] = count;
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

void PartitionTree::analyse(std::span<double> affine, double *coefficients, i64 channels) const {
    i64 place = static_cast<i64>(matrices_.size());
    std::array<const double *, most_functions> rows;
    for (i64 node = nodes(); node-- > 0;) {
        const i64 a = patches_->children[node], b = a + 1;
        if (a < 0) continue;
        const Matrix &matrix = matrices_[--place];
        const i64 size = affine_[a] + affine_[b];
        for (i64 i = 0; i < size; ++i) {
            const i64 row = i < affine_[a] ? affine_count * a + i : affine_count * b + i - affine_[a];
            rows[i] = affine.data() + row * channels;
        }
        for (i64 k = 0; k < size; ++k) {
            double *row = k < affine_[node] ? affine.data() + (affine_count * node + k) * channels
                                            : coefficients + (wavelet_starts_[node] + k - affine_[node]) * channels;
            std::fill_n(row, channels, 0.0);
            add_multiples(row, channels, rows.data(), matrix[k].data(), size);
        }
    }
    std::copy_n(affine.begin(), affine_[0] * channels, coefficients);
}

void PartitionTree::synthesise(const double *coefficients, std::span<double> affine, i64 channels) const {
    std::copy_n(coefficients, affine_[0] * channels, affine.begin());
    i64 place = 0;
    std::array<const double *, most_functions> rows;
    std::array<double, most_functions> multiples;
    for (i64 node = 0; node < nodes(); ++node) {
        const i64 a = patches_->children[node], b = a + 1;
        if (a < 0) continue;
        const Matrix &matrix = matrices_[place++];
        const i64 size = affine_[a] + affine_[b];
        for (i64 k = 0; k < size; ++k) {
            rows[k] = k < affine_[node] ? affine.data() + (affine_count * node + k) * channels
                                        : coefficients + (wavelet_starts_[node] + k - affine_[node]) * channels;
        }
        for (i64 i = 0; i < size; ++i) {
            const i64 row = i < affine_[a] ? affine_count * a + i : affine_count * b + i - affine_[a];
            for (i64 k = 0; k < size; ++k) multiples[k] = matrix[k][i];
            std::fill_n(affine.begin() + row * channels, channels, 0.0);
            add_multiples(affine.data() + row * channels, channels, rows.data(), multiples.data(), size);
        }
    }
}

}  // namespace pdeanim
