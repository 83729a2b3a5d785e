// Evaluation of X(v, t) = R(v) + sum over k, b of psi_k(t) C[k, b] phi_b(v): R is the reference frame, psi the
// functions of time of a group of frames, phi the functions of space, C the coefficients.
//
// The sum over functions of time comes first, for several frames at once: it takes as many products as there are
// coefficients that are not zero. Then the functions that halves of the mesh share go down the partition tree, and at
// last each element's functions are added up at its vertices. An element with many more functions than there are
// functions of time stores the field of each function of time instead.
//
// The mean motion of an element is added up in double, and so is everything that comes down the tree; the rest is
// small, and may be added up in float. For the same reason the reference frame is relative to the first vertex of an
// element. A mean is split into a number of the sums' precision and a remainder, which is added to the sum first. Every
// coordinate is one sum in one order, so its bits depend neither on other times of the call nor on the number of
// threads, nor on the processor; rounded to float it is the same as if it had been added up for float at once (twice 24
// bits and 2 are fewer than 53).
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "base/arrays.hpp"
#include "base/errors.hpp"
#include "sections/coefficients/coefficients.hpp"
#include "sections/spatial/space_basis.hpp"

namespace pdeanim {

// Frames that are evaluated together. A page shows frames one by one and must fetch the code, so it lacks the loops for
// several.
#if defined(__wasm__)
constexpr i64 frames_at_once = 1;
#else
constexpr i64 frames_at_once = 16;
#endif

// Vertices of an element, padded to the widest registers.
template <class Real> constexpr i64 padded(i64 vertices) {
    constexpr i64 lanes = cache_line / sizeof(Real);
    return (vertices + lanes - 1) / lanes * lanes;
}

// The reference frame in the order of the elements, with the vertices of each ascending; with a selection, of its
// elements only.
template <class Real> struct AnchoredReference {
    // points: (vertices, 3) [scene units].
    AnchoredReference(const Patches &patches, std::span<const double> points,
                      const SpaceSelection *selection = nullptr);

    // A reference frame whose vertices all lie at the origin.
    explicit AnchoredReference(const Patches &patches, const SpaceSelection *selection = nullptr);

    std::vector<double> anchors;  // (elements, 3): position of each element's first vertex
    AlignedArray<Real> away;      // for each element, three axes of its vertices relative to the first vertex, padded
    std::vector<i64> starts;      // where each element starts in `away`
};

// Coefficients of functions of space: for each function of time that has any, one, or three for the axes, padded. Some
// of the three may be 0, but a list for each axis would take longer than adding them.
template <class Value> struct SpaceRows {
    static constexpr i64 padded_axes = 4;  // room for three, which are read together

    std::vector<i64> starts{0};  // first row of each function of space
    std::vector<u16> functions;  // function of time of each row
    AlignedArray<Value> values;
};

template <class Real> struct Motion {
    static constexpr i64 most_functions = 1 << 14;  // 3 for each of 4096 frames, at most

    // axes: coefficients per function of time and of space, 1 or 3; step: of the coefficients. The basis stays the
    // caller's. Memory is counted in `taken`: LimitError, here or when coefficients are added.
    Motion(const SpaceBasis &basis, i64 functions, int axes, double step, TakenMemory taken = {});

    // Restrict positions to some elements, whose vertices become consecutive, moved by some functions; rows added later
    // are those of these.
    void choose(SpaceSelection selected);

    // Add the coefficients of the partition tree; call it before `take_elements`.
    void take_tree(QuantisedRows rows);

    // Add the coefficients of the elements `first` to `end` - 1; several threads may add different elements.
    void take_elements(i64 first, i64 end, QuantisedRows rows);

    // All are added: release the memory needed only for that.
    void end();

    i64 channels() const { return functions * axes; }
    int time_axes() const { return axes == 1 ? 3 : 1; }
    i64 vertices() const { return selection ? static_cast<i64>(selected_places.size()) : basis->vertices(); }
    bool is_left_out(i64 element) const { return selection && !selection->has_element(element); }

    // Indices of an element's vertices, ascending, among the positions.
    const i32 *places(i64 element) const {
        const Patches &patches = *basis->elements().patches;
        if (selection) return selected_places.data() + selected_starts[element];
        return patches.ascending.data() + patches.starts[element];
    }
    // Bytes read by an evaluation.
    i64 bytes() const;

    const TakenMemory &taken() const { return taken_; }

    struct Element {
        i64 columns = 0;  // functions with coefficients, except the constant one and affine ones; or fields
        bool has_fields = false;
        double constant = 0.0;      // value of its constant function; 0 without
        AlignedArray<Real> values;  // (columns, vertices ascending), padded; fields of each axis where they differ
        SpaceRows<Real> rows;       // rows of its functions that are not affine
    };

    const SpaceBasis *basis;
    i64 functions;
    int axes;
    double step;
    SpaceRows<double> tree;
    std::vector<Element> elements;
    std::optional<SpaceSelection> selection;  // null if all functions move all vertices
    std::vector<i32> selected_places;
    std::vector<i64> selected_starts;  // start of each selected element among the places

private:
    // Largest number of functions of time with which elements may store fields: an element never has more than twice as
    // many functions. Making fields costs as much as some frames, so they are made only for one and a half times as
    // many functions as functions of time, and not for a selection of elements.
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

    std::vector<double> affine_;  // four rows of channels per node, if elements may have fields
    TakenMemory taken_;
};

// Vertices that threads may evaluate in parallel: those of one subtree of the partition tree, `levels` below its root.
struct VertexShare {
    int levels = 0;
    i64 number = 0;  // below 2^levels
};

// Write positions at frames, before residuals, or displacements if there is no reference. time: (frames, time axes,
// functions); out: (frames, vertices, 3), float or double.
template <class Real, class Out> void evaluate(const Motion<Real> &motion, std::span<const double> time,
                                               const AnchoredReference<Real> *reference, std::span<Out> out,
                                               VertexShare share = {});

// Add a motion at one time to positions, which start as the reference frame. Several motions in a row give the same
// sums as one with all functions. weights: (time axes, functions).
template <class Real> void displace(const Motion<Real> &motion, std::span<const double> weights,
                                    AnchoredReference<Real> &moved, VertexShare share = {});

}  // namespace pdeanim
