#include "sections/temporal/closed_form.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "sections/spatial/series.hpp"

namespace pdeanim {

namespace {

constexpr int order = ClosedForm::most_functions;

// Return the cubic Hermite functions at s in [0, 1], or a derivative: value and slope at the left end, then at the
// right.
std::array<double, 4> hermite(double s, int derivative) {
    if (derivative == 0) {
        const double back = 1.0 - s;
        return {(1.0 + 2.0 * s) * back * back, s * back * back, s * s * (3.0 - 2.0 * s), s * s * (s - 1.0)};
    }
    if (derivative == 1) {
        return {6.0 * s * (s - 1.0), (1.0 - s) * (1.0 - 3.0 * s), 6.0 * s * (1.0 - s), s * (3.0 * s - 2.0)};
    }
    return {12.0 * s - 6.0, 6.0 * s - 4.0, 6.0 - 12.0 * s, 6.0 * s - 2.0};
}

}  // namespace

ClosedForm::ClosedForm(std::span<const double> times, double alpha, i64 functions)
    : times_(times), alpha_(alpha), centre_((times.front() + times.back()) / 2.0),
      half_length_(times.size() > 1 ? (times.back() - times.front()) / 2.0 : 1.0),
      functions_(static_cast<int>(functions)) {
    // QR decomposition by Householder reflections. At distinct times the functions are independent (a Chebyshev
    // system).
    std::vector<Weights> rows;
    for (const double time : times) rows.push_back(series(time, 0));
    const int count = static_cast<int>(rows.size());
    for (int j = 0; j < functions_; ++j) {
        double norm = 0.0;
        for (int i = j; i < count; ++i) norm = std::hypot(norm, rows[i][j]);
        // If float64 can hardly resolve the times of the frames, only rounding errors are left, which must not be
        // amplified.
        triangle_[j][j] = std::max(norm, std::numeric_limits<double>::epsilon());
        if (norm == 0.0) continue;
        const double pivot = rows[j][j], sign = pivot < 0.0 ? -1.0 : 1.0;
        rows[j][j] = pivot + sign * norm;  // from here on, the column below row j is the reflection's vector
        const double half_square = norm * (norm + sign * pivot);
        for (int k = j + 1; k < functions_; ++k) {
            double product = 0.0;
            for (int i = j; i < count; ++i) product += rows[i][j] * rows[i][k];
            for (int i = j; i < count; ++i) rows[i][k] -= product / half_square * rows[i][j];
            triangle_[j][k] = -sign * rows[j][k];
        }
    }
}

ClosedForm::Weights ClosedForm::series(double time, int derivative) const {
    const double point = (time - centre_) / half_length_;
    const std::vector<double> found = series_functions(std::span<const double>(&point, 1), alpha_, order);
    Weights values;
    std::copy_n(found.begin(), order, values.begin());
    for (int d = 0; d < derivative; ++d) {
        // phi_j' = phi_(j-1), phi_0' = alpha^4 phi_3.
        const double last = alpha_ * alpha_ * (alpha_ * alpha_) * values[order - 1];
        for (int j = order - 1; j > 0; --j) values[j] = values[j - 1] / half_length_;
        values[0] = last / half_length_;
    }
    return values;
}

ClosedForm::Weights ClosedForm::weights(double time, int derivative) const {
    const Weights values = series(time, derivative);
    Weights found{};
    for (int j = 0; j < functions_; ++j) {
        double rest = values[j];
        for (int k = 0; k < j; ++k) rest -= found[k] * triangle_[k][j];
        found[j] = rest / triangle_[j][j];
    }
    return found;
}

std::vector<GroupWeights> closed_form_weights(std::span<const ClosedForm> groups, double time, int derivative) {
    const auto after = std::upper_bound(groups.begin(), groups.end(), time,
                                        [](double t, const ClosedForm &group) { return t < group.first(); });
    const std::size_t group = after == groups.begin() ? 0 : static_cast<std::size_t>(after - groups.begin()) - 1;
    const ClosedForm &left = groups[group];
    if (time <= left.last() || group + 1 == groups.size()) return {{group, left.weights(time, derivative)}};
    const ClosedForm &right = groups[group + 1];
    const double length = right.first() - left.last(), scale = std::pow(length, -derivative);
    const std::array<double, 4> shares = hermite((time - left.last()) / length, derivative);
    const ClosedForm::Weights left_value = left.weights(left.last()), left_slope = left.weights(left.last(), 1);
    const ClosedForm::Weights right_value = right.weights(right.first()), right_slope = right.weights(right.first(), 1);
    GroupWeights from_left{group, {}}, from_right{group + 1, {}};
    for (int j = 0; j < order; ++j) {
        from_left.weights[j] = scale * (shares[0] * left_value[j] + shares[1] * length * left_slope[j]);
        from_right.weights[j] = scale * (shares[2] * right_value[j] + shares[3] * length * right_slope[j]);
    }
    return {from_left, from_right};
}

}  // namespace pdeanim
