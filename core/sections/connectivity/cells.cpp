#include "sections/connectivity/cells.hpp"

#include <algorithm>
#include <string>

#include "base/errors.hpp"
#include "entropy/numbers.hpp"
#include "sections/connectivity/solids.hpp"

namespace pdeanim {

namespace {

class CellModel {
public:
    // Code the cells of one object; they are read when encoding and appended when decoding.
    template <Mode mode> void code(RangeCoder<mode> &coder, Connectivity &part, i64 &most_nodes) {
        const i64 count = count_.code(coder, static_cast<i64>(part.cell_sizes.size()));
        nodes_ = {};
        latest_.assign(part.vertices, none);
        of_cell_.assign(part.vertices, none);
        of_turn_.assign(part.vertices, none);
        before_.clear();
        cell_of_.clear();
        starts_.assign(1, 0);
        highest_ = -1;
        first_ = 0;
        for (i64 cell = 0; cell < count; ++cell) {
            coder.check_not_ended();
            const std::size_t number = static_cast<std::size_t>(cell);
            if constexpr (mode != Mode::decode) {
                code_kind(coder, part.cell_shapes[number], part.cell_sizes[number]);
            } else {
                code_kind(coder, 0, 0);
                most_nodes -= size_;
                if (most_nodes < 0) {
                    throw LimitError("section SOLD declares more cells than the memory limit allows");
                }
                part.cell_shapes.push_back(shape_);
                part.cell_sizes.push_back(size_);
                part.cell_indices.resize(part.cell_indices.size() + static_cast<std::size_t>(size_));
            }
            const std::span<i32> nodes = std::span(part.cell_indices).subspan(starts_.back(), size_);
            nodes_ = std::span(part.cell_indices).first(starts_.back() + nodes.size());
            code_nodes(coder, static_cast<i32>(cell), nodes, part.vertices);
        }
    }

private:
    static constexpr i32 none = -1;
    static constexpr int last_phase = 7;  // nodes from this one on share a phase
    static constexpr int new_history_bits = 5;
    static constexpr int most_cells = 16;    // number of the latest cells at a node that are searched
    static constexpr i32 largest_cell = 32;  // cells with more nodes are not searched
    static constexpr int most_shared = 3, last_turn = 15;

    template <Mode mode> void code_kind(RangeCoder<mode> &coder, u8 shape, i32 size) {
        if (coder.bit(same_[was_same_], shape == shape_ && size == size_)) {
            was_same_ = true;
            if (size_ == 0) throw CorruptError("has a cell like one before the first");
            return;
        }
        was_same_ = false;
        const i64 of_shape = shapes_.code(coder, static_cast<i64>(shape));
        if (of_shape >= cell_shapes) throw CorruptError("has a cell of an unknown shape");
        const i32 smallest = smallest_cells[static_cast<std::size_t>(of_shape)];
        const i64 found = smallest + sizes_.code(coder, static_cast<i64>(size) - smallest);
        if (found > (i64{1} << 31) - 1) throw CorruptError("has a cell of too many nodes");
        shape_ = static_cast<u8>(of_shape);
        size_ = static_cast<i32>(found);
    }

    template <Mode mode> void code_nodes(RangeCoder<mode> &coder, i32 cell, std::span<i32> nodes, i64 vertices) {
        for (std::size_t place = 0; place < nodes.size(); ++place) {
            const i64 before = place ? nodes[place - 1] : first_;
            const int phase = static_cast<int>(least<i64>(static_cast<i64>(place), last_phase));
            i64 difference = nodes[place] - before;
            if (const auto found = match_.code(coder, phase, difference)) {
                difference = *found;
            } else {
                difference = code_node(coder, cell, phase, before, nodes[place], vertices) - before;
            }
            match_.add(difference);
            const i64 node = before + difference;
            if (node < 0 || node >= vertices) {
                throw CorruptError("refers to a missing vertex");
            }
            nodes[place] = static_cast<i32>(node);
            of_cell_[node] = cell;
            highest_ = most(highest_, node);
        }
        // Only now, so that a cell that has a node several times does not find itself.
        for (const i32 node : nodes) {
            before_.push_back(latest_[node]);
            cell_of_.push_back(cell);
            latest_[node] = static_cast<i32>(before_.size() - 1);
        }
        first_ = nodes[0];
        starts_.push_back(starts_.back() + nodes.size());
    }

