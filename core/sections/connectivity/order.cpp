#include "sections/connectivity/order.hpp"

#include <optional>

#include "base/errors.hpp"

namespace pdeanim {

namespace {

// Number of sides of a recent face that are candidates, and number of corners of a face, from its first one, that can
// name it. Few faces have more, and the limit keeps the time linear.
constexpr int most_sides = 16;

constexpr int most_listed = 32;  // number of corners of a vertex by which it can name a face; keeps the time linear

// A surface, and the part of its order that is coded so far.
class Records {
public:
    struct Corner {
        i32 vertex, across, face, after, next_there;
    };
    struct Vertex {
        i32 number = -1, first_there = -1, left_there = 0;
    };

    explicit Records(const CodedSurface &surface)
        : corners(surface.border.sides.size()), starts(surface.sizes.size() + 1), vertices(surface.vertex_count),
          vertex_of(surface.vertex_count, -1), left_faces(static_cast<i64>(surface.sizes.size()), true),
          left_numbers(surface.vertex_count, true), live(surface.vertex_count, false), is_named_(surface.sizes.size()) {
        i32 first = 0;
        for (i32 face = 0; face < static_cast<i32>(surface.sizes.size()); ++face) {
            const i32 size = surface.sizes[face];
            for (i32 corner = first; corner < first + size; ++corner) {
                const Border::Side &side = surface.border.sides[corner];
                Vertex &vertex = vertices[side.origin];
                corners[corner] = {side.origin, side.opposite, face, corner + 1 < first + size ? corner + 1 : first,
                                   vertex.first_there};
                vertex.first_there = corner;
                ++vertex.left_there;
            }
            first += size;
            starts[face + 1] = first;
        }
    }

    i32 after(i32 corner) const { return corners[corner].after; }
    i32 before(i32 corner) const {
        const i32 face = corners[corner].face;
        return corner == starts[face] ? starts[face + 1] - 1 : corner - 1;
    }
    // Return whether a corner is left, which means that its face has not been named. Corners of named faces are
    // skipped, and unlinked when a list is walked.
    bool is_left(i32 corner) const { return !is_named_[corners[corner].face]; }
    i32 number_at(i32 corner) const { return vertices[corners[corner].vertex].number; }

    // Return the first corner that is left at a vertex, or -1.
    i32 first_left(i32 vertex) {
        i32 corner = vertices[vertex].first_there;
        while (corner >= 0 && !is_left(corner)) corner = corners[corner].next_there;
        return vertices[vertex].first_there = corner;
    }

    // Return the next corner that is left at the same vertex, or -1.
    i32 next_left(i32 corner) {
        i32 following = corners[corner].next_there;
        while (following >= 0 && !is_left(following)) following = corners[following].next_there;
        return corners[corner].next_there = following;
    }

    void give_number(i32 vertex, i32 number) {
        vertices[vertex].number = number;
        vertex_of[number] = vertex;
        left_numbers.remove(number);
        live.add(number);
    }

    // Record that a face has been named. All its vertices must have numbers.
    void take_face(i32 face) {
        is_named_[face] = true;
        left_faces.remove(face);
        for (i32 corner = starts[face]; corner < starts[face + 1]; ++corner) {
            Vertex &vertex = vertices[corners[corner].vertex];
            if (--vertex.left_there == 0) live.remove(vertex.number);
        }
    }

