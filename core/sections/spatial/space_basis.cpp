#include "sections/spatial/space_basis.hpp"

#include <algorithm>
#include <type_traits>
#include <utility>

#include "base/parallel.hpp"
#include "linalg/products.hpp"

namespace pdeanim {

namespace {

// Return the sums of the affine functions of all elements. local: number of local coordinates of each element that
// moves; written if empty.
std::vector<AffineSums> describe(const Elements &elements, int threads, std::vector<u8> &local) {
    const bool chooses = local.empty();
    std::vector<AffineSums> sums(elements.count());
    if (!elements.form.is_affine) return sums;
    local.resize(elements.patches->moving);
    in_shares(elements.patches->moving, threads, [&](i64 first, i64 end) {
        ElementFunctions functions(elements);
        for (i64 e = first; e < end; ++e) {
            local[e] = static_cast<u8>(functions.describe(e, chooses ? -1 : local[e], sums[e]));
        }
    });
    return sums;
}

// Return the partition tree of a given layout or, without one, of a layout that is chosen.
PartitionTree tree_of(const Elements &elements, std::shared_ptr<const SpaceLayout> layout, int threads) {
    std::vector<u8> local = layout ? layout->local() : std::vector<u8>();
    const std::vector<AffineSums> sums = describe(elements, threads, local);
    return layout ? PartitionTree(elements, sums, std::move(layout)) : PartitionTree(elements, sums, std::move(local));
}

// Computes the products of values at an element's points with the element's functions, summed over the points.
template <class Real> class ElementSums {
public:
    ElementSums(const Real *values, i64 channels) : values_(values), channels_(channels) {}

    // Continue with an element that has these vertices and this many functions.
    void begin(std::span<const i32> vertices, const Strided<double> &functions, i64 count) {
        points_ = static_cast<i64>(vertices.size());
        rows_.resize(points_ * channels_);
        Real *to = rows_.data();
        for (const i32 vertex : vertices) to = std::copy_n(values_ + vertex * channels_, channels_, to);
        functions_ = {own_.of(functions.numbers, count * functions.row), functions.row, functions.column};
    }

    // Write the sums of functions `first` to `end` - 1.
    void add_up(i64 first, i64 end, Real *to) const {
        std::fill_n(to, (end - first) * channels_, Real{0});
        const Strided<Real> some{functions_.numbers + first * functions_.row, functions_.row, functions_.column};
        add_product(to, channels_, some, rows_.data(), channels_, {end - first, points_, channels_});
    }

private:
    const Real *values_;
    i64 channels_, points_ = 0;
    std::vector<Real> rows_;  // values at the points
    InPrecision<Real> own_;
    Strided<Real> functions_{};
};

}  // namespace

SpaceBasis::SpaceBasis(std::shared_ptr<const SpaceLayout> layout, std::span<const GridPoint> grid, int threads)
    : elements_(layout->form(), layout->patches(), grid), tree_(tree_of(elements_, layout, threads)),
      nearest_(tree_.nearest) {}

SpaceBasis::SpaceBasis(const SpaceForm &form, std::shared_ptr<const Patches> patches, std::span<const GridPoint> grid,
                       int threads)
    : elements_(form, std::move(patches), grid), tree_(tree_of(elements_, nullptr, threads)), nearest_(tree_.nearest) {}

void SpaceBasis::make_functions(int threads) {
    std::call_once(once_, [&] {
        const Patches &patches = *elements_.patches;
        made_starts_ = {0};
        for (i64 e = 0; e < elements_.count(); ++e) {
            made_starts_.push_back(made_starts_.back() + layout().rank(e) * patches.size(e));
        }
        made_.resize(made_starts_.back());
        std::mutex lock;
        in_shares(patches.moving, threads, [&](i64 first, i64 end) {
            ElementFunctions functions(elements_);
            for (i64 e = first; e < end; ++e) {
                functions.make(e, layout().affine(e), layout().rank(e));
                double *to = made_.data() + made_starts_[e];
                for (i64 k = 0; k < layout().rank(e); ++k) to = std::copy_n(functions.function(k), patches.size(e), to);
            }
            const std::lock_guard guard(lock);
            nearest_ = std::min(nearest_, functions.nearest());
        });
        is_made_ = true;
    });
}

std::span<const double> SpaceBasis::functions_of(i64 element) const {
    if (!is_made_) return {};
    return {made_.data() + made_starts_[element], made_.data() + made_starts_[element + 1]};
}

i64 SpaceBasis::bytes_to_keep() const {
    // Overhead per element: the vector object, and the allocator's bookkeeping.
    constexpr i64 bytes_per_element = sizeof(Kept) + sizeof(std::vector<double>) + 64;
    i64 numbers = 0;
    for (i64 e = 0; e < elements_.count(); ++e) numbers += layout().rank(e) * elements_.patches->size(e);
    return static_cast<i64>(sizeof(double)) * numbers + bytes_per_element * elements_.count();
}

SpaceBasis::FirstFunctions SpaceBasis::first_functions(i64 element, i64 count, ElementFunctions &making) const {
    const i64 size = elements_.patches->size(element);
    if (is_made_) return {{functions_of(element).data(), size, 1}, {}};
    const auto make = [&] { making.make(element, layout().affine(element), count); };
    if (kept_.empty()) {
        make();
        return {making.functions(), {}};
    }
    Kept &own = kept_[element];
    const std::lock_guard guard(own.lock);
    if (!own.values || own.count < count) {
        make();
        std::vector<double> values;
        values.reserve(count * size);
        for (i64 k = 0; k < count; ++k) {
            const double *function = making.function(k);
            values.insert(values.end(), function, function + size);
        }
        own.values = std::make_shared<const std::vector<double>>(std::move(values));
        own.count = count;
    }
    return {{own.values->data(), size, 1}, own.values};
}

template <class Real> LargeArray<Real> SpaceBasis::project(std::span<const Real> values, i64 channels,
                                                           const SpaceSelection *selection, int threads) const {
    const auto row_of = [&](i64 e) {
        return selection ? selection->element_rows[e] : layout().coefficient_starts()[e];
    };
    LargeArray<double> affine(affine_count * layout().nodes() * channels);
    LargeArray<Real> coefficients((selection ? selection->functions : functions()) * channels);
    in_shares(elements_.patches->moving, threads, [&](i64 first, i64 end) {
        ElementFunctions functions(elements_);
        ElementSums<Real> sums(values.data(), channels);
        std::vector<Real> of_affine(affine_count * channels);
        for (i64 e = first; e < end; ++e) {
            const i64 rank = layout().rank(e), own = least(layout().affine(e), rank), row = row_of(e);
            const i64 count = row >= 0 ? rank : own;
            sums.begin(elements_.patches->vertices(e), first_functions(e, count, functions).values, count);
            sums.add_up(0, own, of_affine.data());
            std::copy_n(of_affine.begin(), own * channels,
                        affine.begin() + affine_count * elements_.patches->node_of[e] * channels);
            if (row >= 0) sums.add_up(own, count, coefficients.data() + row * channels);
        }
    });
    tree_.analyse(affine, coefficients.data(), channels, selection);
    return coefficients;
}

template LargeArray<float> SpaceBasis::project(std::span<const float>, i64, const SpaceSelection *, int) const;
template LargeArray<double> SpaceBasis::project(std::span<const double>, i64, const SpaceSelection *, int) const;

}  // namespace pdeanim
