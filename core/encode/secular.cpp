#include "encode/matrices.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "base/lanes.hpp"
#include "base/parallel.hpp"
#include "linalg/vectors.hpp"

// Eigenvalues are the zeros of f(x) = 1/weight + sum of z_j^2 / (d_j - x), which increases between two neighbouring d.
// Each is found by approximating f with a function of two poles (Li 1993, "Solving secular equations stably and
// efficiently"), within an interval that shrinks around the zero. Eight zeros are searched for side by side,
// independently of each other. Eigenvectors are those of Gu and Eisenstat 1994, "A stable and efficient algorithm for
// the rank-one modification of the symmetric eigenproblem".

namespace pdeanim {

namespace {

constexpr double epsilon = std::numeric_limits<double>::epsilon();

// Number of steps that usually suffices; after it, every second step halves the interval. most_steps is enough to halve
// it down to the last digit.
constexpr int usual_steps = 12, most_steps = 400;

using UsualEight = Eight<usual_bytes>;

// Sums over the poles up to and including a zero's own, sums over the poles beyond, and the derivatives of both.
struct Sums {
    UsualEight before{}, beyond{}, slope_before{}, slope_beyond{};
};

struct Equation {
    const double *d, *z;
    double weight;
    i64 count;
};

// Return the sums for eight zeros, from number `first` on, at given offsets from their origins.
Sums sums_at(const Equation &of, i64 first, const double *from, const double *at) {
    const UsualEight origins = UsualEight::at(from), offsets = UsualEight::at(at);
    Sums found;
    i64 j = 0;
    for (; j <= first && j < of.count; ++j) {
        const UsualEight term = of.z[j] / ((of.d[j] - origins) - offsets);
        found.before += of.z[j] * term;
        found.slope_before += term * term;
    }
    for (; j < first + abreast && j < of.count; ++j) {
        const UsualEight term = of.z[j] / ((of.d[j] - origins) - offsets);
        double is_before[abreast], is_beyond[abreast];
        for (int lane = 0; lane < abreast; ++lane) {
            is_before[lane] = j <= first + lane ? 1.0 : 0.0;
            is_beyond[lane] = 1.0 - is_before[lane];
        }
        found.before += where_positive(UsualEight::at(is_before), of.z[j] * term);
        found.slope_before += where_positive(UsualEight::at(is_before), term * term);
        found.beyond += where_positive(UsualEight::at(is_beyond), of.z[j] * term);
        found.slope_beyond += where_positive(UsualEight::at(is_beyond), term * term);
    }
    for (; j < of.count; ++j) {
        const UsualEight term = of.z[j] / ((of.d[j] - origins) - offsets);
        found.beyond += of.z[j] * term;
        found.slope_beyond += term * term;
    }
    return found;
}

// The search for one zero, which lies between origin + low and origin + high.
struct Search {
    double low, high, offset;
    i64 origin, left, right;  // left, right: the two poles next to the zero; the last two for the last zero
    bool is_last = false, found = false;

    void begin(const Equation &of, i64 i, double value_between) {
        is_last = i == of.count - 1;
        left = is_last ? i - 1 : i;
        right = left + 1;
        if (is_last) {
            origin = i;
            low = 0.0;
            double length = 0.0;
            for (i64 j = 0; j < of.count; ++j) length += of.z[j] * of.z[j];
            high = of.weight * length * (1.0 + 4.0 * epsilon * static_cast<double>(of.count));
            if (of.count == 1) {
                offset = of.weight * length;
                found = true;
                return;
            }
        } else {
            const double half = (of.d[right] - of.d[left]) / 2.0;
            const bool is_left = value_between > 0.0;
            origin = is_left ? left : right;
            low = is_left ? 0.0 : -half;
            high = is_left ? half : 0.0;
        }
        offset = (low + high) / 2.0;
    }

