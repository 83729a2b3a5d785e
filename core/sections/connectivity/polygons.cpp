#include "sections/connectivity/polygons.hpp"

#include "base/errors.hpp"

namespace pdeanim {

template <Mode mode> void PolygonModel::code(RangeCoder<mode> &coder, i32 common_size, i32 smallest, i64 vertices,
                                             std::span<i32> sizes, std::span<i32> corners) {
    constexpr const char *broken = "refers to a vertex that is not there, or has faces that do not fit it";
    i64 highest = -1, first = 0;
    std::size_t used = 0;
    int new_history = 0;
    for (std::size_t polygon = 0; polygon < sizes.size(); ++polygon) {
        i64 size = common_size;
        if (common_size == 0) {
            if (const auto found = match_.code(coder, size_phase, sizes[polygon])) {
                size = *found;
            } else {
                size = smallest + sizes_.code(coder, static_cast<i64>(sizes[polygon]) - smallest);
            }
            match_.add(size);
            sizes[polygon] = static_cast<i32>(size);
        }
        const i64 left = static_cast<i64>(sizes.size() - 1 - polygon);
        if (size < smallest || size > static_cast<i64>(corners.size() - used) - smallest * left)
            throw CorruptError(broken);
        i64 before = first;
        for (i64 corner = 0; corner < size; ++corner) {
            const int phase = static_cast<int>(least<i64>(corner, last_corner_phase));
            i64 vertex = corners[used], difference = vertex - before;
            if (const auto found = match_.code(coder, phase, difference)) {
                difference = *found;
            } else {
                const bool is_new = coder.bit(new_[phase][new_history], vertex == highest + 1);
                new_history = (2 * new_history + is_new) & ((1 << new_history_bits) - 1);
                difference = is_new ? highest + 1 - before : differences_[phase].code(coder, difference);
            }
            match_.add(difference);
            vertex = before + difference;
            if (vertex < 0 || vertex >= vertices) throw CorruptError(broken);
            corners[used++] = static_cast<i32>(vertex);
            highest = most(highest, vertex);
            before = vertex;
            if (corner == 0) first = vertex;
        }
    }
    if (used != corners.size()) throw CorruptError(broken);
}

template void PolygonModel::code(RangeCoder<Mode::encode> &, i32, i32, i64, std::span<i32>, std::span<i32>);
template void PolygonModel::code(RangeCoder<Mode::decode> &, i32, i32, i64, std::span<i32>, std::span<i32>);
template void PolygonModel::code(RangeCoder<Mode::measure> &, i32, i32, i64, std::span<i32>, std::span<i32>);

}  // namespace pdeanim
