#include "basis/space_basis.hpp"

#include <algorithm>
#include <type_traits>
#include <utility>

#include "linear_algebra/add_product.hpp"
#include "parallel.hpp"

namespace pdeanim {

namespace {

// Sums of the affine functions of all elements. `local`: how many local coordinates each takes, or where these numbers
// are written.
std::vector<AffineSums> describe(const Elements &elements, int threads, std::vector<u8> &local) {
    const bool chooses = local.empty();
    std::vector<AffineSums> sums(elements.count());
    if (!elements.form.is_affine) return sums;
    local.resize(sums.size());
    in_shares(elements.count(), threads, [&](i64 first, i64 end) {
        ElementFunctions functions(elements);
        for (i64 e = first; e < end; ++e) {
            local[e] = static_cast<u8>(functions.describe(e, chooses ? -1 : local[e], sums[e]));
        }
    });
    return sums;
}

// A partition tree whose layout is given, or chosen.
PartitionTree tree_of(const Elements &elements, std::shared_ptr<const SpaceLayout> layout, int threads) {
    std::vector<u8> local = layout ? layout->local() : std::vector<u8>();
    const std::vector<AffineSums> sums = describe(elements, threads, local);
    return layout ? PartitionTree(elements, sums, std::move(layout)) : PartitionTree(elements, sums, std::move(local));
}

// Rows of values on vertices, those of one element after another.
template <class Real> class RowsOfVertices {
public:
    RowsOfVertices(const Real *values, i64 channels) : values_(values), channels_(channels) {}

    // Of vertices, one row after the other; valid until others are asked for.
    const double *of(std::span<const i32> vertices) {
        rows_.resize(vertices.size() * channels_);
        double *to = rows_.data();
        for (const i32 vertex : vertices) to = std::copy_n(values_ + vertex * channels_, channels_, to);
        return rows_.data();
    }

private:
    const Real *values_;
    i64 channels_;
    std::vector<double> rows_;
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
        in_shares(elements_.count(), threads, [&](i64 first, i64 end) {
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

LargeArray<double> SpaceBasis::project(std::span<const double> values, i64 channels, int threads) const {
    LargeArray<double> affine(affine_count * layout().nodes() * channels), coefficients(functions() * channels);
    in_shares(elements_.count(), threads, [&](i64 first, i64 end) {
        RowsOfVertices rows(values.data(), channels);
        for (i64 e = first; e < end; ++e) {
            const Strided<double> made{functions_of(e).data(), elements_.patches->size(e), 1};
            project(e, made, layout().rank(e), rows.of(elements_.patches->vertices(e)), channels, affine.data(),
                    coefficients.data() + layout().coefficient_starts()[e] * channels);
        }
    });
    tree_.analyse(affine, coefficients.data(), channels);
    return coefficients;
}

template <class Real> LargeArray<double> SpaceBasis::project_some(std::span<const Real> values, i64 channels,
                                                                  const SpaceSelection &selection, int threads) const {
    LargeArray<double> affine(affine_count * layout().nodes() * channels), coefficients(selection.functions * channels);
    in_shares(elements_.count(), threads, [&](i64 first, i64 end) {
        ElementFunctions functions(elements_);
        RowsOfVertices rows(values.data(), channels);
        for (i64 e = first; e < end; ++e) {
            const bool is_chosen = selection.has_element(e);
            const i64 count = is_chosen ? layout().rank(e) : layout().affine(e);
            Strided<double> made{functions_of(e).data(), elements_.patches->size(e), 1};
            if (!is_made_) {
                functions.make(e, layout().affine(e), count);
                made = functions.functions();
            }
            project(e, made, count, rows.of(elements_.patches->vertices(e)), channels, affine.data(),
                    is_chosen ? coefficients.data() + selection.element_rows[e] * channels : nullptr);
        }
    });
    tree_.analyse(affine, coefficients.data(), channels, &selection);
    return coefficients;
}

template LargeArray<double> SpaceBasis::project_some(std::span<const float>, i64, const SpaceSelection &, int) const;
template LargeArray<double> SpaceBasis::project_some(std::span<const double>, i64, const SpaceSelection &, int) const;

// `functions`: so many of the element. `rows`: of its points. `others`: where the coefficients of its functions that are
// not affine go.
void SpaceBasis::project(i64 element, const Strided<double> &functions, i64 count, const double *rows, i64 channels,
                         double *affine, double *others) const {
    const Patches &patches = *elements_.patches;
    const auto add_up = [&](i64 first, i64 end, double *to) {
        std::fill_n(to, (end - first) * channels, 0.0);
        const Strided<double> some{functions.numbers + first * functions.row, functions.row, functions.column};
        add_product(to, channels, some, rows, channels, {end - first, patches.size(element), channels});
    };
    const i64 own = least(layout().affine(element), count);
    add_up(0, own, affine + affine_count * patches.node_of[element] * channels);
    if (others) add_up(own, count, others);
}

}  // namespace pdeanim
