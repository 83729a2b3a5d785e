// Evaluation of X(v, t) = R(v) + sum over k, b of psi_k(t) C[k, b] phi_b(v): R is the reference frame, psi the
// functions of time of a group of frames, phi the functions of space, C the coefficients.
//
// The sum over functions of time comes first, for several frames at once: it takes as many products as there are
// coefficients that are not zero. Then the values of the functions that several elements share are carried down the
// partition tree. Finally each element's functions are added up at its vertices. An element with many more functions of
// space than functions of time stores one field per function of time instead.
//
// The mean motion of an element, and all values that come down the tree, are added up in double. The other terms are
// small, and may be added up in float. For the same reason the reference frame is relative to the first vertex of an
// element. A mean is split into a number of the sums' precision and a remainder, and the remainder is added first.
// Every coordinate is one sum in one order, so its bits depend neither on other times of the call, nor on the number of
// threads, nor on the processor. A double sum rounded to float equals the sum added up for float output (twice 24 bits
// and 2 are fewer than 53).
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "base/arrays.hpp"
#include "base/errors.hpp"
#include "sections/coefficients/coefficients.hpp"
#include "sections/spatial/space_basis.hpp"

namespace pdeanim {

// Number of frames that are evaluated together. A web page shows frames one by one and must download the code, so
// WebAssembly lacks the loops for several frames.
#if defined(__wasm__)
constexpr i64 frames_at_once = 1;
#else
constexpr i64 frames_at_once = 16;
#endif

// Return the number of vertices of an element, padded to the widest registers.
template <class Real> constexpr i64 padded(i64 vertices) {
    constexpr i64 lanes = cache_line / sizeof(Real);
    return (vertices + lanes - 1) / lanes * lanes;
}

// The reference frame, element by element, with the vertices of each element ascending. With a selection it has only
// the selected elements. Elements that stand still are relative to the origin: their positions are rounded once, so that
// they are equal in groups of both precisions.
template <class Real> struct AnchoredReference {
    // points: (vertices, 3) [scene units].
    AnchoredReference(const Patches &patches, std::span<const double> points,
                      const SpaceSelection *selection = nullptr);

    // Place all vertices at the origin.
    explicit AnchoredReference(const Patches &patches, const SpaceSelection *selection = nullptr);

    std::vector<double> anchors;  // (elements, 3): position of each moving element's first vertex, or 0
    AlignedArray<Real> away;      // (axes, padded vertices) of each element: positions relative to its anchor
    std::vector<i64> starts;      // where each element starts in `away`
};

// Coefficients of functions of space, in rows of functions of time that have any: one number per row, or one for each
// of the three axes, padded. Some of the three may be 0, but a list for each axis would take longer than adding zeros.
template <class Value> struct SpaceRows {
    static constexpr i64 padded_axes = 4;  // three coefficients and padding, which are loaded together

    std::vector<i64> starts{0};  // first row of each function of space
    std::vector<u16> functions;  // index of the function of time of each row
    AlignedArray<Value> values;
};

template <class Real> struct Motion {
    static constexpr i64 most_functions = 1 << 14;  // at most 3 for each of 4096 frames

    // axes: coefficients per pair of functions of time and space, 1 or 3; step: their quantisation step. `basis` must
    // outlive the motion. Memory is counted in `taken`: LimitError, here or when coefficients are added.
    Motion(const SpaceBasis &basis, i64 functions, int axes, double step, TakenMemory taken = {});

    // Restrict positions to selected elements, whose vertices are numbered consecutively, and to selected functions.
    // Rows that are added later hold only the selected functions.
    void choose(SpaceSelection selected);

    // Add the coefficients of the partition tree; call it before `take_elements`.
    void take_tree(QuantisedRows rows);

    // Add the coefficients of the elements `first` to `end` - 1; several threads may add different elements.
    void take_elements(i64 first, i64 end, QuantisedRows rows);

    // Call this when all coefficients are added: it releases memory that is needed only for adding.
    void end();

    i64 channels() const { return functions * axes; }
    int time_axes() const { return axes == 1 ? 3 : 1; }
    i64 vertices() const { return selection ? static_cast<i64>(selected_places.size()) : basis->vertices(); }
    bool is_left_out(i64 element) const { return selection && !selection->has_element(element); }

    // Return the indices of an element's vertices in the positions, ascending.
    const i32 *places(i64 element) const {
        const Patches &patches = *basis->elements().patches;
        if (selection) return selected_places.data() + selected_starts[element];
        return patches.ascending.data() + patches.starts[element];
    }
    // Return the number of bytes that an evaluation reads.
    i64 bytes() const;

    const TakenMemory &taken() const { return taken_; }

    struct Element {
        i64 columns = 0;  // number of functions with coefficients, without the constant one; or number of fields
        bool has_fields = false;
        double constant = 0.0;  // value of the element's constant function; 0 if it has none
        // Columns of values at the vertices (ascending), padded; three columns per field if fields differ by axis.
        AlignedArray<Real> values;
        SpaceRows<Real> rows;  // rows of the functions that are not affine
    };

    const SpaceBasis *basis;
    i64 functions;
    int axes;
    double step;
    SpaceRows<double> tree;
    std::vector<Element> elements;
    std::optional<SpaceSelection> selection;  // empty if all functions move all vertices
    std::vector<i32> selected_places;
    std::vector<i64> selected_starts;  // start of each selected element in `selected_places`

private:
    // Largest number of functions of time with which elements may store fields: an element never has more than twice as
    // many functions of space. Making fields costs as much as evaluating some frames, so an element has them only if it
    // has more than one and a half times as many functions of space as there are functions of time, and never in a
    // selection.
    static constexpr i64 most_fields = 64;

    bool may_have_fields() const { return functions <= most_fields && !selection; }

    // Return the row of the element's first function; if it has no affine functions of its own, the row where they
    // would begin.
    i64 first_row(i64 element) const {
        const SpaceLayout &layout = basis->layout();
        return selection ? selection->element_rows[element] - layout.affine(element) : layout.first_function(element);
    }
    template <class Value> void append_rows(SpaceRows<Value> &to, QuantisedRows rows);
    void multiply(std::span<const i64> row, double *to) const;
    void take_values(Element &own, i64 columns, i64 size);
    void keep_values(i64 element, i64 column, const double *values);
    void make_fields(i64 element, std::span<const i64> used, QuantisedRows rows, std::span<const double *const> values);

    std::vector<double> affine_;  // four rows of channels for each node, if elements may have fields
    TakenMemory taken_;
};

// A share of the vertices that one thread evaluates: those of one subtree of the partition tree, `levels` below its
// root.
struct VertexShare {
    int levels = 0;
    i64 number = 0;  // of the subtree, below 2^levels
};

// Write positions at frames, before residuals; or displacements if there is no reference frame. time: (frames, time
// axes, functions); out: (frames, vertices, 3), float or double.
template <class Real, class Out> void evaluate(const Motion<Real> &motion, std::span<const double> time,
                                               const AnchoredReference<Real> *reference, std::span<Out> out,
                                               VertexShare share = {});

// Add a motion at one time to positions, which start as the reference frame. Adding several motions one after another
// gives the same sums as one motion with all their functions. weights: (time axes, functions).
template <class Real> void displace(const Motion<Real> &motion, std::span<const double> weights,
                                    AnchoredReference<Real> &moved, VertexShare share = {});

}  // namespace pdeanim
