// Codes the order that faces and vertices had in the source, given the surface.
//
// The source's faces are named one after the other, each by its relation to the faces named before:
//
// 1. by a side that it shares with one of the last four faces; or 2. by a vertex that already has a number: which
// corner of the face lies there, the vertex's number, and which of the faces left at the vertex it is; or 3. by its
// position on the surface, as a difference from the position of the previous face.
//
// Then the vertices of the face that have no number yet get their numbers. Only vertices on faces are numbered. Finally
// the first corner of the face is coded, unless the second case already determines it.
#pragma once

#include <span>
#include <vector>

#include "base/arithmetic.hpp"
#include "entropy/numbers.hpp"
#include "sections/connectivity/surface.hpp"

namespace pdeanim {

// A set of numbers below n that tells how many of its members are below a number, and which member is the k-th.
//
// A binary indexed tree (Fenwick 1994, "A new data structure for cumulative frequency tables"): each operation takes a
// number of steps that grows with the logarithm of n.
class RankedSet {
public:
    // Start with all numbers below `size`, or with an empty set that has room for them.
    RankedSet(i64 size, bool is_full) : tree_(size + 1) {
        if (!is_full) return;
        for (i64 place = 0; place <= size; ++place) tree_[place] = static_cast<i32>(place & -place);
        count_ = size;
    }

    i64 count() const { return count_; }
    void add(i64 number) { change(number, 1); }
    void remove(i64 number) { change(number, -1); }

    // Return how many members are below `number`.
    i64 rank_of(i64 number) const {
        i64 found = 0;
        for (i64 place = number; place > 0; place -= place & -place) found += tree_[place];
        return found;
    }

    // Return the member that has `rank` members below it, 0 to count() - 1.
    i64 member_at(i64 rank) const {
        const i64 size = static_cast<i64>(tree_.size());
        i64 place = 0, step = 1;
        while (2 * step < size) step *= 2;
        for (; step > 0; step /= 2) {
            if (place + step < size && tree_[place + step] <= rank) {
                place += step;
                rank -= tree_[place];
            }
        }
        return place;
    }

private:
    void change(i64 number, i32 by) {
        for (i64 place = number + 1; place < static_cast<i64>(tree_.size()); place += place & -place)
            tree_[place] += by;
        count_ += by;
    }

    std::vector<i32> tree_;
    i64 count_ = 0;
};

// Faces in the order of the source.
struct Faces {
    std::vector<i32> sizes;
    std::vector<i32> indices;  // vertex of each corner
};

// Statistics of the order coder, which are kept from object to object.
class OrderModel {
public:
    OrderModel();

    // Code which of an object's vertices are on faces (`used`, ascending), and the order of the source.
    template <Mode mode> void encode(RangeCoder<mode> &coder, const CodedSurface &surface, const SourceOrder &order,
                                     std::span<const i32> used);

    // Undo `encode`; CorruptError if the bits describe no valid order.
    Faces decode(RangeCoder<Mode::decode> &coder, const CodedSurface &surface, i64 vertices);

private:
    template <Mode mode> friend class OrderCoder;

    static constexpr int recent_faces = 4;  // faces whose neighbours are tried first: two quads cut into triangles
    static constexpr int sides_told = 4;    // number of sides of a recent face that have their own slots
    // A slot says how a face was named: one slot for each side of each recent face, one for the third case, one for the
    // second.
    static constexpr int by_place = recent_faces * sides_told, by_vertex = by_place + 1, slots = by_vertex + 1;
    static constexpr int corners_told = 3;  // corners that the second case codes by yes or no, one after another
    static constexpr int jump_classes = 8;  // contexts of a difference of ranks: the last one, up to 3, and its sign
    static constexpr int proposals = 6;     // predictions of a vertex's number, besides the match model's
    static constexpr int farthest = 20;     // differences of numbers are clamped to this in contexts

    using Models = std::vector<BitModel>;

    Models found_, found_slots_, side_, side_slots_, list_, list_recent_;
    std::array<Models, corners_told> corner_, corner_slot_;
    std::array<Models, 4> first_, first_slot_;
    NumberModel corner_number_;
    std::array<SignedModel, jump_classes> jump_;
    SignedModel place_;
    Weights<2> found_weights_, side_weights_, corner_weights_, list_weights_, first_weights_;
    MatchModel to_face_;  // predicts the step from the last face to a vertex of the next one
    int found_history_ = 0, corner_history_ = 0, list_history_ = 0, first_history_ = 0;
    int slot_now_ = 0, slot_before_ = 0, slot_long_before_ = 0;
    i64 last_jump_ = 0;
    std::array<int, slots> firsts_after_{};                 // for each slot, which corners were first most recently
    std::array<std::array<int, slots>, slots> expected_{};  // which slot followed each pair of slots last time

    // Models of the numbers of vertices.
    std::array<Models, proposals> proposal_, proposal_around_;
    std::array<Weights<2>, proposals> proposal_weights_;
    std::array<SignedModel, 4> rank_;
    MatchModel numbers_;
    int proposal_history_ = 0;

    NumberModel gap_, rest_;  // models for the set of vertices that are on faces
};

}  // namespace pdeanim
