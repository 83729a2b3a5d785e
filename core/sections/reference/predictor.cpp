#include "sections/reference/reference.hpp"

#include <algorithm>
#include <cmath>

#include "linalg/products.hpp"

namespace pdeanim {

namespace {

constexpr int reciprocal_bits = 15;
constexpr int normal_bits = 12;  // digits of the largest component of a parallelogram's normal; a sum has 4 more
constexpr int edge_bits = 20;    // digits of the largest component of an edge, before cross products
constexpr i64 largest_miss = i64{1} << 30;    // [1/16]; keeps sums of misses far from overflow
constexpr int weight_bits = 5;                // fraction bits of the weights of terms
constexpr i64 largest_turned = i64{1} << 32;  // limit on a component of a term that is projected on the normal [1/512]

// Return 1 / n in 1/32768, rounded. n is at most twice the number of corners used.
constexpr i64 reciprocal(i64 count) { return count ? ((i64{1} << (reciprocal_bits + 1)) + count) / (2 * count) : 0; }

}  // namespace

// Add the normal of the triangle a, b, d, scaled to normal_bits digits.
void Predictor::add_normal(i32 a, i32 b, i32 d, Vector &normal) const {
    i64 largest = 0;
    for (int k = 0; k < 3; ++k) {
        largest = most(largest, most(size_of(grid[b][k] - grid[a][k]), size_of(grid[a][k] - grid[d][k])));
    }
    const int shift = most(bit_length(largest) - edge_bits, 0);
    Vector u, w;
    for (int k = 0; k < 3; ++k) {
        u[k] = (grid[b][k] - grid[a][k]) >> shift;
        w[k] = (grid[a][k] - grid[d][k]) >> shift;
    }
    const Vector cross = {u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0]};
    const i64 greatest = most(size_of(cross[0]), most(size_of(cross[1]), size_of(cross[2])));
    const int digits = bit_length(greatest) - normal_bits;
    for (int k = 0; k < 3; ++k) normal[k] += digits >= 0 ? cross[k] >> digits : cross[k] * (i64{1} << -digits);
}

