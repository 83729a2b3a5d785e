#include "basis/space_basis.hpp"

#include <algorithm>
#include <type_traits>
#include <utility>

#include "basis/series.hpp"
#include "linear_algebra/add_product.hpp"
#include "parallel.hpp"

namespace pdeanim {

namespace {

// Count the affine functions of all elements; their sums.
std::vector<AffineSums> describe(Elements &elements, int threads) {
    std::vector<AffineSums> sums(elements.count());
    in_shares(elements.count(), threads, [&](i64 first, i64 end) {
        ElementFunctions functions(elements);
        for (i64 e = first; e < end; ++e) elements.affine[e] = functions.describe(e, sums[e]);
    });
    return sums;
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

SpaceBasis::SpaceBasis(const SpaceForm &form, std::shared_ptr<const Patches> patches, std::span<const GridPoint> grid,
                       std::optional<std::span<const u8>> masks, int threads)
    : elements_(form, std::move(patches), grid), tree_(elements_, describe(elements_, threads), masks),
      nearest_(tree_.nearest) {
    // Unit vectors complete whatever polynomials leave open.
    const i64 most = form.is_affine ? form.functions : least(form.functions, space_functions);
    std::vector<i64> &starts = elements_.coefficient_starts;
    starts[0] = tree_.functions();
    for (i64 e = 0; e < elements_.count(); ++e) {
        starts[e + 1] = starts[e] + least(elements_.patches->size(e), most) - elements_.affine[e];
    }
}

SubbandTable SpaceBasis::subbands() const {
    const Patches &patches = *elements_.patches;
    std::vector<i64> depth(tree_.nodes()), above(tree_.nodes());
    SubbandTable found{{0}, {0}, {0}};
    for (i64 node = 0; node < tree_.nodes(); ++node) {
        const i64 first = patches.children[node];
        if (first < 0) continue;
        for (const i64 half : {first, first + 1}) {
            depth[half] = depth[node] + 1;
            above[half] = static_cast<i64>(found.kinds.size());
        }
        found.starts.push_back(tree_.first_wavelet(node));
        found.kinds.push_back(depth[node] + 1);
        found.parents.push_back(above[node]);
    }
    found.starts.insert(found.starts.end(), elements_.coefficient_starts.begin(), elements_.coefficient_starts.end());
    for (i64 e = 0; e < elements_.count(); ++e) {
        found.kinds.push_back(-1 - elements_.affine[e]);
        found.parents.push_back(above[patches.node_of[e]]);
    }
    return found;
}

void SpaceBasis::make_functions(int threads) {
    std::call_once(once_, [&] {
        const Patches &patches = *elements_.patches;
        made_starts_ = {0};
        for (i64 e = 0; e < elements_.count(); ++e) {
            made_starts_.push_back(made_starts_.back() + elements_.rank(e) * patches.size(e));
        }
        made_.resize(made_starts_.back());
        std::mutex lock;
        in_shares(elements_.count(), threads, [&](i64 first, i64 end) {
            ElementFunctions functions(elements_);
            for (i64 e = first; e < end; ++e) {
                functions.make(e, elements_.rank(e));
                double *to = made_.data() + made_starts_[e];
                for (i64 k = 0; k < elements_.rank(e); ++k)
                    to = std::copy_n(functions.function(k), patches.size(e), to);
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
    LargeArray<double> affine(affine_count * tree_.nodes() * channels), coefficients(functions() * channels);
    in_shares(elements_.count(), threads, [&](i64 first, i64 end) {
        RowsOfVertices rows(values.data(), channels);
        for (i64 e = first; e < end; ++e) {
            const Strided<double> made{functions_of(e).data(), elements_.patches->size(e), 1};
            project(e, made, elements_.rank(e), rows.of(elements_.patches->vertices(e)), channels, affine.data(),
                    coefficients.data() + elements_.coefficient_starts[e] * channels);
        }
    });
    tree_.analyse(affine, coefficients.data(), channels);
    return coefficients;
}

i64 SpaceBasis::functions_with(std::span<const i64> chosen) const {
    i64 count = tree_.functions();
    for (const i64 e : chosen) count += elements_.rank(e) - elements_.affine[e];
    return count;
}

std::vector<i64> SpaceBasis::places_with(std::span<const i64> chosen) const {
    std::vector<i64> places(elements_.count(), -1);
    i64 place = tree_.functions();
    for (const i64 e : chosen) {
        places[e] = place;
        place += elements_.rank(e) - elements_.affine[e];
    }
    return places;
}

template <class Real> LargeArray<double> SpaceBasis::project_some(std::span<const Real> values, i64 channels,
                                                                  std::span<const i64> chosen, int threads) const {
    const std::vector<i64> places = places_with(chosen);
    LargeArray<double> affine(affine_count * tree_.nodes() * channels), coefficients(functions_with(chosen) * channels);
    in_shares(elements_.count(), threads, [&](i64 first, i64 end) {
        ElementFunctions functions(elements_);
        RowsOfVertices rows(values.data(), channels);
        for (i64 e = first; e < end; ++e) {
            const bool is_chosen = places[e] >= 0;
            const i64 count = is_chosen ? elements_.rank(e) : elements_.affine[e];
            Strided<double> made{functions_of(e).data(), elements_.patches->size(e), 1};
            if (!is_made_) {
                functions.make(e, count);
                made = functions.functions();
            }
            project(e, made, count, rows.of(elements_.patches->vertices(e)), channels, affine.data(),
                    is_chosen ? coefficients.data() + places[e] * channels : nullptr);
        }
    });
    tree_.analyse(affine, coefficients.data(), channels);
    return coefficients;
}

template LargeArray<double> SpaceBasis::project_some(std::span<const float>, i64, std::span<const i64>, int) const;
template LargeArray<double> SpaceBasis::project_some(std::span<const double>, i64, std::span<const i64>, int) const;

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
    const i64 own = least(elements_.affine[element], count);
    add_up(0, own, affine + affine_count * patches.node_of[element] * channels);
    if (others) add_up(own, count, others);
}

}  // namespace pdeanim
