// Space bases: orthonormal functions of the reference frame on elements, joined upwards over the whole mesh.
//
// How many functions there are, and of what kind, is in the file (`SpaceLayout`). The values of the functions are
// floating-point numbers, and may be computed in any way: see `SpaceForm::threshold`.
//
// This folder makes the functions of space (9, 10 and 11 of the specification). Begin here; then space_layout counts the
// functions, elements makes those of patches and pieces of curves (series: Eqs. 14 and 16), and partition_tree joins them.
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
    // `grid`: of the reference frame, kept by the caller.
    SpaceBasis(std::shared_ptr<const SpaceLayout> layout, std::span<const GridPoint> grid, int threads);

    // The same, and choose the layout.
    SpaceBasis(const SpaceForm &form, std::shared_ptr<const Patches> patches, std::span<const GridPoint> grid,
               int threads);

    const Elements &elements() const { return elements_; }
    const PartitionTree &tree() const { return tree_; }
    i64 vertices() const { return static_cast<i64>(elements_.grid.size()); }
    i64 functions() const { return layout().functions(); }
    const SpaceLayout &layout() const { return *tree_.layout(); }

    // Make all functions of all elements, which an encoder needs; a decoder makes those that it needs on the way.
    void make_functions(int threads);

    // Of these, the ones of an element, function after function; nothing as long as they are not made.
    std::span<const double> functions_of(i64 element) const;

    // From now on keep those that are made on the way: other groups of frames need them again.
    void keep_functions() { kept_ = std::vector<Kept>(elements_.count()); }

    // What it takes at most to keep them [bytes].
    i64 bytes_to_keep() const;

    // The first functions of an element, a row each; they stay until `making` makes others or `kept` is gone.
    struct FirstFunctions {
        Strided<double> values;
        std::shared_ptr<const std::vector<double>> kept;  // where they lie, if they are kept
    };
    FirstFunctions first_functions(i64 element, i64 count, ElementFunctions &making) const;

    // The least relative distance of a share from its threshold: whether every decoder drops the same columns, however it
    // rounds. Of the elements' functions, too, once they are made.
    double nearest() const { return nearest_; }

    // Coefficients of values on vertices, both with a row of `channels` each, float or double; of a selection of functions
    // alone where there is one. Functions are made on the way unless they are there.
    template <class Real> LargeArray<Real> project(std::span<const Real> values, i64 channels,
                                                   const SpaceSelection *selection, int threads) const;

private:
    // Of an element as many functions as anybody has needed.
    struct Kept {
        std::mutex lock;
        i64 count = 0;
        std::shared_ptr<const std::vector<double>> values;
    };

    Elements elements_;
    PartitionTree tree_;
    mutable std::vector<Kept> kept_;  // empty unless they are kept
    std::once_flag once_;
    std::atomic<bool> is_made_ = false;
    LargeArray<double> made_;
    std::vector<i64> made_starts_;
    double nearest_;
};

}  // namespace pdeanim
