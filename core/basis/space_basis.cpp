#include "basis/space_basis.hpp"

#include <algorithm>
#include <utility>

#include "basis/add_multiples.hpp"
#include "basis/series.hpp"
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

std::vector<double> SpaceBasis::project(std::span<const double> values, i64 channels, int threads) const {
    std::vector<double> affine(affine_count * tree_.nodes() * channels), coefficients(functions() * channels);
    in_shares(elements_.count(), threads, [&](i64 first, i64 end) {
        project(first, end, values.data(), channels, affine.data(), coefficients.data());
    });
    tree_.analyse(affine, coefficients.data(), channels);
    return coefficients;
}

void SpaceBasis::project(i64 first, i64 end, const double *values, i64 channels, double *affine,
                         double *coefficients) const {
    const Patches &patches = *elements_.patches;
    std::vector<const double *> rows;
    for (i64 e = first; e < end; ++e) {
        rows.clear();
        for (const i32 vertex : patches.vertices(e)) rows.push_back(values + vertex * channels);
        const double *function = functions_of(e).data();
        for (i64 k = 0; k < elements_.rank(e); ++k, function += rows.size()) {
            double *row = k < elements_.affine[e] ? affine + (affine_count * patches.node_of[e] + k) * channels
                                                  : coefficients + (elements_.first_function(e) + k) * channels;
            add_multiples(row, channels, rows.data(), function, static_cast<i64>(rows.size()));
        }
    }
}

template <class Write> void Expansion::expand_element(i64 e, Work &work, const Write &write) const {
    const Elements &elements = basis_.elements();
    const Patches &patches = *elements.patches;
    auto &[functions, coefficients, rows, chosen, multiples, sums] = work;
    const i64 affine = elements.affine[e], size = patches.size(e);
    coefficients.clear();
    for (i64 k = 0; k < elements.rank(e); ++k) {
        coefficients.push_back(k < affine ? affine_.data() + (affine_count * patches.node_of[e] + k) * channels_
                                          : coefficients_ + (elements.first_function(e) + k) * channels_);
    }
    const auto is_zero = [&](const double *row) {
        return std::all_of(row, row + channels_, [](double value) { return value == 0.0; });
    };
    while (static_cast<i64>(coefficients.size()) > affine && is_zero(coefficients.back())) coefficients.pop_back();
    const i64 rank = static_cast<i64>(coefficients.size());
    const std::span<const double> made = basis_.functions_of(e);
    // An element's functions are made as far as there are coefficients for them: mostly a fraction.
    if (made.empty()) functions.make(e, rank);
    rows.clear();
    for (i64 k = 0; k < rank; ++k) rows.push_back(made.empty() ? functions.function(k) : made.data() + k * size);
    for (i64 a = 0; a < channels_; ++a) {
        chosen.clear();
        multiples.clear();
        for (i64 k = 0; k < rank; ++k) {
            if (coefficients[k][a] == 0.0) continue;
            chosen.push_back(rows[k]);
            multiples.push_back(coefficients[k][a]);
        }
        sums.assign(size, 0.0);
        add_multiples(sums.data(), size, chosen.data(), multiples.data(), static_cast<i64>(chosen.size()));
        write(a, sums);
    }
}

template <class Real> void Expansion::expand(i64 first, i64 end, Real *fields) const {
    const Patches &patches = *basis_.elements().patches;
    Work work(basis_.elements());
    for (i64 e = first; e < end; ++e) {
        const i32 *vertex = patches.vertices(e).data();
        expand_element(e, work, [&](i64 a, const std::vector<double> &sums) {
            Real *field = fields + a * basis_.vertices();
            for (std::size_t i = 0; i < sums.size(); ++i) field[vertex[i]] = static_cast<Real>(sums[i]);
        });
    }
}

template <class Real> void Expansion::expand_some(std::span<const i64> elements, i64 width, Real *fields) const {
    Work work(basis_.elements());
    for (const i64 e : elements) {
        expand_element(e, work, [&](i64 a, const std::vector<double> &sums) {
            Real *field = fields + a * width;
            for (std::size_t i = 0; i < sums.size(); ++i) field[i] = static_cast<Real>(sums[i]);
        });
        fields += basis_.elements().patches->size(e);
    }
}

template void Expansion::expand(i64, i64, float *) const;
template void Expansion::expand(i64, i64, double *) const;
template void Expansion::expand_some(std::span<const i64>, i64, float *) const;
template void Expansion::expand_some(std::span<const i64>, i64, double *) const;

}  // namespace pdeanim