Around Predictor::look_around(i32 vertex) const {
    Around found;
    int creases = 0, straights = 0, neighbour_count = 0;
    i32 reference = -1;
    Vector first{};
    const i64 begin = corners_.fan_starts[vertex];
    const i64 end = least(corners_.fan_starts[vertex + 1], begin + most_corners);
    const auto known = [&](i32 v) { return v >= 0 && is_known_[v]; };
    for (i64 row = begin; row < end; ++row) {
        const i32 corner = corners_.fan[row];
        if (!known(corners_.vertex(corners_.next[corner])) && !known(corners_.vertex(corners_.previous[corner])))
            continue;
        const Neighbourhood own = neighbourhood_at(corners_, corner);
        const i32 a = own.after, b = own.before, d = own.opposite;
        const bool a_known = known(a), b_known = known(b);
        if (reference < 0) reference = a_known ? a : b;
        const bool over_a_known = known(own.straight_after), over_b_known = known(own.straight_before);
        const Vector &from = grid[reference];
        if (a_known && b_known && known(d)) {
            ++found.parallelograms;
            add_normal(a, b, d, found.normal);
            for (int k = 0; k < 3; ++k) {
                const i64 fourth = grid[a][k] + grid[b][k] - grid[d][k];
                found.base[k] += fourth - from[k];
                if (found.parallelograms == 1) {
                    first[k] = fourth;
                } else {
                    found.spread += size_of(fourth - first[k]);
                }
            }
            if (own.is_triangle) {
                for (const bool is_after : {true, false}) {
                    if (!(is_after ? over_a_known : over_b_known)) continue;
                    ++creases;
                    const i32 over = is_after ? own.straight_after : own.straight_before;
                    const i32 beside = is_after ? b : a, crossed = is_after ? a : b;
                    for (int k = 0; k < 3; ++k) {
                        found.terms[crease][k] += grid[over][k] + grid[beside][k] - grid[crossed][k] - grid[d][k];
                    }
                }
            }
        }
        for (const bool is_after : {true, false}) {
            const i32 beside = is_after ? a : b;
            if (!(is_after ? a_known : b_known)) continue;
            if (is_after || own.before_counts) {
                ++neighbour_count;
                for (int k = 0; k < 3; ++k) {
                    found.terms[neighbours][k] += grid[beside][k] - from[k];
                    found.terms[miss][k] += points_[beside].miss[k];
                    found.errors[k] += points_[beside].error[k];
                }
            }
            if (is_after ? over_a_known : over_b_known) {
                ++straights;
                const i32 over = is_after ? own.straight_after : own.straight_before;
                for (int k = 0; k < 3; ++k) {
                    found.terms[straight][k] += 2 * grid[beside][k] - grid[over][k] - from[k];
                }
            }
        }
    }
    if (neighbour_count == 0) {
        found = Around();
        if (last_ >= 0) {
            for (int k = 0; k < 3; ++k) {
                found.base[k] = grid[last_][k] << fraction_bits;
                // A vertex without known neighbours is predicted by the previous vertex of that kind; before the second
                // one, by the last vertex.
                found.terms[neighbours][k] = (grid[last_seed_][k] - grid[last_][k]) * (1 << fraction_bits);
            }
        }
        found.errors = seed_errors_;
        return found;
    }
    // A mean in 1/16: the sum times 2^15 / n, shifted by 11 bits.
    constexpr int shift = reciprocal_bits - fraction_bits;
    constexpr i64 half = i64{1} << (shift - 1);
    const auto mean = [&](i64 sum, i64 count) { return (sum * reciprocal(count) + half) >> shift; };
    for (int k = 0; k < 3; ++k) {
        const i64 on = mean(found.terms[straight][k], straights),
                  beside = mean(found.terms[neighbours][k], neighbour_count);
        i64 base = mean(found.base[k], found.parallelograms);
        if (!found.parallelograms) base = straights ? on : beside;
        found.terms[crease][k] = mean(found.terms[crease][k], creases);
        found.terms[straight][k] = straights ? on - base : 0;
        found.terms[miss][k] = (found.terms[miss][k] * reciprocal(neighbour_count)) >> reciprocal_bits;
        found.terms[neighbours][k] = beside - base;
        found.errors[k] = (found.errors[k] * reciprocal(neighbour_count)) >> shift;
        found.base[k] = base + (grid[reference][k] << fraction_bits);
    }
    if (found.parallelograms) {
        found.kind = first_of_parallelograms + 2 * (least(found.parallelograms, 3) - 1) + (straights ? 1 : 0);
    } else {
        found.kind = straights ? 2 : 1;
    }
    return found;
}

Vector Around::predicted(const std::array<std::array<i32, term_count>, 2> &weights) const {
    i64 length = 0, dot = 0;
    Vector across{};
    for (int k = 0; k < 3; ++k) {
        i64 along = 0;
        for (int term = 0; term < term_count; ++term) {
            across[k] += weights[0][term] * terms[term][k];
            along += weights[1][term] * terms[term][k];
        }
        length += normal[k] * normal[k];
        dot += normal[k] * clamp(along, -largest_turned, largest_turned);
    }
    const i64 portion = length && dot ? floor_divide(dot * (i64{1} << normal_bits), length) : 0;
    Vector found;
    for (int k = 0; k < 3; ++k) {
        const i64 total = across[k] + ((portion * normal[k]) >> normal_bits);
        found[k] = base[k] + ((total + (1 << (weight_bits - 1))) >> weight_bits);
    }
    return found;
}

void Predictor::learn(i32 vertex, const Around &around, const Vector &residual) {
    Point &point = points_[vertex];
    for (int k = 0; k < 3; ++k) {
        point.miss[k] = clamp((grid[vertex][k] << fraction_bits) - around.base[k], -largest_miss, largest_miss);
        point.error[k] = residual[k];
        if (around.kind == 0) seed_errors_[k] = (3 * seed_errors_[k] + (residual[k] << fraction_bits)) >> 2;
    }
    is_known_[vertex] = 1;
    last_ = vertex;
    if (around.kind == 0) last_seed_ = vertex;
}