    void step(const Equation &of, int steps, double before, double beyond, double slope_before, double slope_beyond) {
        const double value = 1.0 / of.weight + before + beyond;
        const double size = 1.0 / of.weight + std::abs(before) + std::abs(beyond), slope = slope_before + slope_beyond;
        (value > 0.0 ? high : low) = offset;
        if (std::abs(value) <= epsilon * (4.0 * size + std::abs(offset) * slope)) {
            found = true;
            return;
        }
        const double to_left = (of.d[left] - of.d[origin]) - offset, to_right = (of.d[right] - of.d[origin]) - offset;
        const double a = (to_left + to_right) * value - to_left * to_right * slope, b = to_left * to_right * value;
        double c, move;
        if (is_last) {
            const double of_last = of.z[right] / to_right;
            c = value - to_left * (slope - of_last * of_last) - to_right * (of_last * of_last);
        } else {
            c = value - to_left * slope_before - to_right * slope_beyond;
        }
        const double root = std::sqrt(std::abs(a * a - 4.0 * b * c));
        if (is_last) {
            move = a >= 0.0 ? (a + root) / (2.0 * c) : 2.0 * b / (a - root);
        } else {
            move = a <= 0.0 ? (a - root) / (2.0 * c) : 2.0 * b / (a + root);
        }
        double next = offset + move;
        if (!(next > low && next < high) || (steps > usual_steps && steps % 2 == 0)) next = low + (high - low) / 2.0;
        // No floating-point number lies between the two ends.
        if (!(next > low && next < high)) {
            found = true;
            return;
        }
        if (std::abs(next - offset) <= epsilon / 2.0 * std::abs(next)) found = true;
        offset = next;
    }
};

void find_eight(const Equation &of, i64 first, i64 *origins, double *offsets) {
    const int own = static_cast<int>(least<i64>(abreast, of.count - first));
    Search searches[abreast];
    double at[abreast] = {}, from[abreast] = {};
    for (int k = 0; k < own; ++k) {
        const i64 i = first + k;
        from[k] = of.d[i];
        at[k] = i + 1 < of.count ? (of.d[i + 1] - of.d[i]) / 2.0 : 1.0;
    }
    for (int k = own; k < abreast; ++k) at[k] = 1.0;
    const Sums between = sums_at(of, first, from, at);
    for (int k = 0; k < own; ++k) {
        searches[k].begin(of, first + k, 1.0 / of.weight + between.before[k] + between.beyond[k]);
    }
    bool is_done = false;
    for (int steps = 0; !is_done && steps < most_steps; ++steps) {
        for (int k = 0; k < own; ++k) {
            from[k] = of.d[searches[k].origin];
            at[k] = searches[k].offset;
        }
        const Sums sums = sums_at(of, first, from, at);
        is_done = true;
        for (int k = 0; k < own; ++k) {
            if (searches[k].found) continue;
            searches[k].step(of, steps, sums.before[k], sums.beyond[k], sums.slope_before[k], sums.slope_beyond[k]);
            is_done = is_done && searches[k].found;
        }
    }
    for (int k = 0; k < own; ++k) {
        origins[k] = searches[k].origin;
        offsets[k] = searches[k].offset;
    }
}

// total_j *= (origin + offset - d_j) / (pole - d_j), for j from `first` to `end` - 1.
void multiply_ratios(double *total, const double *d, i64 first, i64 end, double origin, double offset, double pole) {
    i64 j = first;
    for (; j + abreast <= end; j += abreast) {
        const UsualEight at = UsualEight::at(d + j);
        (UsualEight::at(total + j) * (((origin - at) + offset) / (pole - at))).put(total + j);
    }
    for (; j < end; ++j) total[j] *= ((origin - d[j]) + offset) / (pole - d[j]);
}

}  // namespace

Secular::Secular(std::vector<double> d, std::vector<double> z, double weight, int threads)
    : count_(static_cast<i64>(d.size())), weight_(weight), d_(std::move(d)), z_(std::move(z)), exact_z_(count_, 1.0),
      origins_(count_), offsets_(count_) {
    const Equation equation{d_.data(), z_.data(), weight_, count_};
    in_shares((count_ + abreast - 1) / abreast, threads, [&](i64 block, i64 end) {
        for (; block < end; ++block) {
            find_eight(equation, block * abreast, origins_.data() + block * abreast, offsets_.data() + block * abreast);
        }
    });
    // z_j^2 = product of (eigenvalue_i - d_j) divided by the product of (d_i - d_j), pairing factors of similar size.
    for (i64 i = 0; i + 1 < count_; ++i) {
        const double origin = d_[origins_[i]], offset = offsets_[i];
        multiply_ratios(exact_z_.data(), d_.data(), 0, i + 1, origin, offset, d_[i + 1]);
        multiply_ratios(exact_z_.data(), d_.data(), i + 1, count_, origin, offset, d_[i]);
    }
    for (i64 j = 0; j < count_; ++j) {
        const double square = exact_z_[j] * ((d_[origins_[count_ - 1]] - d_[j]) + offsets_[count_ - 1]) / weight_;
        exact_z_[j] = std::copysign(std::sqrt(std::abs(square)), z_[j]);
    }
}

void Secular::vector(double *out, i64 i, const double *at, const double *weights) const {
    const double origin = d_[origins_[i]], offset = offsets_[i];
    UsualEight squares{};
    i64 j = 0;
    for (; j + abreast <= count_; j += abreast) {
        const UsualEight found = UsualEight::at(weights + j) / ((UsualEight::at(at + j) - origin) - offset);
        found.put(out + j);
        squares += found * found;
    }
    double length = sum_of<usual_bytes>(squares);
    for (; j < count_; ++j) {
        out[j] = weights[j] / ((at[j] - origin) - offset);
        length += out[j] * out[j];
    }
    const double scale = 1.0 / std::sqrt(length);
    for (j = 0; j < count_; ++j) out[j] *= scale;
}

}  // namespace pdeanim
