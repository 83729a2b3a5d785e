#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <vector>

#include "base/arithmetic.hpp"
#include "base/lanes.hpp"
#include "base/parallel.hpp"
#include "encode/matrices.hpp"
#include "linalg/products.hpp"
#include "linalg/vectors.hpp"

// Computes eigenvalues and eigenvectors of a symmetric matrix in three steps. Reflections reduce it to a tridiagonal
// matrix (Tridiagonal), divide and conquer solves that (tridiagonal_eigen), and the eigenvectors are reflected back.

namespace pdeanim {

namespace {

// A symmetric matrix reduced to a tridiagonal one by reflections.
class Tridiagonal {
public:
    // Reduce a symmetric matrix (size x size) whose largest entry is about one.
    Tridiagonal(const double *matrix, i64 size);

    std::vector<double> diagonal, beside;  // `beside` are the entries next to the diagonal, with a zero at the end

    // Replace eigenvectors of the tridiagonal matrix by those of the original matrix: one per row, rows a stride apart.
    void turn_back(double *rows, i64 stride, i64 count, int threads) const;

private:
    i64 size_, stride_;
    std::vector<double> vectors_;  // row i has the vector v of the reflection that clears row i of the matrix
    std::vector<double> factors_;
};

// Rows are cleared one after the other, from the last one up, except for the entry next to the diagonal.
//
// The reflection I - f v v^T from both sides subtracts v w^T + w v^T from the rows above, with p = f A v and w = p -
// f/2 (p v) v. The next reflection follows from the next row alone. So that row is changed first, and one pass over the
// other rows then subtracts the change and multiplies by the next v.
//
// Each row is stored up to the end of the block of eight that holds its diagonal entry. Entries before that block also
// stand for their mirror images.

// A change to subtract from the matrix: v w^T + w v^T.
struct Change {
    const double *v, *w;
};

// Change `count` rows from `first` on, all in one block of eight, and add their contribution to A v (with `next` as v)
// to p.
template <int count, int bytes> PDEANIM_INLINE void change_rows(double *matrix, i64 stride, i64 first,
                                                                const Change &change, const double *next, double *p) {
    using Eight = pdeanim::Eight<bytes>;
    const i64 block = first / abreast * abreast;
    double *rows = matrix + first * stride;
    double v[count], w[count], own[count];
    Eight sums[count] = {};
    for (int r = 0; r < count; ++r) {
        v[r] = change.v[first + r];
        w[r] = change.w[first + r];
        own[r] = next[first + r];
    }
    for (i64 j = 0; j < block; j += abreast) {
        const Eight vs = Eight::at(change.v + j), ws = Eight::at(change.w + j);
        const Eight nexts = Eight::at(next + j);
        Eight total = Eight::at(p + j);
        for (int r = 0; r < count; ++r) {
            const Eight left = Eight::at(rows + r * stride + j) - v[r] * ws - w[r] * vs;
            left.put(rows + r * stride + j);
            sums[r] += left * nexts;
            total += own[r] * left;
        }
        total.put(p + j);
    }
    for (int r = 0; r < count; ++r) {
        const Eight left = Eight::at(rows + r * stride + block) - v[r] * Eight::at(change.w + block) -
                           w[r] * Eight::at(change.v + block);
        left.put(rows + r * stride + block);
        (Eight::at(p + block) + own[r] * left).put(p + block);
    }
    for (int r = 0; r < count; ++r) p[first + r] += sum_of<bytes>(sums[r]);
}

template <int bytes>
PDEANIM_INLINE void reduce(double *matrix, double *factors, double *diagonal, double *beside, i64 size, i64 stride) {
    std::vector<double> v(stride), w(stride), next(stride), p(stride);
    for (i64 i = size - 1; i >= 0; --i) {
        double *row = matrix + i * stride;
        const i64 length = whole_eights(i + 1);
        add_multiple<bytes>(row, -v[i], w.data(), length);
        add_multiple<bytes>(row, -w[i], v.data(), length);
        diagonal[i] = row[i];
        if (i == 0) break;
        std::copy_n(row, i, next.data());
        std::fill(next.begin() + i, next.end(), 0.0);
        const Reflection found = reflection_of<bytes>(next.data(), length, i - 1);
        factors[i] = found.factor;
        beside[i - 1] = found.image;
        std::copy_n(next.data(), stride, row);
        std::fill(p.begin(), p.end(), 0.0);
        const Change change{v.data(), w.data()};
        i64 first = 0;
        for (; first + 4 <= i; first += 4) change_rows<4, bytes>(matrix, stride, first, change, next.data(), p.data());
        for (; first < i; ++first) change_rows<1, bytes>(matrix, stride, first, change, next.data(), p.data());
        std::fill(p.begin() + i, p.end(), 0.0);
        const double half = found.factor * found.factor / 2.0 * dot<bytes>(p.data(), next.data(), length);
        v.swap(next);
        for (i64 j = 0; j < length; ++j) w[j] = found.factor * p[j] - half * v[j];
    }
}

constexpr i64 reflections_at_once = 32;
constexpr i64 rows_at_once = 48;  // number of eigenvectors that a thread works on together

Tridiagonal::Tridiagonal(const double *matrix, i64 size)
    : diagonal(size), beside(size), size_(size), stride_(whole_eights(size)), vectors_(size * stride_), factors_(size) {
    for (i64 i = 0; i < size; ++i) std::copy_n(matrix + i * size, size, vectors_.data() + i * stride_);
    in_widest([&](auto bytes) PDEANIM_INLINE_LAMBDA {
        reduce<bytes>(vectors_.data(), factors_.data(), diagonal.data(), beside.data(), size_, stride_);
    });
}

// The product H_1 H_2 ... of a few reflections is I + V T V^T with an upper triangular matrix T (compact WY form).
void Tridiagonal::turn_back(double *rows, i64 stride, i64 count, int threads) const {
    constexpr i64 most = reflections_at_once;
    std::vector<double> across(size_ * most), triangle(most * most);
    for (i64 begin = 1; begin < size_; begin += most) {
        const i64 some = least(most, size_ - begin), length = begin + some - 1;  // length of the longest v among them
        const double *v = vectors_.data() + begin * stride_;
        for (i64 k = 0; k < length; ++k) {
            for (i64 j = 0; j < some; ++j) across[k * some + j] = v[j * stride_ + k];
        }
        std::fill(triangle.begin(), triangle.end(), 0.0);
        std::vector<double> products(some * some);
        add_product(products.data(), some, Strided<double>{v, stride_, 1}, across.data(), some, {some, length, some});
        for (i64 j = 0; j < some; ++j) {
            const double factor = factors_[begin + j];
            for (i64 i = 0; i < j; ++i) {
                double sum = 0.0;
                for (i64 k = i; k < j; ++k) sum += triangle[i * some + k] * products[k * some + j];
                triangle[i * some + j] = -factor * sum;
            }
            triangle[j * some + j] = -factor;
        }
        in_shares((count + rows_at_once - 1) / rows_at_once, threads, [&](i64 share, i64 end) {
            std::vector<double> along(rows_at_once * some), turned(rows_at_once * some);
            for (; share < end; ++share) {
                double *own = rows + share * rows_at_once * stride;
                const i64 height = least(rows_at_once, count - share * rows_at_once);
                std::fill(along.begin(), along.end(), 0.0);
                std::fill(turned.begin(), turned.end(), 0.0);
                add_product(along.data(), some, Strided<double>{own, stride, 1}, across.data(), some,
                            {height, length, some});
                add_product(turned.data(), some, Strided<double>{along.data(), some, 1}, triangle.data(), some,
                            {height, some, some});
                add_product(own, stride, Strided<double>{turned.data(), some, 1}, v, stride_, {height, some, length});
            }
        });
    }
}

// Divide and conquer (Cuppen 1981): the matrix is halved again and again, down to a few rows, which the QL algorithm
// solves. Joining two solved halves is the eigenproblem of a diagonal matrix changed by one vector (Secular). If that
// vector is almost orthogonal to an eigenvector, or two eigenvalues are almost equal, an eigenvector stays as it is;
// usually many do.

constexpr i64 worth_threads = 160;  // number of rows from which several threads are faster than one
constexpr double epsilon = std::numeric_limits<double>::epsilon();
constexpr i64 few_rows = 32;
constexpr int most_turns = 80;  // largest number of QL steps per eigenvalue; two or three are usual

// Rotate rows i and i + 1 of `width` numbers in their plane.
void turn(double *row, double *next, i64 width, double cosine, double sine) {
    for (i64 k = 0; k < width; ++k) {
        const double upper = row[k], lower = next[k];
        next[k] = sine * upper + cosine * lower;
        row[k] = cosine * upper - sine * lower;
    }
}

// Turn a tridiagonal matrix into a diagonal one by the QL algorithm with implicit shifts (Wilkinson and Reinsch 1971,
// tql2). The rows of `vectors`, unless it is null, are rotated along.
void turn_to_diagonal(double *d, double *e, i64 count, double *vectors, i64 stride) {
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

// Two solved halves of a matrix: its rows and columns `first` to `end` - 1, cut before `middle`.
struct Cut {
    i64 first, middle, end;
    double beside;  // the matrix entry next to the diagonal at the cut
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
    enum Kind : u8 { above, both, below };  // in which half an eigenvector has numbers other than zero

    double *row(i64 j) { return vectors_ + j * stride_; }

    // Choose the eigenvectors that joining changes, in order of increasing eigenvalue.
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

    // Return whether two eigenvalues count as equal. If they do, rotate their eigenvectors so that joining does not
    // change the first one.
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
        // Sort by kind, so that the products can leave out zeros.
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

// Return the eigenvectors of a tridiagonal matrix, one per row: (size x size). `diagonal` receives the eigenvalues,
// unsorted. `beside`, the entries next to the diagonal with a zero at the end, is overwritten. Entries are at most
// about one.
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
        for (; part < end; ++part) {
            const i64 place = start_of(part);
            turn_to_diagonal(diagonal.data() + place, beside.data() + place, start_of(part + 1) - place,
                             vectors.data() + place * size + place, size);
        }
    });
    for (i64 joined = 2; joined <= parts; joined *= 2) {
        const i64 pairs = parts / joined;
        const bool is_many = pairs >= 2 * several;  // whether each pair of halves is joined by a single thread
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

}  // namespace

Eigen symmetric_eigen(const double *matrix, i64 size, bool with_vectors, int threads) {
    const double scale = scale_of(matrix, size * size), down = 1.0 / scale;
    std::vector<double> scaled(matrix, matrix + size * size);
    for (double &number : scaled) number *= down;
    Tridiagonal reduced(scaled.data(), size);
    std::vector<double> vectors;
    if (with_vectors) {
        vectors = tridiagonal_eigen(reduced.diagonal, reduced.beside, threads);
    } else {
        turn_to_diagonal(reduced.diagonal.data(), reduced.beside.data(), size, nullptr, 0);
    }
    std::vector<i64> order(size);
    std::iota(order.begin(), order.end(), i64{0});
    const std::vector<double> &values = reduced.diagonal;
    std::stable_sort(order.begin(), order.end(), [&](i64 a, i64 b) { return values[a] > values[b]; });
    Eigen found{std::vector<double>(size), std::vector<double>(vectors.size())};
    for (i64 i = 0; i < size; ++i) {
        found.values[i] = scale * values[order[i]];
        if (with_vectors) std::copy_n(vectors.data() + order[i] * size, size, found.vectors.data() + i * size);
    }
    if (with_vectors) reduced.turn_back(found.vectors.data(), size, size, size < worth_threads ? 1 : threads);
    return found;
}

}  // namespace pdeanim
