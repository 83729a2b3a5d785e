#include "linalg/tridiagonal_eigen.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "base/instructions.hpp"
#include "base/parallel.hpp"
#include "linalg/add_product.hpp"
#include "linalg/scale.hpp"
#include "linalg/secular.hpp"

// Divide and conquer (Cuppen 1981): the matrix is cut in two, and two halves again, down to a few rows, which the QL
// algorithm does. Put together, the eigenvalues of two halves are a diagonal changed by one vector. Where that vector has
// next to nothing of an eigenvector, or two eigenvalues are all but the same, the eigenvector stays: mostly they are many.

namespace pdeanim {

namespace {

constexpr double epsilon = std::numeric_limits<double>::epsilon();
constexpr i64 few_rows = 32, rows_at_once = 48;
constexpr int most_turns = 80;  // of one eigenvalue; two or three are usual

// rows i and i + 1, of so many numbers, are turned.
PDEANIM_INLINE void turn(double *row, double *next, i64 width, double cosine, double sine) {
    for (i64 k = 0; k < width; ++k) {
        const double upper = row[k], lower = next[k];
        next[k] = sine * upper + cosine * lower;
        row[k] = cosine * upper - sine * lower;
    }
}

// The QL algorithm with implicit shifts (Wilkinson and Reinsch 1971, tql2); rows of `vectors`, if any, are turned along.
PDEANIM_INLINE void turn_to_diagonal(double *d, double *e, i64 count, double *vectors, i64 stride) {
    for (i64 first = 0; first < count; ++first) {
        for (int turns = 0; turns < most_turns; ++turns) {
            i64 end = first;
            while (end + 1 < count &&
                   std::abs(e[end]) > epsilon * (std::abs(d[end]) + std::abs(d[end + 1])) + no_length)
                ++end;
            if (end == first) break;
            double g = (d[first + 1] - d[first]) / (2.0 * e[first]);
            g = d[end] - d[first] + e[first] / (g + std::copysign(std::sqrt(g * g + 1.0), g));
            double sine = 1.0, cosine = 1.0, taken = 0.0;
            i64 i = end - 1;
            for (; i >= first; --i) {
                const double f = sine * e[i], b = cosine * e[i], length = std::sqrt(f * f + g * g);
                e[i + 1] = length;
                if (length == 0.0) {
                    d[i + 1] -= taken;
                    break;
                }
                sine = f / length;
                cosine = g / length;
                g = d[i + 1] - taken;
                const double r = (d[i] - g) * sine + 2.0 * cosine * b;
                taken = sine * r;
                d[i + 1] = g + taken;
                g = cosine * r - b;
                if (vectors) turn(vectors + i * stride, vectors + (i + 1) * stride, count, cosine, sine);
            }
            if (i < first) {
                d[first] -= taken;
                e[first] = g;
            }
            e[end] = 0.0;
        }
    }
}

// Two halves that have been done, of rows and columns `first` to `end` of the eigenvectors, cut before `middle`.
struct Cut {
    i64 first, middle, end;
    double beside;  // the number that was taken out
};

class Halves {
public:
    Halves(double *d, double *vectors, i64 stride, const Cut &cut, int threads)
        : d_(d + cut.first), vectors_(vectors + cut.first * stride + cut.first), stride_(stride),
          upper_(cut.middle - cut.first), size_(cut.end - cut.first), weight_(2.0 * std::abs(cut.beside)),
          threads_(size_ < worth_threads ? 1 : threads), kinds_(size_), z_(size_) {
        const double scale = std::sqrt(0.5);
        for (i64 j = 0; j < upper_; ++j) z_[j] = scale * row(j)[upper_ - 1];
        for (i64 j = upper_; j < size_; ++j) {
            z_[j] = (cut.beside < 0.0 ? -scale : scale) * row(j)[upper_];
            kinds_[j] = below;
        }
    }

    void put_together() {
        choose();
        if (!changed_.empty()) change();
    }

private:
    enum Kind : u8 { above, both, below };  // which columns of an eigenvector are not zero

    double *row(i64 j) { return vectors_ + j * stride_; }

    // Which eigenvectors change, by rising eigenvalue.
    void choose() {
        std::vector<i64> order(size_);
        std::iota(order.begin(), order.end(), i64{0});
        std::stable_sort(order.begin(), order.end(), [&](i64 a, i64 b) { return d_[a] < d_[b]; });
        double largest = 0.0;
        for (i64 j = 0; j < size_; ++j) largest = std::max({largest, std::abs(d_[j]), std::abs(z_[j])});
        const double enough = 8.0 * epsilon * largest;
        i64 before = -1;
        for (const i64 j : order) {
            if (weight_ * std::abs(z_[j]) <= enough) continue;
            if (before >= 0 && !are_alike(before, j, enough)) changed_.push_back(before);
            before = j;
        }
        if (before >= 0) changed_.push_back(before);
    }

