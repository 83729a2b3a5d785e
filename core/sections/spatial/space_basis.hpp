// Space bases: orthonormal functions of the reference frame on elements, joined upwards over the whole mesh.
//
// The file gives the number and kind of the functions (`SpaceLayout`). The values of the functions are floating-point
// numbers, and a decoder may compute them in any way: see `SpaceForm::threshold`.
//
// This folder makes the functions of space (9, 10 and 11 of the specification). Begin here; then space_layout counts
// the functions, elements makes those of patches and pieces of curves (series: Eqs. 14 and 16), and partition_tree
// joins them.
#pragma once

#include <atomic>
#include <memory>
#include <mutex>
#include <span>
#include <vector>

#include "base/arrays.hpp"
#include "linalg/products.hpp"
#include "sections/spatial/elements.hpp"
#include "sections/spatial/partition_tree.hpp"

namespace pdeanim {

class SpaceBasis {
public:
    // grid: grid coordinates of the reference frame, which must outlive the basis.
    SpaceBasis(std::shared_ptr<const SpaceLayout> layout, std::span<const GridPoint> grid, int threads);

    // Build the basis and choose its layout.
    SpaceBasis(const SpaceForm &form, std::shared_ptr<const Patches> patches, std::span<const GridPoint> grid,
               int threads);

    const Elements &elements() const { return elements_; }
    const PartitionTree &tree() const { return tree_; }
    i64 vertices() const { return static_cast<i64>(elements_.grid.size()); }
    i64 functions() const { return layout().functions(); }
    const SpaceLayout &layout() const { return *tree_.layout(); }

    // Make all functions of all elements, for an encoder. A decoder makes functions only on request.
    void make_functions(int threads);

    // Return an element's functions from `make_functions`, one after the other; empty before that call.
    std::span<const double> functions_of(i64 element) const;

    // From now on, keep functions that are made on demand: other groups of frames need them again.
    void keep_functions() { kept_ = std::vector<Kept>(elements_.count()); }

    // Return an upper bound on the memory of all functions if they are kept [bytes].
    i64 bytes_to_keep() const;

    // The first functions of an element, one per row; valid until `making` makes others, or `kept` is destroyed.
    struct FirstFunctions {
        Strided<double> values;
        std::shared_ptr<const std::vector<double>> kept;  // owner of the values, if they are kept
    };
    FirstFunctions first_functions(i64 element, i64 count, ElementFunctions &making) const;

    // Return the smallest relative distance of a new fraction from its threshold, including the functions of elements
    // once they are made. It tells whether every decoder drops the same columns, however it rounds.
    double nearest() const { return nearest_; }

    // Return the coefficients of values at vertices. Both have one row of `channels` numbers per vertex or function,
    // float or double. With a selection, return only the coefficients of its functions. Functions that do not exist yet
    // are made.
    template <class Real> LargeArray<Real> project(std::span<const Real> values, i64 channels,
                                                   const SpaceSelection *selection, int threads) const;

private:
    // The functions of an element, as many as have been requested so far.
    struct Kept {
        std::mutex lock;
        i64 count = 0;
        std::shared_ptr<const std::vector<double>> values;
    };

    Elements elements_;
    PartitionTree tree_;
    mutable std::vector<Kept> kept_;  // empty unless `keep_functions` was called
    std::once_flag once_;
    std::atomic<bool> is_made_ = false;
    LargeArray<double> made_;
    std::vector<i64> made_starts_;
    double nearest_;
};

}  // namespace pdeanim
