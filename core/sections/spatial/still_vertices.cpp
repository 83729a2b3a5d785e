#include "sections/spatial/still_vertices.hpp"

#include <array>

#include "base/errors.hpp"
#include "entropy/range_coder.hpp"

namespace pdeanim {

namespace {

constexpr int histories = 16;  // the last four bits of a kind are the context of the next one

enum Kind { of_parts, of_objects, of_vertices, kinds };

// Code for each object that has vertices whether only some of them stand still; then one bit for all, or one for each.
template <Mode mode>
void code_still(RangeCoder<mode> &coder, std::span<u8> still, std::span<const i64> first_vertices) {
    std::array<std::array<BitModel, histories>, kinds> models;
    std::array<int, kinds> history{};
    for (std::size_t object = 0; object + 1 < first_vertices.size(); ++object) {
        const i64 begin = first_vertices[object], end = first_vertices[object + 1];
        if (begin == end) continue;
        coder.check_not_ended();
        bool has_parts = false;
        if constexpr (mode == Mode::encode) {
            for (i64 vertex = begin; vertex < end; ++vertex) has_parts |= still[vertex] != still[begin];
        }
        const auto code = [&](Kind kind, bool bit) {
            bit = coder.bit(models[kind][history[kind]], bit);
            history[kind] = (2 * history[kind] + bit) % histories;
            return bit;
        };
        has_parts = code(of_parts, has_parts);
        for (i64 vertex = begin; vertex < end; ++vertex) {
            const bool is_known = !has_parts && vertex > begin;
            still[vertex] = is_known ? still[begin] : code(has_parts ? of_vertices : of_objects, still[vertex] != 0);
        }
    }
}

}  // namespace

std::vector<u8> encode_still(std::span<const u8> still, std::span<const i64> first_vertices) {
    RangeCoder<Mode::encode> coder;
    std::vector<u8> own(still.begin(), still.end());  // encoding does not change it
    code_still(coder, std::span(own), first_vertices);
    return coder.finish();
}

std::vector<u8> decode_still(std::span<const u8> data, std::span<const i64> first_vertices) {
    RangeCoder<Mode::decode> coder(data);
    std::vector<u8> still(first_vertices.back());
    code_still(coder, std::span(still), first_vertices);
    if (!coder.is_finished()) {
        throw CorruptError(Section("MODL"), "does not end with its vertices");
    }
    return still;
}

}  // namespace pdeanim