namespace {

constexpr std::size_t least_vertices = 8;    // kinds with fewer vertices get no weights: not worth their cost
constexpr std::size_t most_vertices = 2048;  // largest sample of a kind, evenly spread
constexpr int rounds = 5;            // rounds of reweighted least squares; more change the size by less than 0.1 %
constexpr double weight_cost = 9.0;  // bits per weight
constexpr double half_step = 1 << (fraction_bits - 1);  // smaller residuals are rounded to zero
constexpr double largest_weight = 127.0, weight_unit = 32.0;
constexpr double ridge = 1e-6;      // relative; added to the diagonal so that nearly equal columns can be told apart
constexpr double dependent = 1e-9;  // relative; a smaller pivot is only rounding error, and its column is left out
constexpr int most_columns = 2 * term_count;

struct Row {
    std::array<double, most_columns> columns;
    double target;
};

using Solution = std::array<double, most_columns>;

double target_left(const Row &row, const Solution &solution, int width) {
    double left = row.target;
    for (int j = 0; j < width; ++j) left -= row.columns[j] * solution[j];
    return left;
}

// Fit weights by iteratively reweighted least squares, with a fixed order of operations. Minimises the sum of the
// residuals' absolute values, or of log(absolute value + half_step); values below half_step count as half_step.
Solution fit_robustly(const std::vector<Row> &rows, int width, bool is_logarithmic) {
    Solution solution{};
    for (int round = 0; round < rounds; ++round) {
        double matrix[most_columns][most_columns] = {}, right[most_columns] = {};
        for (const Row &row : rows) {
            const double size = std::fabs(target_left(row, solution, width));
            double importance = 1.0 / most(size, half_step);
            if (is_logarithmic) importance /= size + half_step;
            for (int j = 0; j < width; ++j) {
                const double weighted = importance * row.columns[j];
                right[j] += weighted * row.target;
                for (int k = 0; k <= j; ++k) matrix[j][k] += weighted * row.columns[k];
            }
        }
        // Factor the matrix in place by Cholesky: its lower triangle becomes the factor.
        bool kept[most_columns];
        for (int j = 0; j < width; ++j) {
            const double whole = matrix[j][j] * (1.0 + ridge);
            double pivot = whole;
            for (int k = 0; k < j; ++k) pivot -= matrix[j][k] * matrix[j][k];
            kept[j] = pivot > dependent * whole;
            matrix[j][j] = kept[j] ? std::sqrt(pivot) : 1.0;
            for (int i = j + 1; i < width; ++i) {
                for (int k = 0; k < j; ++k) matrix[i][j] -= matrix[i][k] * matrix[j][k];
                matrix[i][j] = kept[j] ? matrix[i][j] / matrix[j][j] : 0.0;
            }
        }
        for (int j = 0; j < width; ++j) {
            for (int k = 0; k < j; ++k) right[j] -= matrix[j][k] * right[k];
            right[j] = kept[j] ? right[j] / matrix[j][j] : 0.0;
        }
        for (int j = width - 1; j >= 0; --j) {
            for (int i = j + 1; i < width; ++i) right[j] -= matrix[i][j] * right[i];
            right[j] = kept[j] ? right[j] / matrix[j][j] : 0.0;
        }
        for (int j = 0; j < width; ++j) solution[j] = right[j];
    }
    return solution;
}

// Estimate the bits of residuals: the entropy of their numbers of digits, plus the digits after the leading one, plus
// the signs.
double residual_bits(const std::vector<Row> &rows, const Solution &solution, int width) {
    std::array<i64, 64> counts{};
    double digits_in_all = 0.0;
    for (const Row &row : rows) {
        const double size = std::fabs(std::floor((target_left(row, solution, width) + half_step) / (2 * half_step)));
        const int digits = size >= 1.0 ? std::ilogb(size) + 1 : 0;
        ++counts[least(digits, 63)];
        digits_in_all += digits;
    }
    std::array<double, 65> sizes{}, logarithms{};
    for (int digits = 0; digits < 64; ++digits) sizes[digits] = static_cast<double>(most<i64>(counts[digits], 1));
    sizes[64] = static_cast<double>(rows.size());
    binary_logarithms(logarithms.data(), sizes.data(), 65);
    double entropy = sizes[64] * logarithms[64];
    for (int digits = 0; digits < 64; ++digits) entropy -= sizes[digits] * logarithms[digits];
    return entropy + digits_in_all;
}

// Choose the weights [1/32] that save the most bits; all zero if none save any.
void cheapest(const std::vector<Row> &rows, int width, double cost,
              std::array<std::array<i32, term_count>, 2> &weights) {
    double lowest = residual_bits(rows, {}, width);
    // Fit both criteria. The logarithm favours residuals that become zero, of which there are many.
    for (const bool is_logarithmic : {false, true}) {
        const Solution solution = fit_robustly(rows, width, is_logarithmic);
        Solution rounded{};
        int used = 0;
        for (int j = 0; j < width; ++j) {
            const double weight = clamp(std::nearbyint(solution[j] * weight_unit), -largest_weight, largest_weight);
            rounded[j] = weight / weight_unit;
            used += weight != 0.0;
        }
        const double bits = residual_bits(rows, rounded, width) + cost * used;
        if (!(bits < lowest)) continue;
        lowest = bits;
        for (int j = 0; j < width; ++j) {
            weights[j / term_count][j % term_count] = static_cast<i32>(rounded[j] * weight_unit);
        }
    }
}

}  // namespace

