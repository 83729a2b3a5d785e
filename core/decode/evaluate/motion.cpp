#include "decode/evaluate/motion.hpp"

#include <algorithm>

#include "linalg/products.hpp"

namespace pdeanim {

namespace {

constexpr const char *counted = "coefficients of a group of frames";

// Memory of an element without coefficients, including the objects that own its arrays.
constexpr u64 bytes_per_element = sizeof(Motion<double>::Element) + 64;

bool is_zero(std::span<const i64> row) {
    return std::all_of(row.begin(), row.end(), [](i64 number) { return number == 0; });
}

// Return the coefficients in a row that belong to one function of time; they begin at a channel.
std::span<const i64> entry_of(std::span<const i64> row, i64 channel, int axes) {
    return row.subspan(channel, least<i64>(axes, static_cast<i64>(row.size()) - channel));
}

// Count the pairs of a row and a function of time that have a coefficient other than 0.
i64 count_entries(QuantisedRows rows, int axes) {
    i64 entries = 0;
    for (const std::span<const i64> row : rows) {
        const i64 count = static_cast<i64>(row.size());
        for (i64 channel = 0; channel < count; channel += axes) entries += !is_zero(entry_of(row, channel, axes));
    }
    return entries;
}

}  // namespace

template <class Real>
AnchoredReference<Real>::AnchoredReference(const Patches &patches, const SpaceSelection *selection)
    : anchors(3 * patches.count()), starts(patches.count() + 1) {
    for (i64 e = 0; e < patches.count(); ++e) {
        const bool is_there = !selection || selection->has_element(e);
        starts[e + 1] = starts[e] + (is_there ? 3 * padded<Real>(patches.size(e)) : 0);
    }
    away.resize(starts.back());
}

template <class Real> AnchoredReference<Real>::AnchoredReference(const Patches &patches, std::span<const double> points,
                                                                 const SpaceSelection *selection)
    : AnchoredReference(patches, selection) {
    for (i64 e = 0; e < patches.count(); ++e) {
        if (selection && !selection->has_element(e)) continue;
        for (int axis = 0; axis < 3; ++axis) {
            const double anchor = e < patches.moving ? points[3 * patches.vertices(e)[0] + axis] : 0.0;
            anchors[3 * e + axis] = anchor;
            Real *to = away.data() + starts[e] + axis * padded<Real>(patches.size(e));
            for (i64 at = patches.starts[e]; at < patches.starts[e + 1]; ++at) {
                *to++ = static_cast<Real>(points[3 * patches.ascending[at] + axis] - anchor);
            }
        }
    }
}

template <class Real>
Motion<Real>::Motion(const SpaceBasis &basis, i64 functions, int axes, double step, TakenMemory taken)
    : basis(&basis), functions(functions), axes(axes), step(step), taken_(std::move(taken)) {
    taken_.take(bytes_per_element * static_cast<u64>(basis.elements().count()), counted);
    elements.resize(basis.elements().count());
}

template <class Real> void Motion<Real>::choose(SpaceSelection selected) {
    const Patches &patches = *basis->elements().patches;
    selection = std::move(selected);
    selected_starts.assign(patches.count(), 0);
    selected_places.clear();
    for (const i64 e : selection->elements) {
        const i64 begin = static_cast<i64>(selected_places.size());
        selected_starts[e] = begin;
        for (i64 at = patches.starts[e]; at < patches.starts[e + 1]; ++at) {
            selected_places.push_back(static_cast<i32>(begin + patches.ascending_places[at]));
        }
    }
}

template <class Real> i64 Motion<Real>::bytes() const {
    const auto bytes_of = [](const auto &rows) {
        return sizeof(i64) * rows.starts.size() + sizeof(u16) * rows.functions.size() +
               sizeof(rows.values[0]) * rows.values.size();
    };
    std::size_t total = bytes_of(tree);
    for (const Element &own : elements) {
        total += sizeof(Element) + sizeof(Real) * own.values.size() + bytes_of(own.rows);
    }
    return static_cast<i64>(total);
}

// Append rows to the existing ones.
template <class Real> template <class Value> void Motion<Real>::append_rows(SpaceRows<Value> &to, QuantisedRows rows) {
    const i64 entries = count_entries(rows, axes), values = entries * (axes == 3 ? SpaceRows<Value>::padded_axes : 1);
    taken_.take(sizeof(i64) * (rows.size() + 1) + sizeof(u16) * entries + sizeof(Value) * values, counted);
    to.starts.reserve(rows.size() + 1);
    to.functions.reserve(entries);
    to.values.reserve(values);
    for (const std::span<const i64> row : rows) {
        const i64 count = static_cast<i64>(row.size());
        for (i64 channel = 0; channel < count; channel += axes) {
            const std::span<const i64> own = entry_of(row, channel, axes);
            if (is_zero(own)) continue;
            to.functions.push_back(static_cast<u16>(channel / axes));
            for (const i64 number : own) to.values.push_back(static_cast<Value>(static_cast<double>(number) * step));
            if (axes == 3) to.values.resize(SpaceRows<Value>::padded_axes * to.functions.size());
        }
        to.starts.push_back(static_cast<i64>(to.functions.size()));
    }
}

template <class Real> void Motion<Real>::take_tree(QuantisedRows rows) {
    const i64 count = basis->layout().tree_functions();
    if (selection) {
        std::vector<std::span<const i64>> selected(count);
        for (i64 function = 0; function < count; ++function) {
            const i64 row = selection->tree_rows[function];
            if (row >= 0) selected[function] = rows[row];
        }
        append_rows(tree, selected);
    } else {
        append_rows(tree, rows.first(count));
    }
    if (!may_have_fields()) return;
    TakenMemory for_a_while = taken_.another();
    for_a_while.take(sizeof(double) * static_cast<u64>(count * channels()), counted);
    std::vector<double> values(count * channels());
    for (i64 function = 0; function < count; ++function) {
        multiply(rows[function], values.data() + function * channels());
    }
    const i64 numbers = affine_count * basis->layout().nodes() * channels();
    taken_.take(sizeof(double) * static_cast<u64>(numbers), counted);
    affine_.resize(numbers);
    basis->tree().synthesise(values.data(), affine_, channels());
}

template <class Real> void Motion<Real>::end() {
    taken_.give_back(sizeof(double) * affine_.size());
    affine_ = std::vector<double>();
}

// Multiply the coefficients of a row by the quantisation step [scene units].
template <class Real> void Motion<Real>::multiply(std::span<const i64> row, double *to) const {
    for (const i64 number : row) *to++ = static_cast<double>(number) * step;
}

// Allocate functions or fields of an element.
template <class Real> void Motion<Real>::take_values(Element &own, i64 columns, i64 size) {
    const i64 numbers = columns * padded<Real>(size);
    taken_.take(sizeof(Real) * static_cast<u64>(numbers), counted);
    own.values.resize(numbers);
}

// Store the values of a function or a field at an element's vertices, in the order of the vertices.
template <class Real> void Motion<Real>::keep_values(i64 element, i64 column, const double *values) {
    const Patches &patches = *basis->elements().patches;
    const i64 size = patches.size(element);
    const i32 *places = patches.ascending_places.data() + patches.starts[element];
    Real *to = elements[element].values.data() + column * padded<Real>(size);
    for (i64 k = 0; k < size; ++k) to[k] = static_cast<Real>(values[places[k]]);
}

// Make the fields of an element from its functions with coefficients (`used`) and their values at its vertices.
template <class Real> void Motion<Real>::make_fields(i64 element, std::span<const i64> used, QuantisedRows rows,
                                                     std::span<const double *const> values) {
    Element &own = elements[element];
    const Elements &all = basis->elements();
    const i64 affine = basis->layout().affine(element), size = all.patches->size(element), width = channels();
    const i64 node = all.patches->node_of[element];
    const i64 count = static_cast<i64>(used.size());
    TakenMemory for_a_while = taken_.another();
    for_a_while.take(sizeof(double) * static_cast<u64>(count * width + count * size + width * size), counted);
    take_values(own, width, size);
    std::vector<double> multiples(count * width), functions_used, sums(width * size);
    functions_used.reserve(count * size);
    for (i64 i = 0; i < count; ++i) {
        const i64 k = used[i];
        double *to = multiples.data() + i * width;
        if (k < affine) {
            std::copy_n(affine_.data() + (affine_count * node + k) * width, width, to);
        } else {
            multiply(rows[first_row(element) + k], to);
        }
        functions_used.insert(functions_used.end(), values[i], values[i] + size);
    }
    add_product<double>(sums.data(), size, {multiples.data(), 1, width}, functions_used.data(), size,
                        {width, count, size});
    for (i64 channel = 0; channel < width; ++channel) keep_values(element, channel, sums.data() + channel * size);
    own.has_fields = true;
    own.columns = functions;
}

template <class Real> void Motion<Real>::take_elements(i64 first, i64 end, QuantisedRows rows) {
    const Elements &all = basis->elements();
    ElementFunctions making(all);
    std::vector<i64> used;  // the element's functions with coefficients, except the constant one
    std::vector<const double *> values;
    std::vector<std::span<const i64>> others;  // rows of the functions that are not affine
    for (i64 e = first; e < end; ++e) {
        if (is_left_out(e)) continue;
        Element &own = elements[e];
        if (basis->layout().rank(e) == 0) continue;  // the element stands still
        const i64 affine = basis->layout().affine(e), size = all.patches->size(e), own_row = first_row(e);
        used.clear();
        for (i64 k = affine > 0; k < basis->layout().rank(e); ++k) {
            if (k < affine || !is_zero(rows[own_row + k])) used.push_back(k);
        }
        // Build functions only up to the last one with coefficients: usually a fraction of all.
        const i64 rank = most(affine, used.empty() ? 0 : used.back() + 1);
        const SpaceBasis::FirstFunctions made = basis->first_functions(e, rank, making);
        const auto function = [&](i64 k) { return made.values.numbers + k * made.values.row; };
        values.clear();
        for (const i64 k : used) values.push_back(function(k));
        own.constant = affine > 0 ? function(0)[0] : 0.0;
        own.columns = static_cast<i64>(used.size());
        if (2 * own.columns > 3 * functions && may_have_fields()) {
            make_fields(e, used, rows, values);
            continue;
        }
        take_values(own, own.columns, size);
        others.clear();
        for (i64 i = 0; i < own.columns; ++i) {
            keep_values(e, i, values[i]);
            if (used[i] >= affine) others.push_back(rows[own_row + used[i]]);
        }
        append_rows(own.rows, others);
    }
}

template struct AnchoredReference<float>;
template struct AnchoredReference<double>;
template struct Motion<float>;
template struct Motion<double>;

}  // namespace pdeanim
