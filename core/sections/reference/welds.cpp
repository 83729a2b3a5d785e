#include "sections/reference/welds.hpp"

#include "base/errors.hpp"

namespace pdeanim {

namespace {

constexpr int most_followed = 16;  // corners at a point that are looked at: bounded where all vertices lie on one point
constexpr int most_recent = 64;    // corners back in the list that are looked at
constexpr int most_digits = 31;    // of a distance between two points
constexpr int places = 4, ranks = 8;
constexpr int histories = 16;  // of the last four vertices, whether each lay on a point that was there

template <Mode mode> class WeldCoder {
public:
    WeldCoder(RangeCoder<mode> &coder, const CornerTable &corners, std::vector<i32> &point_of)
        : coder_(coder), corners_(corners), point_of_(point_of), is_met_(point_of.size()), latest_(point_of.size(), -1),
          earlier_(corners.fan.size()), edge_met_(corners.fan.size()), tried_(point_of.size(), -1),
          within_(point_of.size(), -1) {}

    i64 code() {
        const std::vector<i64> &starts = corners_.polygons.starts;
        for (i64 polygon = 0; polygon + 1 < static_cast<i64>(starts.size()); ++polygon) {
            const i32 first = static_cast<i32>(starts[polygon]), end = static_cast<i32>(starts[polygon + 1]);
            for (i32 corner = first; corner < end; ++corner) {
                const i32 vertex = corners_.vertex(corner);
                if (!is_met_[vertex]) {
                    is_met_[vertex] = true;
                    int context = least(corner - first, places - 1) * 4;
                    if (corner > first) {
                        context += latest_[point_at(corner - 1)] >= 0 ? 2 : 0;
                        context += latest_[point_at(first)] >= 0 ? 1 : 0;
                    }
                    if (code_is_old(old_[context + history_ * 4 * places], vertex)) {
                        point_of_[vertex] = code_point(corner);
                    }
                }
                within_[point_of_[vertex]] = static_cast<i32>(polygon);
            }
            enter_polygon(first, end);
        }
        for (i64 vertex = 0; vertex < static_cast<i64>(point_of_.size()); ++vertex) {
            if (is_met_[vertex]) continue;
            if (code_is_old(isolated_[history_], vertex)) {
                const i64 point = points_ - code_distance(points_ - point_of_[vertex]);
                if (point < 0) broken();
                point_of_[vertex] = static_cast<i32>(point);
            }
        }
        return points_;
    }

private:
    enum Way { before, after, recent };

    [[noreturn]] void broken() const {
        throw CorruptError("section REST welds a vertex to a point that is not there; get the file again");
    }

    i32 point_at(i32 corner) const { return point_of_[corners_.vertex(corner)]; }

    // Whether a vertex lies on a point that is there already; else it gets a new one.
    bool code_is_old(BitModel &model, i64 vertex) {
        const bool is_old = coder_.bit(model, point_of_[vertex] < points_);
        history_ = (2 * history_ + is_old) % histories;
        if (!is_old) point_of_[vertex] = static_cast<i32>(points_++);
        return is_old;
    }

    // A number from 1 on: its count of digits, then the digits below the first.
    i64 code_distance(i64 distance) {
        const int wanted = bit_length(distance);
        int digits = 1;
        while (digits < most_digits && coder_.bit(digits_[digits], wanted > digits)) ++digits;
        i64 value = 1;
        for (int digit = digits - 2; digit >= 0; --digit) value = 2 * value + coder_.bypass((distance >> digit) & 1);
        return value;
    }

    // Which point that is there already a corner lies on.
    i32 code_point(i32 corner) {
        const i32 polygon = corners_.polygon[corner];
        const i32 first = static_cast<i32>(corners_.polygons.starts[polygon]);
        const i32 last = static_cast<i32>(corners_.polygons.starts[polygon + 1]) - 1;
        const i32 point = point_at(corner);
        const int place = least(corner - first, places - 1) * 2 + (corner == last ? 1 : 0);
        for (const Way way : {before, after, recent}) {
            i32 other = corner - 1;
            if (way != recent) {
                if (corner == first) continue;
                other = latest_[point_at(way == before ? corner - 1 : first)];
            }
            int rank = 0;
            for (int turn = 0; turn < (way == recent ? most_recent : most_followed) && other >= 0; ++turn) {
                const i32 there = way == before  ? corners_.previous[other]
                                  : way == after ? corners_.next[other]
                                                 : other;
                const bool is_gap = way == recent || !edge_met_[way == before ? there : other];
                const i32 candidate = point_at(there);
                if (is_gap && tried_[candidate] != corner && within_[candidate] != polygon) {
                    tried_[candidate] = corner;
                    BitModel &model = candidates_[(way * ranks + least(rank, ranks - 1)) * 2 * places + place];
                    if (coder_.bit(model, candidate == point)) return candidate;
                    ++rank;
                }
                other = way == recent ? other - 1 : earlier_[other];
            }
        }
        const i64 found = points_ - code_distance(points_ - point);
        if (found < 0) broken();
        return static_cast<i32>(found);
    }

    // Note which edges of a polygon meet others, and let its corners be found at their points.
    void enter_polygon(i32 first, i32 end) {
        for (i32 corner = first; corner < end; ++corner) {
            const i32 following = point_at(corners_.next[corner]);
            i32 other = latest_[point_at(corner)];
            for (int turn = 0; turn < most_followed && other >= 0; ++turn) {
                const i32 edge = corners_.previous[other];
                if (point_at(edge) == following && !edge_met_[edge]) {
                    edge_met_[edge] = edge_met_[corner] = true;
                    break;
                }
                other = earlier_[other];
            }
        }
        for (i32 corner = first; corner < end; ++corner) {
            i32 &latest = latest_[point_at(corner)];
            earlier_[corner] = latest;
            latest = corner;
        }
    }

    RangeCoder<mode> &coder_;
    const CornerTable &corners_;
    std::vector<i32> &point_of_;
    std::vector<bool> is_met_;
    std::vector<i32> latest_;          // last corner at each point, or -1
    std::vector<i32> earlier_;         // the corner at the same point before each corner
    std::vector<bool> edge_met_;       // whether a polygon beside goes along the edge from each corner the other way
    std::vector<i32> tried_, within_;  // the corner that tried each point last, and the polygon that had it last
    i64 points_ = 0;
    int history_ = 0;
    std::array<BitModel, histories * places * 4> old_;
    std::array<BitModel, histories> isolated_;
    std::array<BitModel, 3 * ranks * places * 2> candidates_;
    std::array<BitModel, most_digits + 1> digits_;
};

}  // namespace

template <Mode mode> i64 code_welds(RangeCoder<mode> &coder, const CornerTable &corners, std::vector<i32> &point_of) {
    return WeldCoder<mode>(coder, corners, point_of).code();
}

template i64 code_welds(RangeCoder<Mode::encode> &, const CornerTable &, std::vector<i32> &);
template i64 code_welds(RangeCoder<Mode::decode> &, const CornerTable &, std::vector<i32> &);

}  // namespace pdeanim