    std::vector<Corner> corners;
    std::vector<i32> starts;  // first corner of each face; the last entry is the number of corners
    std::vector<Vertex> vertices;
    std::vector<i32> vertex_of;  // vertex of each number, or -1
    RankedSet left_faces, left_numbers;
    RankedSet live;  // numbers of the vertices at which corners are left

private:
    std::vector<bool> is_named_;
};

// A corner that is left across a side of a recent face, and the slot of that side.
struct Candidate {
    i32 corner;
    int slot;
};

}  // namespace

template <Mode mode> class OrderCoder {
public:
    OrderCoder(RangeCoder<mode> &coder, OrderModel &model, const CodedSurface &surface, const SourceOrder *source)
        : coder_(coder), model_(model), records_(surface), source_(source) {}

    Faces code() {
        Faces told;
        const i32 faces = static_cast<i32>(records_.starts.size()) - 1;
        told.sizes.reserve(faces);
        told.indices.reserve(records_.corners.size());
        for (i32 position = 0; position < faces; ++position) {
            const i32 wanted = encoding ? source_->firsts[position] : -1;
            int slot = OrderModel::by_place;
            const i32 entry = code_entry(position, wanted, slot);
            number_vertices(entry, slot);
            const i32 first = slot == OrderModel::by_vertex ? entry : code_first(slot, entry, wanted);
            remember(first, slot);
            records_.take_face(records_.corners[first].face);
            list_candidates(first);
            i32 size = 0, corner = first;
            do {
                told.indices.push_back(records_.number_at(corner));
                corner = records_.after(corner);
                ++size;
            } while (corner != first);
            told.sizes.push_back(size);
        }
        return told;
    }

private:
    static constexpr bool encoding = mode != Mode::decode;
    static constexpr int slots = OrderModel::slots;

    [[noreturn]] void broken() const { throw CorruptError("holds an order that does not fit section CONN"); }

    // Name the next face, and return the corner by which it is entered; `slot` tells how it was named.
    i32 code_entry(i32 position, i32 wanted, int &slot) {
        const i32 face = encoding ? records_.corners[wanted].face : -1;
        if (!candidates_.empty()) {
            if (const auto found = code_side(face)) {
                slot = found->slot;
                return found->corner;
            }
        }
        if (records_.live.count() > 0) {
            if (const auto found = code_by_vertex(wanted)) {
                slot = OrderModel::by_vertex;
                return *found;
            }
        }
        const i32 last = position > 0 ? records_.corners[last_first_].face : 0;
        return records_.starts[code_place(last, face)];
    }

    // First case: code which of the candidates lies on `face`, or that none does.
    std::optional<Candidate> code_side(i32 face) {
        const int count = static_cast<int>(candidates_.size());
        int place = encoding ? 0 : count;
        while (place < count && records_.corners[candidates_[place].corner].face != face) ++place;
        const int last = model_.slot_now_, before = model_.slot_before_, long_before = model_.slot_long_before_;
        const bool found =
            coder_.template mixed<2>({&model_.found_[model_.found_history_],
                                      &model_.found_slots_[(last * slots + before) * slots + long_before]},
                                     model_.found_weights_.data(), place < count);
        model_.found_history_ = (2 * model_.found_history_ + found) & 255;
        if (!found) return std::nullopt;
        // Try first the slot that followed these two last time: most orders repeat themselves.
        int &usual = model_.expected_[last][before];
        int expected = 0;
        while (expected < count && candidates_[expected].slot != usual) ++expected;
        if (expected == count) expected = 0;
        int tried = expected;
        for (int turn = 0; turn < count - 1; ++turn) {
            const int slot = candidates_[tried].slot;
            if (coder_.template mixed<2>({&model_.side_[(slot * slots + last) * 4 + least(turn, 3)],
                                          &model_.side_slots_[(slot * slots + before) * slots + long_before]},
                                         model_.side_weights_.data(), tried == place)) {
                break;
            }
            tried = turn == 0 ? 0 : tried + 1;
            if (tried == expected) ++tried;
        }
        usual = candidates_[tried].slot;
        return candidates_[tried];
    }

    // Second case: return the first corner of the face, or nothing if no vertex of the face can name it.
    std::optional<i32> code_by_vertex(i32 first) {
        i32 steps = -1, wanted = -1, vertex = -1;
        if constexpr (encoding) {
            steps = first_known(first);
            if (steps >= 0) {
                wanted = first;
                for (i32 step = 0; step < steps; ++step) wanted = records_.after(wanted);
                vertex = records_.corners[wanted].vertex;
            }
        }
        const i64 told = code_corner(steps);
        if (told < 0) return std::nullopt;
        if (told >= most_sides) broken();
        return code_listed(code_vertex_there(vertex), static_cast<i32>(told), wanted);
    }

    // Return the number of steps from `first` to the first corner whose vertex has a number; -1 if the corner is too
    // far from `first` in the face, or too far down in the list of its vertex.
    i32 first_known(i32 first) {
        i32 corner = first, steps = 0;
        while (records_.number_at(corner) < 0) {
            corner = records_.after(corner);
            ++steps;
            if (corner == first || steps == most_sides) return -1;
        }
        i32 listed = records_.first_left(records_.corners[corner].vertex);
        for (int turn = 0; turn < most_listed - 1 && listed != corner; ++turn) {
            listed = records_.next_left(listed);
            if (listed < 0) return -1;
        }
        return listed == corner ? steps : -1;
    }

    // Code the number of steps from the first corner to the corner that names the face; -1 if no corner does.
    i64 code_corner(i32 steps) {
        const int recent = model_.corner_history_;
        int told = 0;
        for (; told < OrderModel::corners_told; ++told) {
            if (coder_.template mixed<2>({&model_.corner_[told][recent],
                                          &model_.corner_slot_[told][(recent & 15) * slots + model_.slot_now_]},
                                         model_.corner_weights_.data(), steps == told)) {
                break;
            }
        }
        model_.corner_history_ = (4 * recent + told) & 255;
        if (told < OrderModel::corners_told) return told;
        const i64 further = model_.corner_number_.code(coder_, steps < 0 ? 0 : steps - told + 1);
        return further ? told + further - 1 : -1;
    }

    // Code a vertex that has a number and at which corners are left.
    i32 code_vertex_there(i32 vertex) {
        const i64 reference = records_.number_at(last_first_);
        const i64 numbers = static_cast<i64>(records_.vertex_of.size());
        i64 number = vertex < 0 ? 0 : records_.vertices[vertex].number;
        if (const auto difference = model_.to_face_.code(coder_, 0, number - reference)) {
            number = reference + *difference;
            if (number < 0 || number >= numbers || records_.vertex_of[number] < 0) broken();
        } else {
            const i64 rank = records_.live.rank_of(reference);
            const i64 last = model_.last_jump_;
            const int context =
                2 * static_cast<int>(least<i64>(size_of(last), OrderModel::jump_classes / 2 - 1)) + (last < 0);
            const i64 jump = model_.jump_[context].code(coder_, vertex < 0 ? 0 : records_.live.rank_of(number) - rank);
            model_.last_jump_ = jump;
            if (rank + jump < 0 || rank + jump >= records_.live.count()) broken();
            number = records_.live.member_at(rank + jump);
        }
        model_.to_face_.add(number - reference);
        vertex = records_.vertex_of[number];
        if (records_.vertices[vertex].left_there <= 0) broken();
        return vertex;
    }

    // Code which of the corners left at `vertex` belongs to the face, where it is `steps` after the face's first
    // corner. Return that first corner.
    i32 code_listed(i32 vertex, i32 steps, i32 wanted) {
        i32 listed = records_.first_left(vertex), first;
        for (int place = 0;; ++place) {
            first = corner_back(listed, steps);
            const i32 following = records_.next_left(listed);
            if (following < 0 || place == most_listed - 1) break;
            const int alike = first >= 0 ? resemblance(first) : 0;
            const bool taken = coder_.template mixed<2>({&model_.list_[alike * 8 + least(place, 7)],
                                                         &model_.list_recent_[alike / 9 * 64 + model_.list_history_]},
                                                        model_.list_weights_.data(), listed == wanted);
            model_.list_history_ = (2 * model_.list_history_ + taken) & 63;
            if (taken) break;
            listed = following;
        }
        if (first < 0) broken();
        return first;
    }

    // Return the corner `steps` before a corner in its face; -1 if that is all the way round.
    i32 corner_back(i32 corner, i32 steps) const {
        i32 found = corner;
        for (i32 step = 0; step < steps; ++step) {
            found = records_.before(found);
            if (found == corner) return -1;
        }
        return found;
    }

    // Compare the differences of vertex numbers in a face that begins at `first` with those in the last two faces. The
    // result has four digits to base 3: second and third corner compared with the last face, second and third corner
    // compared with the face before that. A digit is 0 if the difference from the first corner is not the same, 1 if it
    // is not known, and 2 if it is the same.
    int resemblance(i32 first) const {
        const i32 second = records_.after(first);
        const i32 number = records_.number_at(first), second_number = records_.number_at(second);
        const i32 third_number = records_.number_at(records_.after(second));
        int last_second = 1, last_third = 1, before_second = 1, before_third = 1;
        if (number >= 0 && second_number >= 0) {
            last_second = 2 * (second_number - number == differences_[0]);
            before_second = 2 * (second_number - number == differences_[2]);
        }
        if (number >= 0 && third_number >= 0) {
            last_third = 2 * (third_number - number == differences_[1]);
            before_third = 2 * (third_number - number == differences_[3]);
        }
        return ((last_second * 3 + last_third) * 3 + before_second) * 3 + before_third;
    }

    // Third case: code the rank of a face among the faces left, relative to the rank of the last face.
    i32 code_place(i32 last, i32 face) {
        const i64 rank = records_.left_faces.rank_of(last);
        const i64 distance = model_.place_.code(coder_, face >= 0 ? records_.left_faces.rank_of(face) - rank : 0);
        if (rank + distance < 0 || rank + distance >= records_.left_faces.count()) broken();
        return static_cast<i32>(records_.left_faces.member_at(rank + distance));
    }

    void number_vertices(i32 entry, int slot) {
        const int phase = most(slot - OrderModel::by_place + 1, 0);
        i32 corner = entry;
        do {
            if (records_.number_at(corner) < 0) {
                const i32 vertex = records_.corners[corner].vertex;
                const i64 number = code_number(phase, slot, corner, encoding ? source_->numbers[vertex] : 0);
                records_.give_number(vertex, static_cast<i32>(number));
            }
            corner = records_.after(corner);
        } while (corner != entry);
    }

    bool is_free(i64 number) const {
        return number >= 0 && number < static_cast<i64>(records_.vertex_of.size()) && records_.vertex_of[number] < 0;
    }

    // Code the number of the vertex at `corner`, which has no number yet.
    i64 code_number(int phase, int slot, i32 corner, i64 number) {
        const i64 last = last_number_;
        if (const auto difference = model_.numbers_.code(coder_, phase, number - last)) {
            number = last + *difference;
            if (!is_free(number)) broken();
        } else {
            number = code_unmatched(slot, corner, number);
        }
        model_.numbers_.add(number - last);
        last_number_ = number;
        highest_ = most(highest_, number);
        return number;
    }

    i64 code_unmatched(int slot, i32 corner, i64 number) {
        const i64 before = records_.number_at(records_.before(corner)),
                  after = records_.number_at(records_.after(corner));
        const i64 grid = grid_number(corner), last = last_number_;
        const int recent = model_.proposal_history_;
        const int around = 4 * (before >= 0) + 2 * (after >= 0) + (grid >= 0);
        const std::array<i64, OrderModel::proposals> proposed = {
            last + 1, grid, before >= 0 ? before + 1 : -1, last - 1, after >= 0 ? after + 1 : -1, highest_ + 1};
        for (int kind = 0; kind < OrderModel::proposals; ++kind) {
            bool is_new = is_free(proposed[kind]);
            for (int earlier = 0; earlier < kind; ++earlier) is_new = is_new && proposed[earlier] != proposed[kind];
            if (!is_new) continue;
            const int distance = static_cast<int>(least<i64>(size_of(last - before), OrderModel::farthest));
            if (coder_.template mixed<2>(
                    {&model_.proposal_[kind][recent * slots + slot],
                     &model_.proposal_around_[kind][around * (OrderModel::farthest + 1) + distance]},
                    model_.proposal_weights_[kind].data(), proposed[kind] == number)) {
                model_.proposal_history_ = (8 * recent + kind) & 63;
                return proposed[kind];
            }
        }
        model_.proposal_history_ = (8 * recent + 7) & 63;
        const int context = grid >= 0 ? 0 : before >= 0 ? 1 : after >= 0 ? 2 : 3;
        const i64 reference = grid >= 0 ? grid : before >= 0 ? before : after >= 0 ? after : last + 1;
        const i64 rank = records_.left_numbers.rank_of(least(reference, static_cast<i64>(records_.vertex_of.size())));
        const i64 distance =
            model_.rank_[context].code(coder_, encoding ? records_.left_numbers.rank_of(number) - rank : 0);
        if (rank + distance < 0 || rank + distance >= records_.left_numbers.count()) broken();
        return records_.left_numbers.member_at(rank + distance);
    }

    // Predict the number at `corner` as on a regular grid: in a triangle by the parallelogram with the face across the
    // opposite side, in a quad by the other three corners; -1 if one of these has no number.
    i64 grid_number(i32 corner) const {
        const i32 following = records_.after(corner), preceding = records_.before(corner);
        const i64 one = records_.number_at(following), other = records_.number_at(preceding);
        const i32 opposite = records_.after(following);
        i64 beyond = -1;
        if (opposite == preceding) {
            const i32 across = records_.corners[following].across;
            if (across >= 0) beyond = records_.number_at(records_.before(across));
        } else if (opposite == records_.before(preceding)) {
            beyond = records_.number_at(opposite);
        }
        return one >= 0 && other >= 0 && beyond >= 0 ? one + other - beyond : -1;
    }

    // Code which corner of a face is its first, starting from `entry`. slot: how the face was named.
    i32 code_first(int slot, i32 entry, i32 first) {
        i32 lowest = entry, highest = entry, lowest_number = records_.number_at(entry), highest_number = lowest_number;
        for (i32 corner = records_.after(entry); corner != entry; corner = records_.after(corner)) {
            const i32 number = records_.number_at(corner);
            if (number < lowest_number) lowest = corner, lowest_number = number;
            if (number > highest_number) highest = corner, highest_number = number;
        }
        int &alike = model_.firsts_after_[slot];
        const int recent = model_.first_history_;
        i32 corner = entry;
        int step = 0;
        while (true) {
            const i32 following = records_.after(corner);
            if (following == entry) break;
            const int extreme = 2 * (corner == lowest) + (corner == highest), turn = least(step, 3);
            if (coder_.template mixed<2>({&model_.first_[turn][recent * 4 + extreme],
                                          &model_.first_slot_[turn][(alike * 4 + extreme) * slots + slot]},
                                         model_.first_weights_.data(), corner == first)) {
                break;
            }
            ++step;
            corner = following;
        }
        alike = (4 * alike + least(step, 3)) & 15;
        model_.first_history_ = (4 * recent + (corner == lowest ? 0 : corner == highest ? 1 : 2)) & 63;
        return corner;
    }

    // Record a face as the last one. It begins at `first` and was named by `slot`.
    void remember(i32 first, int slot) {
        model_.slot_long_before_ = model_.slot_before_;
        model_.slot_before_ = model_.slot_now_;
        model_.slot_now_ = slot;
        last_first_ = first;
        const i32 second = records_.after(first), number = records_.number_at(first);
        differences_[2] = differences_[0];
        differences_[3] = differences_[1];
        differences_[0] = records_.number_at(second) - number;
        differences_[1] = records_.number_at(records_.after(second)) - number;
    }

    // Collect the candidates after a face has been named: the corners across its sides, then the former candidates that
    // are still left.
    void list_candidates(i32 first) {
        latest_.clear();
        i32 corner = first;
        for (int step = 0; step < most_sides; ++step) {
            const i32 across = records_.corners[corner].across;
            if (across >= 0 && records_.is_left(across)) {
                latest_.push_back({across, least(step, OrderModel::sides_told - 1)});
            }
            corner = records_.after(corner);
            if (corner == first) break;
        }
        for (const Candidate &candidate : candidates_) {
            const int slot = candidate.slot + OrderModel::sides_told;
            if (slot >= OrderModel::by_place) break;
            if (records_.is_left(candidate.corner)) latest_.push_back({candidate.corner, slot});
        }
        candidates_.swap(latest_);
    }

    RangeCoder<mode> &coder_;
    OrderModel &model_;
    Records records_;
    const SourceOrder *source_;
    std::vector<Candidate> candidates_, latest_;
    i32 last_first_ = -1;               // the first corner of the last face
    std::array<i32, 4> differences_{};  // second and third vertex number minus the first, of the last two faces
    i64 last_number_ = -1, highest_ = -1;
};

OrderModel::OrderModel()
    : found_(256), found_slots_(slots * slots * slots), side_(by_place * slots * 4),
      side_slots_(by_place * slots * slots), list_(81 * 8), list_recent_(9 * 64) {
    corner_.fill(Models(256));
    corner_slot_.fill(Models(16 * slots));
    first_.fill(Models(64 * 4));
    first_slot_.fill(Models(64 * slots));
    proposal_.fill(Models(64 * slots));
    proposal_around_.fill(Models(8 * (farthest + 1)));
}

template <Mode mode> void OrderModel::encode(RangeCoder<mode> &coder, const CodedSurface &surface,
                                             const SourceOrder &order, std::span<const i32> used) {
    i64 at = 0;
    for (std::size_t k = 0; k < used.size();) {
        std::size_t end = k + 1;
        while (end < used.size() && used[end] == used[end - 1] + 1) ++end;
        gap_.code(coder, used[k] - at);
        // Code the number of vertices after a run instead of the run's length: most sets are a single run.
        rest_.code(coder, static_cast<i64>(used.size() - end));
        at = static_cast<i64>(used[end - 1]) + 1;
        k = end;
    }
    OrderCoder<mode>(coder, *this, surface, &order).code();
}

template void OrderModel::encode(RangeCoder<Mode::encode> &, const CodedSurface &, const SourceOrder &,
                                 std::span<const i32>);
template void OrderModel::encode(RangeCoder<Mode::measure> &, const CodedSurface &, const SourceOrder &,
                                 std::span<const i32>);

Faces OrderModel::decode(RangeCoder<Mode::decode> &coder, const CodedSurface &surface, i64 vertices) {
    std::vector<i32> used;
    i64 left = surface.vertex_count, at = 0;
    while (left > 0) {
        const i64 start = at + gap_.code(coder, 0), rest = rest_.code(coder, 0);
        if (rest >= left || start + left - rest > vertices) {
            throw CorruptError("numbers missing vertices");
        }
        at = start + left - rest;
        for (i64 vertex = start; vertex < at; ++vertex) used.push_back(static_cast<i32>(vertex));
        left = rest;
    }
    Faces faces = OrderCoder<Mode::decode>(coder, *this, surface, nullptr).code();
    for (i32 &index : faces.indices) index = used[index];
    return faces;
}

}  // namespace pdeanim
