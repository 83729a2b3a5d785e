#include "linalg/tridiagonal.hpp"

#include <algorithm>

#include "base/instructions.hpp"
#include "base/parallel.hpp"
#include "linalg/add_product.hpp"
#include "linalg/reflection.hpp"

// Row after row, from the last one up, is cleared but for the number beside the diagonal. The reflection I - f v v^T from
// both sides takes v w^T + w v^T from the rows above, with p = f A v and w = p - f/2 (p v) v. The next reflection needs only
// its own row of what is left, so that one pass over the others takes that away and multiplies by the next v.
//
// Of each row the numbers up to the end of the diagonal's block of eight are kept; those before that block stand for their
// mirror images, too.

namespace pdeanim {

namespace {

// What is taken away: v w^T + w v^T.
struct Change {
    const double *v, *w;
};

// Change so many rows from `first` on, all in one block of eight, and add to p what they contribute to A v.
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

constexpr i64 reflections_at_once = 32, rows_at_once = 48;

}  // namespace

Tridiagonal::Tridiagonal(const double *matrix, i64 size)
    : diagonal(size), beside(size), size_(size), stride_(whole_eights(size)), vectors_(size * stride_), factors_(size) {
    for (i64 i = 0; i < size; ++i) std::copy_n(matrix + i * size, size, vectors_.data() + i * stride_);
    in_widest([&](auto bytes) PDEANIM_INLINE_LAMBDA {
        reduce<bytes>(vectors_.data(), factors_.data(), diagonal.data(), beside.data(), size_, stride_);
    });
}

// H_1 H_2 ... of a few reflections is I + V T V^T, T an upper triangle (compact WY form).
void Tridiagonal::turn_back(double *rows, i64 stride, i64 count, int threads) const {
    constexpr i64 most = reflections_at_once;
    std::vector<double> across(size_ * most), triangle(most * most);
    for (i64 begin = 1; begin < size_; begin += most) {
        const i64 some = least(most, size_ - begin), length = begin + some - 1;  // no v of these is longer
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

}  // namespace pdeanim