    // Code a node that is not matched.
    template <Mode mode>
    i64 code_node(RangeCoder<mode> &coder, i32 cell, int phase, i64 before, i64 node, i64 vertices) {
        const bool is_new = coder.bit(new_[phase][new_history_], node == highest_ + 1);
        new_history_ = (2 * new_history_ + is_new) & ((1 << new_history_bits) - 1);
        if (is_new) return highest_ + 1;
        find_candidates(cell, before, vertices);
        if (!candidates_.empty()) {
            const auto right = std::find_if(candidates_.begin(), candidates_.end(),
                                            [&](const Candidate &one) { return one.node == node; });
            const bool is_found = coder.bit(found_[phase][found_history_], right != candidates_.end());
            found_history_ = (2 * found_history_ + is_found) & ((1 << new_history_bits) - 1);
            if (is_found) {
                for (std::size_t turn = 0;; ++turn) {
                    const Candidate &own = candidates_[turn];
                    if (turn + 1 == candidates_.size()) return own.node;
                    const int t = static_cast<int>(least<i64>(static_cast<i64>(turn), last_turn));
                    if (coder.bit(this_one_[phase][own.shared][t], own.node == node)) return own.node;
                }
            }
        }
        return before + differences_[phase].code(coder, node - before);
    }

    struct Candidate {
        i32 node;
        int shared;
        i32 score;
    };

    // Find the nodes of the latest cells at a node that the current cell does not have yet.
    void find_candidates(i32 cell, i64 node, i64 vertices) {
        candidates_.clear();
        if (node < 0 || node >= vertices) return;
        i32 slot = latest_[node];
        for (int looked = 0; slot != none && looked < most_cells; slot = before_[slot]) {
            const i32 other = cell_of_[slot];
            ++looked;
            const std::size_t begin = starts_[other], end = starts_[other + 1];
            if (end - begin > largest_cell) continue;
            int shared = 0;
            for (std::size_t at = begin; at < end; ++at) shared += of_cell_[nodes_[at]] == cell;
            for (std::size_t at = begin; at < end; ++at) {
                const i32 one = nodes_[at];
                if (of_cell_[one] == cell) continue;
                i32 &place = of_turn_[one];
                if (place != none && place < static_cast<i32>(candidates_.size()) && candidates_[place].node == one) {
                    Candidate &known = candidates_[place];
                    known.shared = std::max(known.shared, std::min(shared, most_shared));
                    known.score += shared * shared;
                } else {
                    place = static_cast<i32>(candidates_.size());
                    candidates_.push_back({one, std::min(shared, most_shared), shared * shared});
                }
            }
        }
        // Insertion sort, because there are few: each goes after candidates of equal score.
        for (std::size_t end = 1; end < candidates_.size(); ++end) {
            for (std::size_t at = end; at > 0 && candidates_[at].score > candidates_[at - 1].score; --at) {
                std::swap(candidates_[at], candidates_[at - 1]);
            }
        }
    }

    NumberModel count_, shapes_, sizes_;
    std::array<BitModel, 2> same_;
    bool was_same_ = false;
    u8 shape_ = 0;
    i32 size_ = 0;
    std::array<std::array<BitModel, 1 << new_history_bits>, last_phase + 1> new_, found_;
    int new_history_ = 0, found_history_ = 0;
    std::array<std::array<std::array<BitModel, last_turn + 1>, most_shared + 1>, last_phase + 1> this_one_;
    std::array<SignedModel, last_phase + 1> differences_;
    MatchModel match_;

    i64 highest_ = -1, first_ = 0;
    std::span<const i32> nodes_;
    std::vector<i32> latest_, before_,
        cell_of_;  // the latest place of each vertex; for each place, the previous place of its vertex, and its cell
    std::vector<i32> of_cell_, of_turn_;  // for each vertex, the latest cell that has it, and its place as a candidate
    std::vector<std::size_t> starts_;
    std::vector<Candidate> candidates_;
};

}  // namespace

std::vector<u8> encode_cells(std::span<const ConnectivityView> parts) {
    if (std::all_of(parts.begin(), parts.end(), [](const auto &part) { return part.cell_sizes.empty(); })) return {};
    RangeCoder<Mode::encode> coder;
    CellModel model;
    for (const ConnectivityView &part : parts) {
        Connectivity own;
        own.vertices = part.vertices;
        own.cell_shapes.assign(part.cell_shapes.begin(), part.cell_shapes.end());
        own.cell_sizes.assign(part.cell_sizes.begin(), part.cell_sizes.end());
        own.cell_indices.assign(part.cell_indices.begin(), part.cell_indices.end());
        i64 unlimited = 0;
        model.code(coder, own, unlimited);
    }
    return coder.finish();
}

void decode_cells(std::span<const u8> data, std::span<Connectivity> parts, i64 most_nodes) {
    RangeCoder<Mode::decode> coder(data);
    CellModel model;
    try {
        for (Connectivity &part : parts) model.code(coder, part, most_nodes);
    } catch (const CorruptError &error) {
        throw CorruptError(Section("SOLD"),
                           std::string(error.what()) + ", at its byte " + std::to_string(coder.byte()));
    }
    coder.check_finished("SOLD");
}

}  // namespace pdeanim
