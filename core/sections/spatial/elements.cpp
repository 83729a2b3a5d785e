#include "sections/spatial/elements.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "linalg/products.hpp"
#include "sections/spatial/series.hpp"
#include "sections/spatial/space_layout.hpp"

namespace pdeanim {

namespace {

// The second pass is skipped for a column if at least this fraction of its squared norm is left after the first pass,
// because then little more than one binary digit was lost.
constexpr double once_is_enough = 0.125;

// If the new part of a unit vector is below this fraction of the threshold, every decoder drops the vector, however it
// computes.
constexpr double certainly = 0.5;

void grow(AlignedArray<double> &numbers, i64 size) {
    if (static_cast<i64>(numbers.size()) < size) numbers = AlignedArray<double>(size);
}

}  // namespace

void OrthonormalFunctions::begin(i64 points, i64 most) {
    points_ = points;
    most_ = most;
    count_ = 0;
    width_ = row_width(points);
    grow(columns_, columns_at_once * width_);
    grow(functions_, most * width_);
}

double OrthonormalFunctions::squared_norm(const double *column) const {
    return sum_of_products(column, column, width_);
}

// Subtract from columns their components along the functions `first` to `end` - 1.
void OrthonormalFunctions::take_away(std::span<Column *const> columns, i64 first, i64 end) {
    std::array<double *, columns_at_once> values;
    for (std::size_t k = 0; k < columns.size(); ++k) values[k] = columns[k]->values;
    take_away_parts({values.data(), columns.size()}, function(first), end - first, width_);
    for (Column *own : columns) own->left = squared_norm(own->values);
}

// Subtract components along the first `end` functions a second time, from columns of which little was left.
void OrthonormalFunctions::take_away_again(std::span<Column *const> columns, i64 end) {
    std::array<Column *, columns_at_once> again;
    std::size_t count = 0;
    for (Column *own : columns) {
        if (own->left > once_is_enough * own->begun) continue;
        own->begun = own->left;
        again[count++] = own;
    }
    take_away({again.data(), count}, 0, end);
}

std::array<i64, OrthonormalFunctions::columns_at_once> OrthonormalFunctions::add(i64 columns, double share, i64 first) {
    const i64 known = count_;
    std::array<Column, columns_at_once> own;
    std::array<Column *, columns_at_once> all;
    for (i64 k = 0; k < columns; ++k) {
        double *values = column(k);
        std::fill(values + points_, values + width_, 0.0);
        const double norm = squared_norm(values);
        own[k] = {values, norm, norm, norm};
        all[k] = &own[k];
    }
    std::array<i64, columns_at_once> added;
    added.fill(-1);
    for (i64 begin = 0, end = 0; begin < columns && !is_complete(); begin = end) {
        // Take at most as many columns as could be added if none were dropped.
        end = least(columns, begin + missing());
        const std::span<Column *const> some{all.data() + begin, all.data() + end};
        take_away(some, first, known);
        take_away_again(some, known);
        for (i64 k = begin; k < end; ++k) {
            const std::span<Column *const> one(&all[k], 1);
            if (count_ > known) {
                take_away(one, known, count_);
                take_away_again(one, count_);
            }
            added[k] = keep(own[k], share);
        }
    }
    return added;
}

void OrthonormalFunctions::note_nearest(double left) { nearest = std::min(nearest, std::abs(left - 1.0)); }

// Normalise the remainder of a column and add it as a function, unless it is too small. Return the index of the
// function, or -1.
i64 OrthonormalFunctions::keep(const Column &column, double share) {
    if (share > 0.0) {
        const double least_left = share * column.before;
        if (column.before > 0.0) note_nearest(column.left / least_left);
        if (!(column.left > least_left)) return -1;
    }
    const double scale = column.left > 0.0 ? 1.0 / std::sqrt(column.left) : 0.0;
    double *found = functions_.data() + count_ * width_;
    for (i64 i = 0; i < width_; ++i) found[i] = column.values[i] * scale;
    return count_++;
}

void OrthonormalFunctions::add_unit_vectors(double share) {
    // For each unit vector, the squared length that the functions do not cover yet: almost nothing for the last
    // vectors.
    std::vector<double> left(points_, 1.0);
    for (i64 j = 0, known = 0; j < points_ && !is_complete(); ++j) {
        for (; known < count_; ++known) {
            for (i64 i = j; i < points_; ++i) left[i] -= function(known)[i] * function(known)[i];
        }
        if (left[j] < certainly * share) {
            note_nearest(left[j] / share);
            continue;
        }
        std::fill_n(column(), points_, 0.0);
        column()[j] = 1.0;
        add(share);
    }
}

void OrthonormalFunctions::add_zeros() {
    std::fill_n(functions_.data() + count_ * width_, (most_ - count_) * width_, 0.0);
    count_ = most_;
}

namespace {

constexpr int sum_bits = 61;          // digits of a sum of squares of one coordinate: three such sums stay below 2^63
constexpr int moment_bits = 30;       // digits of the moments that choose rotations: products of two stay below 2^63
constexpr int turn_bits = 30;         // fraction bits of sines and cosines
constexpr int uncorrelated_bits = 8;  // coordinates are rotated if their squared correlation exceeds 2^-8
constexpr i64 floor_moment = 16;   // added to the moments that are compared: rounding errors then count as uncorrelated
constexpr int most_sweeps = 8;     // sweeps of rotations; three or four are enough
constexpr int thinnest_bits = 20;  // coordinates with less than 2^-20 of the sum of squares are rounding errors

using Axis = std::vector<i64>;

i64 moment(const Axis &a, const Axis &b) {
    i64 total = 0;
    for (std::size_t i = 0; i < a.size(); ++i) total += a[i] * b[i];
    return total;
}

void turn(Axis &a, Axis &b, i64 cosine, i64 sine) {
    for (std::size_t i = 0; i < a.size(); ++i) {
        const i64 before = a[i], after = b[i];
        a[i] = (cosine * before - sine * after) >> turn_bits;
        b[i] = (sine * before + cosine * after) >> turn_bits;
    }
}

// Return the largest integer whose square is at most `square`, 0 to 2^62.
i64 integer_root(i64 square) {
    i64 root = static_cast<i64>(std::sqrt(static_cast<double>(square)));
    while (root * root > square) --root;
    while ((root + 1) * (root + 1) <= square) ++root;
    return root;
}

// Rotate two coordinates so that they are uncorrelated; return false if they nearly are already.
bool decorrelate(Axis &a, Axis &b, int shift) {
    const i64 first = moment(a, a), second = moment(b, b), mixed = moment(a, b);
    const i64 apart = ((first >> shift) + floor_moment) * ((second >> shift) + floor_moment) >> uncorrelated_bits;
    if ((mixed >> shift) * (mixed >> shift) <= apart) return false;
    // Compute half of the angle whose cosine is |across| / root and whose sine is along / root.
    const i64 across = (second - first) >> shift, along = (2 * mixed) >> shift;
    const i64 root = integer_root(across * across + along * along);
    const i64 twice = (size_of(across) << turn_bits) / root;
    const i64 cosine = integer_root(((i64{1} << turn_bits) + twice) << (turn_bits - 1));
    const i64 sine = floor_divide(floor_divide(along << (turn_bits - 1), root) << turn_bits, cosine);
    turn(a, b, cosine, across >= 0 ? sine : -sine);
    return true;
}

}  // namespace

int LocalCoordinates::locate(std::span<const GridPoint> grid, std::span<const i32> vertices) {
    const i64 size = static_cast<i64>(vertices.size());
    // Take coordinates relative to their mean, with as many digits as sum_bits allows.
    i64 largest = 0;
    for (int k = 0; k < 3; ++k) {
        axes[k].resize(size);
        i64 total = 0;
        for (i64 i = 0; i < size; ++i) {
            axes[k][i] = grid[vertices[i]][k] - grid[vertices[0]][k];
            total += axes[k][i];
        }
        for (i64 &value : axes[k]) {
            value = size * value - total;
            largest = most(largest, size_of(value));
        }
    }
    const int excess = bit_length(largest) - (sum_bits - bit_length(size)) / 2;
    for (Axis &axis : axes) {
        for (i64 &value : axis) value = excess > 0 ? value >> excess : value << -excess;
    }
    const i64 all_three = moment(axes[0], axes[0]) + moment(axes[1], axes[1]) + moment(axes[2], axes[2]);
    const int shift = most(bit_length(all_three) - moment_bits, 0);
    for (int sweep = 0; sweep < most_sweeps; ++sweep) {
        bool is_turned = false;
        for (int p = 0; p < 2; ++p) {
            for (int q = p + 1; q < 3; ++q) is_turned |= decorrelate(axes[p], axes[q], shift);
        }
        if (!is_turned) break;
    }
    for (const int k : {0, 1, 0}) {
        if (moment(axes[k], axes[k]) < moment(axes[k + 1], axes[k + 1])) std::swap(axes[k], axes[k + 1]);
    }
    int count = 0;
    while (count < 3 && moment(axes[count], axes[count]) >> shift >= i64{1} << (moment_bits - thinnest_bits)) ++count;
    return count;
}

namespace {

// Fraction of the squared norm that must be new, else a column is dropped: for a polynomial, a function along a piece,
// a unit vector. The fraction for unit vectors is below 1 / points, so that they always complete the space of a patch.
// Functions along a piece are kept unless they are only rounding errors.
constexpr std::array<double, sort_count> usual_shares = {0x1p-12, 0x1p-40, 0x1p-12};

}  // namespace

Elements::Elements(const SpaceForm &form, std::shared_ptr<const Patches> patches, std::span<const GridPoint> grid)
    : form(form), patches(std::move(patches)), grid(grid) {
    for (int sort = 0; sort < sort_count; ++sort) shares[sort] = usual_shares[sort] * (1.0 - form.threshold / 16.0);
    if (form.kind == SpaceKind::patch) return;
    const std::vector<double> u = arc_length_parameters(grid, this->patches->order, this->patches->starts);
    series = series_functions(u, form.rate, space_functions);
}

int ElementFunctions::locate(i64 element) {
    const int found = local_.locate(elements_.grid, elements_.patches->vertices(element));
    for (int k = 0; k < 3; ++k) axes_[k].assign(local_.axes[k].begin(), local_.axes[k].end());
    return found;
}

// Add the constant, and as many local coordinates as make `count` functions in total.
void ElementFunctions::add_affine(i64 count) {
    for (i64 j = 0; j < affine_count; ++j) made_[j] = j < count ? j : -1;
    for (i64 k = 0; k < count; ++k) {
        if (k == 0) {
            std::fill_n(functions_.column(), points_, 1.0);
        } else {
            std::copy_n(axes_[k - 1].begin(), points_, functions_.column());
        }
        functions_.add(0.0);
    }
}

// Write the values of a polynomial to column k; return false if it cannot add anything new.
bool ElementFunctions::set_column(int polynomial, i64 k) {
    const Polynomial &own = polynomials[polynomial];
    made_[polynomial] = -1;
    // A multiple of a dropped polynomial adds nothing new.
    const auto is_dropped = [&](int lower) { return lower >= 0 && made_[lower] < 0; };
    if (std::any_of(own.lower.begin(), own.lower.end(), is_dropped)) return false;
    const double *lower = functions_.function(made_[own.lower[own.along]]);
    const std::vector<double> &axis = axes_[own.along];
    double *column = functions_.column(k);
    for (i64 i = 0; i < points_; ++i) column[i] = lower[i] * axis[i];
    return true;
}

// Add the polynomials, several of one degree at a time. The product of x p with a function q equals that of p with x q.
// That is zero if x q is a combination of functions made before and of lower degree than p (Stieltjes' recurrence, in
// several coordinates). So x p has components only along functions of its own degree and of the last two degrees,
// unless a factor of x or y was dropped.
void ElementFunctions::add_polynomials() {
    constexpr int normal = 2;
    std::array<i64, largest_degree + 1> first = {
        0, 1, least<i64>(affine_count - 1, functions_.count())};  // first function of each degree
    bool is_closed = true;  // every function times x or y is a combination of functions, up to this degree
    for (int j = affine_count; j < polynomial_count && !functions_.is_complete();) {
        const int degree = polynomials[j].degree();
        const bool is_normal = polynomials[j].along == normal;
        if (polynomials[j - 1].degree() < degree) first[degree] = functions_.count();
        std::array<int, OrthonormalFunctions::columns_at_once> chosen;
        i64 count = 0;
        for (; j < polynomial_count && count < OrthonormalFunctions::columns_at_once; ++j) {
            if (polynomials[j].degree() != degree || (polynomials[j].along == normal) != is_normal) break;
            if (set_column(j, count)) chosen[count++] = j;
        }
        const i64 from = is_closed && !is_normal ? first[degree - 2] : 0;
        const auto added = functions_.add(count, elements_.shares[polynomial_column], from);
        for (i64 k = 0; k < count; ++k) {
            made_[chosen[k]] = added[k];
            is_closed &= added[k] >= 0 || is_normal;
        }
    }
}

int ElementFunctions::describe(i64 element, int local, AffineSums &sums) {
    const std::span<const i32> vertices = elements_.patches->vertices(element);
    points_ = static_cast<i64>(vertices.size());
    const int found = locate(element);
    if (local < 0) local = found;
    const i64 count = SpaceLayout::affine_functions(elements_.form, points_, local);
    sums = {};
    functions_.begin(points_, count);
    add_affine(count);
    const GridPoint &origin = elements_.grid[vertices[0]];
    for (i64 i = 0; i < points_; ++i) {
        const GridPoint &point = elements_.grid[vertices[i]];
        std::array<double, affine_count> values = {1.0};
        for (int axis = 0; axis < 3; ++axis) values[1 + axis] = static_cast<double>(point[axis] - origin[axis]);
        for (i64 k = 0; k < count; ++k) {
            const double own = functions_.function(k)[i];
            for (int c = 0; c < affine_count; ++c) sums[k][c] += own * values[c];
        }
    }
    return local;
}

void ElementFunctions::make(i64 element, i64 affine, i64 count) {
    const i64 begin = elements_.patches->starts[element];
    affine = least(affine, count);
    points_ = elements_.patches->size(element);
    functions_.begin(points_, count);
    if (affine > 1 || elements_.series.empty()) locate(element);
    add_affine(affine);
    if (elements_.series.empty()) add_polynomials();
    for (int j = 0; j < space_functions && !elements_.series.empty() && !functions_.is_complete(); ++j) {
        for (i64 i = 0; i < points_; ++i) {
            functions_.column()[i] = elements_.series[(begin + i) * space_functions + j];
        }
        functions_.add(elements_.shares[series_column]);
    }
    if (elements_.form.is_affine) functions_.add_unit_vectors(elements_.shares[unit_vector]);
    functions_.add_zeros();
}

}  // namespace pdeanim
