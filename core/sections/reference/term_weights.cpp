#include "sections/reference/predictor.hpp"

#include <algorithm>
#include <cmath>

#include "linalg/products.hpp"

namespace pdeanim {

namespace {

constexpr std::size_t least_vertices = 8;    // of a kind under which its weights cost more than they save
constexpr std::size_t most_vertices = 2048;  // of a kind that are looked at, evenly spread
constexpr int rounds = 5;            // of reweighted least squares; later ones change the size by less than 0.1 %
constexpr double weight_cost = 9.0;  // bits that a weight takes
constexpr double half_step =
    1 << (fraction_bits - 1);  // residuals below this are rounded to zero: size is of no matter
constexpr double largest_weight = 127.0, weight_unit = 32.0;
constexpr double ridge = 1e-6;      // added to the diagonal relatively: holds columns apart that say the same
constexpr double dependent = 1e-9;  // a pivot this small, relatively, is rounding: its column is left out
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

// Iteratively reweighted least squares, always in the same order of operations: minimises the sum of residuals' sizes, or
// of log(size + half_step); smaller sizes count as half_step.
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
        // Cholesky, in place: the lower triangle becomes the factor.
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

// Bits of residuals: the entropy of their numbers of digits, the digits below the first, the signs.
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

// Weights [1/32], by what they save; all zero where nothing does.
void cheapest(const std::vector<Row> &rows, int width, double cost,
              std::array<std::array<i32, term_count>, 2> &weights) {
    double lowest = residual_bits(rows, {}, width);
    // By absolute values, and by their logarithms, which cares for the many that can be predicted to the step.
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
        // By number, so that those looked at come from all over the mesh.
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
