#include "sections/spatial/series.hpp"

#include <array>
#include <cmath>

namespace pdeanim {

namespace {

constexpr int term_count = 14;  // for |rate x| <= 12 and n = 4 the first omitted term, 12^60 / 60!, is below 7e-18

// (n k + j)! / (n (k - 1) + j)! for k = 1, 2, ...
template <int order> constexpr std::array<std::array<double, order>, term_count> quotients = [] {
    std::array<std::array<double, order>, term_count> found{};
    for (int k = 0; k < term_count; ++k) {
        for (int j = 0; j < order; ++j) {
            u64 product = 1;
            for (int factor = order * k + j + 1; factor <= order * (k + 1) + j; ++factor) product *= factor;
            found[k][j] = static_cast<double>(product);
        }
    }
    return found;
}();

// Squares instead of pow(): products are rounded the same way everywhere.
template <int order> double power(double x) {
    const double square = x * x, fourth = square * square;
    return order == 4 ? fourth : fourth * fourth;
}

template <int order> void add_series(std::span<const double> points, double rate, std::vector<double> &values) {
    for (const double x : points) {
        const double ratio = power<order>(x) * power<order>(rate);
        std::array<double, order> total;
        total.fill(1.0);
        // Horner's scheme from the smallest term. At rate 0 all terms but the first are 0.
        for (int k = rate != 0.0 ? term_count : 0; k-- > 0;) {
            for (int j = 0; j < order; ++j) total[j] = 1.0 + total[j] * (ratio / quotients<order>[k][j]);
        }
        double leading = 1.0;  // x^j / j!
        for (int j = 0; j < order; ++j) {
            values.push_back(total[j] * leading);
            leading = leading * x / (j + 1);
        }
    }
}

}  // namespace

std::vector<double> series_functions(std::span<const double> points, double rate, int order) {
    std::vector<double> values;
    values.reserve(points.size() * order);
    if (order == 4) {
        add_series<4>(points, rate, values);
    } else {
        add_series<8>(points, rate, values);
    }
    return values;
}

std::vector<double> arc_length_parameters(std::span<const GridPoint> grid, std::span<const i32> order,
                                          std::span<const i64> starts) {
    std::vector<double> found(order.size());
    double length = 0.0;  // length of all pieces so far
    const auto step = [&](i64 place) {
        double square = 0.0;
        for (int axis = 0; axis < 3; ++axis) {
            const double apart = static_cast<double>(grid[order[place]][axis] - grid[order[place - 1]][axis]);
            square += apart * apart;
        }
        return std::sqrt(square);
    };
    for (std::size_t piece = 0; piece + 1 < starts.size(); ++piece) {
        const i64 begin = starts[piece], end = starts[piece + 1];
        if (end - begin < 2) continue;
        bool is_still = true;
        for (i64 place = begin + 1; place < end && is_still; ++place) {
            is_still = grid[order[place]] == grid[order[place - 1]];
        }
        const double before = length;
        for (i64 place = begin; place < end; ++place) {
            if (place > begin) length += is_still ? 1.0 : step(place);
            found[place] = length;
        }
        const double extent = most(length - before, 1e-300);
        for (i64 place = begin; place < end; ++place) found[place] = 2.0 * ((found[place] - before) / extent) - 1.0;
    }
    return found;
}

}  // namespace pdeanim
