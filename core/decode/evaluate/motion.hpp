// Evaluation of X(v, t) = R(v) + sum over k, b of psi_k(t) C[k, b] phi_b(v): R is the reference frame, psi the functions of
// time of a group of frames, phi the functions of space, C the coefficients.
//
// The sum over functions of time comes first, for some frames at once: it takes as many products as there are coefficients
// that are not zero. Then what halves of the mesh share goes down the partition tree, and at last each element's functions
// are added up at its vertices. An element with many more functions than there are functions of time keeps the field of each
// of these instead.
//
// The mean motion of an element is added up in double, and so is all that comes down the tree; what is left is small, and
// may be added up in float. The reference frame is taken from the first vertex of an element for the same reason. A mean
// is split into a number of the sums' precision and the rest of it, which the sum is added to first. Every coordinate is
// one sum in one order, so that its bits depend neither on which other times are asked for nor on the number of threads,
// nor on the processor; rounded to float it is the same as if it had been added up for float at once (twice 24 bits and 2
// are fewer than 53).
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "base/arrays.hpp"
#include "base/errors.hpp"
#include "sections/coefficients/coefficients.hpp"
#include "sections/spatial/space_basis.hpp"

namespace pdeanim {

// Frames that are evaluated together. In a page frames are shown one by one, and code is fetched: there it is without the
// loops for several.
#if defined(__wasm__)
constexpr i64 frames_at_once = 1;
#else
constexpr i64 frames_at_once = 16;
#endif

// Vertices of an element, filled up to the widest registers.
template <class Real> constexpr i64 padded(i64 vertices) {
    constexpr i64 lanes = cache_line / sizeof(Real);
    return (vertices + lanes - 1) / lanes * lanes;
}

// The reference frame in the order of the elements, the vertices of each ascending; of a selection's elements alone where
// there is one.
template <class Real> struct AnchoredReference {
    // points: (vertices, 3) [scene units].
    AnchoredReference(const Patches &patches, std::span<const double> points,
                      const SpaceSelection *selection = nullptr);

    // All at the origin.
    explicit AnchoredReference(const Patches &patches, const SpaceSelection *selection = nullptr);

    std::vector<double> anchors;  // (elements, 3): of the first vertex of each
    AlignedArray<Real> away;      // of each element: three axes of its vertices less the first, padded
    std::vector<i64> starts;      // where an element's begin there
};

// Coefficients of functions of space: of each function of time that one has any of, one, or those of three axes, padded.
// Some of the three may be 0, but to go through a list for each axis takes longer than to add these.
template <class Value> struct SpaceRows {
    static constexpr i64 padded_axes = 4;  // of three, as they are read at once

    std::vector<i64> starts{0};  // of each function of space
    std::vector<u16> functions;  // of time
    AlignedArray<Value> values;
};

template <class Real> struct Motion {
    static constexpr i64 most_functions = 1 << 14;  // 3 for each of 4096 frames, at most

    // axes: coefficients that a function of time has for each of space, 1 or 3; step: of the coefficients. The basis is the
    // caller's. Memory is counted in `taken`: LimitError, here or when coefficients are taken over.
    Motion(const SpaceBasis &basis, i64 functions, int axes, double step, TakenMemory taken = {});

    // Positions shall be those of some elements alone, whose vertices follow each other, moved by some functions; rows
    // that are taken over are those of these.
    void choose(SpaceSelection selected);

    // Take over coefficients: those of the tree first.
    void take_tree(QuantisedRows rows);

    // Then those of the elements `first` to `end` - 1; several threads may, each others.
    void take_elements(i64 first, i64 end, QuantisedRows rows);

    // All are taken over: give back the memory that this alone needed.
    void end();

    i64 channels() const { return functions * axes; }
    int time_axes() const { return axes == 1 ? 3 : 1; }
    i64 vertices() const { return selection ? static_cast<i64>(selected_places.size()) : basis->vertices(); }
    bool is_left_out(i64 element) const { return selection && !selection->has_element(element); }

    // Where an element's vertices, ascending, are among the positions.
    const i32 *places(i64 element) const {
        const Patches &patches = *basis->elements().patches;
        if (selection) return selected_places.data() + selected_starts[element];
        return patches.ascending.data() + patches.starts[element];
    }
    // Of what is read for an evaluation.
    i64 bytes() const;

    const TakenMemory &taken() const { return taken_; }

    struct Element {
        i64 columns = 0;  // functions but the constant one that have coefficients, and affine ones; or fields
        bool has_fields = false;
        double constant = 0.0;      // value of its constant function; 0 without
        AlignedArray<Real> values;  // (columns, vertices ascending), padded; fields of each axis where they differ
        SpaceRows<Real> rows;       // of its functions that are not affine
    };

    const SpaceBasis *basis;
    i64 functions;
    int axes;
    double step;
    SpaceRows<double> tree;
    std::vector<Element> elements;
    std::optional<SpaceSelection> selection;  // nothing where all functions move all vertices
    std::vector<i32> selected_places;
    std::vector<i64> selected_starts;  // of each element that is selected, among the places

private:
    // Of so many functions of time at most, an element may keep fields: it never has more functions than twice that. To
    // make fields costs what some frames do, so that they are made only where there are half as many functions again, and
    // not where some elements alone are looked at.
    static constexpr i64 most_fields = 64;

    bool may_have_fields() const { return functions <= most_fields && !selection; }

    // The row that its first function has, or would have.
    i64 first_row(i64 element) const {
        const SpaceLayout &layout = basis->layout();
        return selection ? selection->element_rows[element] - layout.affine(element) : layout.first_function(element);
    }
    template <class Value> void append_rows(SpaceRows<Value> &to, QuantisedRows rows);
    void multiply(std::span<const i64> row, double *to) const;
    void take_values(Element &own, i64 columns, i64 size);
    void keep_values(i64 element, i64 column, const double *values);
    void make_fields(i64 element, std::span<const i64> used, QuantisedRows rows, std::span<const double *const> values);

    std::vector<double> affine_;  // of all nodes, four rows of channels each, where elements may have fields
    TakenMemory taken_;
};

// Vertices that several threads may evaluate beside each other: those of one of the subtrees of the partition tree so many
// levels below its root.
struct VertexShare {
    int levels = 0;
    i64 number = 0;  // below 2^levels
};

// Positions at frames, before residuals, or displacements alone where there is no reference. time: (frames, time axes,
// functions); out: (frames, vertices, 3), float or double, written.
template <class Real, class Out> void evaluate(const Motion<Real> &motion, std::span<const double> time,
                                               const AnchoredReference<Real> *reference, std::span<Out> out,
                                               VertexShare share = {});

// Add what a motion counts at one time to a reference frame, which has the vertices in that place then. Several motions in
// a row are added up as one with the functions of all is. weights: (time axes, functions).
template <class Real> void displace(const Motion<Real> &motion, std::span<const double> weights,
                                    AnchoredReference<Real> &moved, VertexShare share = {});

}  // namespace pdeanim