    // Whether two eigenvalues may be taken as one: then the first eigenvector is turned so that it does not change.
    bool are_alike(i64 one, i64 other, double enough) {
        const double length = std::sqrt(z_[one] * z_[one] + z_[other] * z_[other]);
        const double cosine = z_[other] / length, sine = z_[one] / length;
        if (std::abs((d_[other] - d_[one]) * cosine * sine) > enough) return false;
        z_[other] = length;
        z_[one] = 0.0;
        turn(row(one), row(other), size_, cosine, sine);
        const double upper = d_[one], lower = d_[other];
        d_[one] = upper * cosine * cosine + lower * sine * sine;
        d_[other] = upper * sine * sine + lower * cosine * cosine;
        if (kinds_[one] != kinds_[other]) kinds_[one] = kinds_[other] = both;
        return true;
    }

    void change() {
        const i64 count = static_cast<i64>(changed_.size());
        std::vector<double> d(count), z(count);
        for (i64 j = 0; j < count; ++j) {
            d[j] = d_[changed_[j]];
            z[j] = z_[changed_[j]];
        }
        const Secular secular(d, std::move(z), weight_, threads_);
        // By their kind, so that products leave out what is zero.
        std::vector<i64> order(count);
        std::iota(order.begin(), order.end(), i64{0});
        std::stable_sort(order.begin(), order.end(),
                         [&](i64 a, i64 b) { return kinds_[changed_[a]] < kinds_[changed_[b]]; });
        std::vector<double> at(count), weights(count), old(count * size_);
        i64 of_kind[3] = {};
        for (i64 j = 0; j < count; ++j) {
            const i64 own = changed_[order[j]];
            at[j] = d[order[j]];
            weights[j] = secular.z()[order[j]];
            std::copy_n(row(own), size_, old.data() + j * size_);
            ++of_kind[kinds_[own]];
        }
        const i64 beyond = of_kind[above] + of_kind[both], lower = size_ - upper_;
        in_shares((count + rows_at_once - 1) / rows_at_once, threads_, [&](i64 share, i64 end) {
            std::vector<double> turned(rows_at_once * count), made(rows_at_once * size_);
            for (; share < end; ++share) {
                const i64 begin = share * rows_at_once, height = least(rows_at_once, count - begin);
                for (i64 i = 0; i < height; ++i) {
                    secular.vector(turned.data() + i * count, begin + i, at.data(), weights.data());
                }
                std::fill(made.begin(), made.end(), 0.0);
                add_product(made.data(), size_, Strided<double>{turned.data(), count, 1}, old.data(), size_,
                            {height, beyond, upper_});
                add_product(made.data() + upper_, size_, Strided<double>{turned.data() + of_kind[above], count, 1},
                            old.data() + of_kind[above] * size_ + upper_, size_,
                            {height, count - of_kind[above], lower});
                for (i64 i = 0; i < height; ++i) {
                    std::copy_n(made.data() + i * size_, size_, row(changed_[begin + i]));
                    d_[changed_[begin + i]] = secular.value(begin + i);
                }
            }
        });
    }

    double *d_, *vectors_;
    i64 stride_, upper_, size_;
    double weight_;
    int threads_;
    std::vector<u8> kinds_;
    std::vector<double> z_;
    std::vector<i64> changed_;
};

}  // namespace

void tridiagonal_values(std::vector<double> &diagonal, std::vector<double> &beside) {
    turn_to_diagonal(diagonal.data(), beside.data(), static_cast<i64>(diagonal.size()), nullptr, 0);
}

std::vector<double> tridiagonal_eigen(std::vector<double> &diagonal, std::vector<double> &beside, int threads) {
    const i64 size = static_cast<i64>(diagonal.size());
    i64 parts = 1;
    while (size > few_rows * parts) parts *= 2;
    const auto start_of = [&](i64 part) { return size * part / parts; };
    std::vector<double> taken(parts);
    for (i64 part = 1; part < parts; ++part) {
        const i64 place = start_of(part);
        taken[part] = beside[place - 1];
        beside[place - 1] = 0.0;
        diagonal[place - 1] -= std::abs(taken[part]);
        diagonal[place] -= std::abs(taken[part]);
    }
    std::vector<double> vectors(size * size);
    for (i64 i = 0; i < size; ++i) vectors[i * size + i] = 1.0;
    const int several = size < worth_threads ? 1 : threads;
    in_shares(parts, several, [&](i64 part, i64 end) {
        in_widest([&](auto) PDEANIM_INLINE_LAMBDA {
            for (i64 own = part; own < end; ++own) {
                const i64 place = start_of(own);
                turn_to_diagonal(diagonal.data() + place, beside.data() + place, start_of(own + 1) - place,
                                 vectors.data() + place * size + place, size);
            }
        });
    });
    for (i64 joined = 2; joined <= parts; joined *= 2) {
        const i64 pairs = parts / joined;
        const bool is_many = pairs >= 2 * several;  // then each thread puts its own halves together
        in_shares(pairs, is_many ? several : 1, [&](i64 pair, i64 end) {
            for (; pair < end; ++pair) {
                const i64 middle = pair * joined + joined / 2;
                const Cut cut{start_of(pair * joined), start_of(middle), start_of((pair + 1) * joined), taken[middle]};
                Halves(diagonal.data(), vectors.data(), size, cut, is_many ? 1 : threads).put_together();
            }
        });
    }
    return vectors;
}

}  // namespace pdeanim