TermWeights choose_term_weights(const std::vector<i32> &order, Predictor &points) {
    struct Seen {
        Around around;
        i32 vertex;
    };
    std::array<std::vector<Seen>, kind_count> by_kind;
    for (const i32 vertex : order) {
        const Around around = points.look_around(vertex);
        by_kind[around.kind].push_back({around, vertex});
        points.learn(vertex, around, {});
    }
    TermWeights weights{};
    for (int kind = 0; kind < kind_count; ++kind) {
        std::vector<Seen> &members = by_kind[kind];
        if (members.size() < least_vertices) continue;
        // Sort by number, so that the sample is spread over the whole mesh.
        std::sort(members.begin(), members.end(), [](const Seen &a, const Seen &b) { return a.vertex < b.vertex; });
        const bool has_normal = kind >= first_of_parallelograms;
        const std::size_t stride = (members.size() + most_vertices - 1) / most_vertices;
        std::vector<Row> rows;
        std::size_t looked_at = 0;
        for (std::size_t m = 0; m < members.size(); m += stride, ++looked_at) {
            const auto &[around, vertex] = members[m];
            double square = 0.0;
            for (int k = 0; k < 3; ++k)
                square += static_cast<double>(around.normal[k]) * static_cast<double>(around.normal[k]);
            for (int k = 0; k < 3; ++k) {
                Row row{};
                for (int term = 0; term < term_count; ++term) {
                    row.columns[term] = static_cast<double>(around.terms[term][k]);
                    double portion = 0.0;
                    for (int x = 0; x < 3; ++x) {
                        portion += static_cast<double>(around.terms[term][x]) * static_cast<double>(around.normal[x]);
                    }
                    portion /= square > 0.0 ? square : 1.0;
                    if (has_normal) row.columns[term_count + term] = portion * static_cast<double>(around.normal[k]);
                }
                row.target = static_cast<double>((points.grid[vertex][k] << fraction_bits) - around.base[k]);
                rows.push_back(row);
            }
        }
        const double cost = weight_cost * static_cast<double>(looked_at) / static_cast<double>(members.size());
        cheapest(rows, has_normal ? most_columns : term_count, cost, weights[kind]);
    }
    return weights;
}

}  // namespace pdeanim
